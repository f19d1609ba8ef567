"""Cameras and the points they see."""

import copy
import pickle

import numpy as np
import nunet_py as nunet
import pytest
from support import hint_of, noise

YAML = """image_width: 1280
image_height: 960
camera_name: front
camera_matrix: {rows: 3, cols: 3, data: [1037, 0, 651, 0, 1038, 507, 0, 0, 1]}
distortion_model: plumb_bob
distortion_coefficients: {rows: 1, cols: 5, data: [-0.31, 0.11, 0.0007, -0.0004, 0]}
"""


def test_a_camera_is_what_was_given():
    camera = nunet.Camera(fx=518.9, fy=519.5, cx=325.6, cy=253.7, size=(640, 480))
    assert (camera.fx, camera.fy, camera.cx, camera.cy, camera.size) == (
        518.9,
        519.5,
        325.6,
        253.7,
        (640, 480),
    )
    assert (camera.distortion, camera.distortion_model) == ([], None)
    assert camera.matrix.tolist() == [[518.9, 0, 325.6], [0, 519.5, 253.7], [0, 0, 1]]
    assert repr(camera) == "Camera(fx=518.9, fy=519.5, cx=325.6, cy=253.7, size=(640, 480))"
    with pytest.raises(AttributeError):
        camera.fx = 1.0


def test_a_lens_takes_what_opencv_gives_and_is_named_by_the_count_of_its_coefficients():
    def lens(coefficients, model=None):
        camera = nunet.Camera(500, 500, 320, 240, (640, 480), coefficients, distortion_model=model)
        return camera.distortion_model, camera.distortion

    five = [-0.3, 0.1, 0.001, -0.002, 0.01]
    assert lens(five) == ("plumb_bob", five)
    assert lens(np.array([five])) == ("plumb_bob", five), "cv2.calibrateCamera gives (1, 5)"
    assert lens(five[:4]) == ("plumb_bob", [*five[:4], 0])
    assert lens([*five, 0.1, 0.2, 0.3]) == ("rational_polynomial", [*five, 0.1, 0.2, 0.3])
    assert lens([0.01, -0.002, 0, 0], "equidistant") == ("equidistant", [0.01, -0.002, 0, 0])
    assert lens(()) == (None, [])


def test_equal_cameras_are_equal_and_can_be_copied():
    lens = [0.01, -0.002, 0.0, 0.0]
    camera = nunet.Camera(500, 500, 320, 240, (640, 480), lens, distortion_model="equidistant")
    for twin in (pickle.loads(pickle.dumps(camera)), copy.deepcopy(camera), eval(repr(camera), vars(nunet))):
        assert twin == camera and hash(twin) == hash(camera)
    assert camera != nunet.Camera(500, 500, 320, 240, (640, 480)) and camera != "camera"
    assert camera.at_size(320, 240) == nunet.Camera(
        250, 250, 159.75, 119.75, (320, 240), lens, distortion_model="equidistant"
    )


def test_a_calibration_of_ros_is_read(tmp_path):
    path = tmp_path / "front.yaml"
    path.write_text(YAML)
    camera = nunet.Camera.from_yaml(path)
    assert camera == nunet.Camera(1037, 1038, 651, 507, (1280, 960), [-0.31, 0.11, 0.0007, -0.0004, 0])
    path.write_text("image_width: 1280\n")
    with pytest.raises(nunet.CameraError, match=r"front\.yaml"):
        nunet.Camera.from_yaml(str(path))
    with pytest.raises(FileNotFoundError, match=r"none\.yaml"):
        nunet.Camera.from_yaml(tmp_path / "none.yaml")


