"""Where the scale of depth comes from."""

import pickle
import warnings

import numpy as np
import nunet_py as nunet
import pytest
from support import ROOT, noise

CALIBRATION = """image_width: 128
image_height: 96
camera_matrix: {rows: 3, cols: 3, data: [110, 0, 60, 0, 112, 50, 0, 0, 1]}
distortion_model: plumb_bob
distortion_coefficients: {rows: 1, cols: 5, data: [0, 0, 0, 0, 0]}
nunet_scale: {factor: 0.5}
"""


def camera_of(model, **options):
    return nunet.Camera(110, 112, 60, 50, model.size, **options)


def test_the_scale_of_a_camera_replaces_the_focal_length(tiny):
    rgb = noise(*reversed(tiny.size))
    focal = tiny.infer(rgb, camera=camera_of(tiny))
    scaled = tiny.infer(rgb, camera=camera_of(tiny, scale=0.5))
    assert (scaled.scale_source, scaled.scale_factor) == ("calibrated", 0.5)
    assert focal.scale_source == "focal_scaled"
    ratio = scaled.depth / focal.depth
    np.testing.assert_allclose(ratio[np.isfinite(ratio)], 0.5 / focal.scale_factor, rtol=1e-5)
    assert tiny.infer(rgb, camera=camera_of(tiny)).scale_source == "focal_scaled", (
        "it is the camera's, not the model's"
    )


def test_a_calibration_file_brings_its_scale_and_pickle_keeps_it(tmp_path):
    path = tmp_path / "front.yaml"
    path.write_text(CALIBRATION)
    camera = nunet.Camera.from_yaml(path)
    assert camera.scale == 0.5
    assert "scale=0.5" in repr(camera)
    assert pickle.loads(pickle.dumps(camera)) == camera != nunet.Camera(110, 112, 60, 50, (128, 96))
    assert camera.at_size(64, 48).scale == 0.5


def test_a_scale_that_was_measured_with_another_aspect_causes_one_warning(tiny, tmp_path):
    path = tmp_path / "front.yaml"
    # The shape of the images is not that of the model.
    wide = CALIBRATION.replace("image_width: 128", "image_width: 160").replace("96", "90")
    path.write_text(wide.replace("0.5}", "0.5, aspect: stretch}"))
    camera = pickle.loads(pickle.dumps(nunet.Camera.from_yaml(path)))
    for aspect, count in [("crop", 1), ("stretch", 0)]:
        net = nunet.Model(tiny.path, aspect=aspect)
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            for _ in range(2):
                net.infer(noise(90, 160), camera=camera)
        about = [str(w.message) for w in caught if "the aspect mode `stretch`" in str(w.message)]
        assert len(about) == count, about
        assert all("\nhint: calibrate again with `crop`" in message for message in about)


def test_a_scale_is_shown_as_it_was_given(tiny):
    camera = camera_of(tiny, scale=0.83)
    assert (camera.scale, tiny.infer(noise(*reversed(tiny.size)), camera=camera).scale_factor) == (0.83, 0.83)


def test_a_model_takes_a_scale_and_conflicts_are_errors(tiny):
    rgb = noise(*reversed(tiny.size))
    half = nunet.Model(tiny.path, scale=0.5)
    assert half.infer(rgb).scale_source == "calibrated"
    with pytest.raises(ValueError, match="has one too"):
        half.infer(rgb, camera=camera_of(tiny, scale=0.7))
    assert nunet.Model(tiny.path, scale="off").infer(rgb).scale_source == "metric"
    for options, words in [
        (dict(scale="floor"), "`mount` is missing"),
        (dict(scale="wide"), "`scale` is `wide`"),
        (dict(scale="floor", mount=(0, 0, -1, 0, 0, 0)), "above the floor"),
        (dict(mount=(0, 0, 0.25, 0, 0, 0)), "`mount` is given"),
        (dict(scale=0.5, mount=(0, 0, 0.25, 0, 0, 0)), "`mount` is given"),
    ]:
        with pytest.raises(ValueError, match=words):
            nunet.Model(tiny.path, **options)
    with pytest.raises(TypeError, match="a word or a number"):
        nunet.Model(tiny.path, scale=[1])
    with pytest.raises(nunet.CameraError, match=r"0\.05 to 20"):
        nunet.Model(tiny.path, scale=1000)
    with pytest.raises(TypeError, match=r"`attitude` is `\[0.0, 0.1\]`; expected a tuple \(roll, pitch\)"):
        tiny.infer(rgb, attitude=[0.0, 0.1])
    with pytest.raises(TypeError, match="`aspect` is `1`; expected a str"):
        nunet.Model(tiny.path, aspect=1)
    with pytest.raises(ValueError, match="does not take its scale from the floor"):
        tiny.infer(rgb, attitude=(0.0, 0.1))


def test_an_attitude_counts_for_its_image_only():
    model = nunet.Model("wnet_c.onnx", scale="floor", mount=(0.0, 0.0, 0.25, 0.0, -0.07, 0.0))
    camera = nunet.Camera(262, 262, 160.3, 119.2, (320, 240))
    image = ROOT / "models/drive/rgb/0000.jpg"
    factor = lambda **options: model.infer(image, camera=camera, **options).scale_factor  # noqa: E731
    before, tilted, after = factor(), factor(attitude=(0.0, 0.0)), factor()
    assert before == after != tilted
