"""Results as files, and results that are pickled."""

import copy
import pickle
import subprocess

import numpy as np
import nunet_py as nunet
import pytest
from PIL import Image
from support import ON_THE_COMMAND_LINE, TINY, hint_of, model, noise

FILES = ["depth.npy", "depth_mm.png", "depth.png", "labels.png", "cloud.ply"]
CAMERA = nunet.Camera(110, 112, 60, 50, (128, 96))


@pytest.fixture(scope="module")
def result(tiny):
    return tiny.infer(noise(96, 128), camera=CAMERA)


def test_the_files_are_those_of_nunetd_infer(nunetd, result, tmp_path):
    Image.fromarray(noise(96, 128)).save(tmp_path / "noise.png")
    command = [nunetd, "-q", "infer", str(tmp_path / "noise.png"), "--out", str(tmp_path / "expected")]
    command += ["--model", str(TINY), "--intrinsics", "110,112,60,50", *ON_THE_COMMAND_LINE]
    subprocess.run(command, check=True)
    files = result.save(tmp_path / "new" / "folder")
    assert files == [tmp_path / "new" / "folder" / name for name in FILES]
    for file in files[:-1]:
        assert file.read_bytes() == (tmp_path / "expected" / file.name).read_bytes(), file.name
    # nunetd leaves out points beyond its range, which a cloud in Python has.
    ours, theirs = points_of(files[-1])[0], points_of(tmp_path / "expected" / "cloud.ply")[0]
    assert len(theirs) > len(ours) / 2 and {row.tobytes() for row in theirs} <= {
        row.tobytes() for row in ours
    }
    assert sorted(result.save(str(tmp_path / "new" / "folder"))) == sorted(files), (
        "existing files are replaced"
    )


def points_of(path):
    """The points of a PLY file."""
    header, _, body = path.read_bytes().partition(b"end_header\n")
    fields = [("xyz", "<f4", 3), ("rgb", "u1", 3), ("label", "u1")]
    points = np.frombuffer(body, fields)
    assert f"element vertex {len(points)}\n".encode() in header
    return points, header.decode()


def test_a_cloud_is_saved_with_its_colors_and_labels(result, tmp_path):
    cloud = result.cloud()
    cloud.save(tmp_path / "points.ply")
    points, header = points_of(tmp_path / "points.ply")
    valid = np.isfinite(cloud.points[..., 2])
    assert points["xyz"].tobytes() == cloud.points[valid].tobytes()
    assert (points["rgb"] == cloud.colors[valid]).all() and (points["label"] == cloud.labels[valid]).all()
    assert cloud.units == "metre" and "z forward, meters\n" in header


def test_results_that_cannot_be_saved_are_an_error_with_the_reason(result, tmp_path):
    cloud = result.cloud()
    with pytest.raises(ValueError, match=r"points\.pcd.*ends with `\.ply`") as error:
        cloud.save(tmp_path / "points.pcd")
    hint_of(error)
    with pytest.raises(FileNotFoundError, match=r"points\.ply"):
        cloud.save(tmp_path / "missing" / "points.ply")
    with pytest.raises(TypeError, match="`folder` is `None`") as error:
        result.save(None)
    hint_of(error)
    file = tmp_path / "file"
    file.touch()
    with pytest.raises(nunet.NunetError, match="file"):
        result.save(file / "folder")
    with pytest.raises(nunet.CameraError):
        result.save(tmp_path / "none", camera=nunet.Camera(100, 100, 50, 50, (100, 100)))
    assert not (tmp_path / "none").exists(), "arguments are checked before anything is written"


@pytest.mark.parametrize("clone", [lambda value: pickle.loads(pickle.dumps(value)), copy.deepcopy, copy.copy])
def test_results_and_clouds_survive_pickling(result, clone):
    twin = clone(result)
    for name in ("depth", "labels", "rgb"):
        assert getattr(twin, name).tobytes() == getattr(result, name).tobytes(), name
        assert getattr(twin, name).shape == getattr(result, name).shape
    names = ["class_names", "units", "scale_source", "timings", "invalid_pixels", "quality", "camera"]
    names += ["capture_nanos", "topic", "frame_id", "sequence"]
    assert [getattr(twin, name) for name in names] == [getattr(result, name) for name in names]
    assert repr(twin) == repr(result)
    cloud, expected = clone(twin.cloud()), result.cloud()
    for name in ("points", "labels", "colors"):
        assert getattr(cloud, name).tobytes() == getattr(expected, name).tobytes()
    assert (cloud.units, repr(cloud)) == (expected.units, repr(expected))


def test_a_pickled_result_remembers_the_size_of_its_image(tiny):
    result = tiny.infer(noise(192, 256))
    twin = pickle.loads(pickle.dumps(result))
    camera = nunet.Camera(220, 224, 121, 101, (256, 192))
    assert twin.cloud(camera).points.tobytes() == result.cloud(camera).points.tobytes()
    with pytest.raises(nunet.CameraError):
        twin.cloud(nunet.Camera(220, 224, 121, 101, (200, 200)))


def test_a_result_without_labels_is_saved_and_pickled(tmp_path):
    result = model(TINY.with_name("tiny_unet.onnx")).infer(noise(96, 128))
    assert result.labels is None
    names = [file.name for file in result.save(tmp_path)]
    assert names == [name for name in FILES if name != "labels.png"]
    assert pickle.loads(pickle.dumps(result)).labels is None


def test_a_confidence_is_saved_and_pickled(result, tmp_path):
    assert result.confidence is None, "a network without one"
    sure = model(TINY.with_name("tiny_unet_confidence.onnx")).infer(noise(96, 128))
    assert (sure.confidence.shape, sure.confidence.dtype) == ((96, 128), np.uint8)
    assert sure.confidence.max() > 100 and (sure.confidence[np.isnan(sure.depth)] == 0).all()
    files = {file.name: file for file in sure.save(tmp_path)}
    assert (np.array(Image.open(files["confidence.png"])) == sure.confidence).all()
    assert (pickle.loads(pickle.dumps(sure)).confidence == sure.confidence).all()