BAD = {
    "no focal length": (dict(fx=0), nunet.CameraError, "`fx` is `0`"),
    "not a number": (dict(cy=float("nan")), nunet.CameraError, "`cy` is `NaN`"),
    "millimeters": (dict(fx=0.004), nunet.CameraError, "\nhint: .*pixels"),
    "text": (dict(fx="500"), TypeError, "`fx` is `'500'`; expected a number"),
    "a number for a name": (dict(distortion_model=4), TypeError, "`distortion_model` is `4`"),
    "size of an array": (dict(size=(480, 640, 3)), TypeError, "rgb.shape\\[1\\]"),
    "a list": (
        dict(size=[640, 480]),
        TypeError,
        r"is `\[640, 480\]`; expected a tuple .*\n.*`size=\(640, 480\)`",
    ),
    "fisheye": (
        dict(distortion=[0.1] * 4, distortion_model="fisheye"),
        nunet.CameraError,
        "\nhint: .*equidistant",
    ),
    "a path": (dict(distortion="front.yaml"), TypeError, "`distortion` is `'front.yaml'`"),
    "size of zero": (dict(size=(0, 480)), nunet.CameraError, "0x480"),
    "negative size": (dict(size=(-640, 480)), TypeError, "whole pixels"),
    "three coefficients": (dict(distortion=[1, 2, 3]), nunet.CameraError, "coefficients, got 3"),
    "words": (dict(distortion="none"), TypeError, "expected a sequence of numbers"),
    "infinite lens": (dict(distortion=[np.inf, 0, 0, 0]), nunet.CameraError, "`k1`"),
    "no such lens": (dict(distortion=[0.1] * 4, distortion_model="fov"), nunet.CameraError, "fov"),
    "lens of nothing": (dict(distortion_model="equidistant"), ValueError, "`distortion` is missing"),
}


@pytest.mark.parametrize("change, kind, words", BAD.values(), ids=BAD)
def test_invalid_cameras_are_refused(change, kind, words):
    good = dict(fx=500, fy=500, cx=320, cy=240, size=(640, 480))
    with pytest.raises(kind, match=words) as error:
        nunet.Camera(**(good | change))
    hint_of(error)


def test_points_project_back_onto_their_pixels(tiny):
    width, height = tiny.size
    camera = nunet.Camera(110, 112, 60, 50, (width, height))
    cloud = tiny.infer(noise(height, width), camera=camera).cloud()
    x, y, z = np.moveaxis(cloud.points.astype(np.float64), -1, 0)
    rows, columns = np.indices((height, width))
    valid = np.isfinite(z)
    assert valid.any()
    np.testing.assert_allclose((x / z * 110 + 60)[valid], columns[valid], atol=1e-3)
    np.testing.assert_allclose((y / z * 112 + 50)[valid], rows[valid], atol=1e-3)


def test_points_lie_on_undistorted_rays_and_pixels_without_a_ray_have_no_point(tiny):
    width, height = tiny.size
    lens = [-0.2, 0.03, 0.001, -0.0005]
    camera = nunet.Camera(110, 112, 60, 50, (width, height), lens)
    cloud = tiny.infer(noise(height, width), camera=camera).cloud()
    x, y, z = np.moveaxis(cloud.points.astype(np.float64), -1, 0)
    x, y = x / z, y / z
    k1, k2, p1, p2 = lens
    r2 = x**2 + y**2
    rings = 1 + k1 * r2 + k2 * r2**2
    seen_x = x * rings + 2 * p1 * x * y + p2 * (r2 + 2 * x**2)
    seen_y = y * rings + p1 * (r2 + 2 * y**2) + 2 * p2 * x * y
    rows, columns = np.indices((height, width))
    valid = np.isfinite(z)
    assert valid.any()
    np.testing.assert_allclose((seen_x * 110 + 60)[valid], columns[valid], atol=1e-2)
    np.testing.assert_allclose((seen_y * 112 + 50)[valid], rows[valid], atol=1e-2)

    wide = nunet.Camera(30, 30, 64, 48, (width, height), [0] * 4, distortion_model="equidistant")
    corners = tiny.infer(noise(height, width), camera=wide).cloud().points[::95, ::127]
    assert np.isnan(corners).all(), "a fisheye's corners look behind the camera"


def test_a_cloud_of_another_camera_has_the_same_depth(tiny):
    width, height = tiny.size
    result = tiny.infer(noise(2 * height, 2 * width))
    camera = nunet.Camera(220, 224, 121, 101, (2 * width, 2 * height))
    cloud = result.cloud(camera)
    assert cloud.points[..., 2].tobytes() == result.depth.tobytes()
    at_size = camera.at_size(width, height)
    pixel = cloud.points[10, 20]
    assert pixel[0] / pixel[2] * at_size.fx + at_size.cx == pytest.approx(20, abs=1e-3)
    with pytest.raises(nunet.CameraError, match="does not fit"):
        result.cloud(nunet.Camera(220, 224, 121, 101, (200, 200)))
