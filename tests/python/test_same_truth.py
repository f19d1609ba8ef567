"""The same image gives the same depth, byte for byte, in ONNX Runtime's own Python package, in the files of
`nunetd infer`, in this process by `nunet_py`, and in shared memory as an independent client and `nunet_py`
read it. The same sequence does too, also with a recurrent network."""

import json
import os
import subprocess
import sys

import numpy as np
import nunet_py as nunet
import onnxruntime
import pytest
from conftest import MODEL, running
from contract import Reader
from PIL import Image

MIN_M, MAX_M = "nunet.depth.min_m", "nunet.depth.max_m"
RECURRENT = MODEL.with_name("tiny_wnet_c_lstm.onnx")
ONE_THREAD = ["--provider", "cpu", "--threads", "1"]


def open_session(model):
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1
    return onnxruntime.InferenceSession(str(model), options, providers=["CPUExecutionProvider"])


def measured(session, depth):
    """Depth as the contract defines it: depth outside the model's range is no measurement."""
    range_m = session.get_modelmeta().custom_metadata_map
    least, most = np.float32(range_m[MIN_M]), np.float32(range_m[MAX_M])
    valid = (depth >= least) & (depth <= most)
    assert valid.any(), "a model without any valid depth proves nothing"
    return np.where(valid, depth, np.float32(np.nan))[0, 0]


@pytest.fixture(scope="module")
def session():
    return open_session(MODEL)


@pytest.fixture(scope="module")
def image(session, tmp_path_factory):
    """An image of the model's size: noise, so that every pixel counts. Its path and its bytes."""
    _, height, width, _ = session.get_inputs()[0].shape
    rgb = np.random.default_rng(7).integers(0, 256, (height, width, 3), np.uint8)
    path = tmp_path_factory.mktemp("images") / "noise.png"
    Image.fromarray(rgb).save(path)
    return path, rgb


@pytest.fixture(scope="module")
def expected(session, image):
    depth, labels = session.run(["depth", "labels"], {"rgb": image[1][None]})
    return measured(session, depth), labels[0]


def test_infer_writes_what_the_python_package_computes(nunetd, image, expected, tmp_path):
    command = [nunetd, "-q", "infer", str(image[0]), "--out", str(tmp_path), "--model", str(MODEL)]
    subprocess.run([*command, *ONE_THREAD], check=True)
    depth = np.load(tmp_path / "depth.npy")
    assert depth.dtype == np.float32
    assert depth.tobytes() == expected[0].tobytes()
    assert (np.asarray(Image.open(tmp_path / "labels.png")) == expected[1]).all()


@pytest.mark.filterwarnings("ignore:.*untrained weights")
def test_the_pipeline_in_this_process_computes_the_same(image, expected):
    """Both have their own ONNX Runtime, side by side in one process."""
    model = nunet.Model(MODEL, provider="cpu", threads=1)
    for _ in range(2):
        result = model.infer(image[1])
        assert result.depth.tobytes() == expected[0].tobytes()
        assert (result.labels == expected[1]).all()


@pytest.mark.filterwarnings("ignore:.*untrained weights")
def test_points_in_this_process_are_those_of_the_ply_file(nunetd, tmp_path):
    """Of an image that is resized, with a camera that scales its depth."""
    rgb = np.random.default_rng(9).integers(0, 256, (480, 640, 3), np.uint8)
    Image.fromarray(rgb).save(tmp_path / "noise.png")
    command = [
        nunetd,
        "-q",
        "infer",
        str(tmp_path / "noise.png"),
        "--out",
        str(tmp_path),
        "--model",
        str(MODEL),
    ]
    subprocess.run([*command, *ONE_THREAD, "--intrinsics", "500,501,320,240@640x480"], check=True)
    camera = nunet.Camera(500, 501, 320, 240, (640, 480))
    result = nunet.Model(MODEL, provider="cpu", threads=1).infer(rgb, camera=camera)
    cloud = result.cloud()

    header, _, body = (tmp_path / "cloud.ply").read_bytes().partition(b"end_header\n")
    assert b"format binary_little_endian" in header
    points = np.frombuffer(body, np.dtype([("xyz", "<f4", 3), ("rgb", "u1", 3), ("label", "u1")]))
    assert np.load(tmp_path / "depth.npy").tobytes() == result.depth.tobytes()
    assert points["xyz"].tobytes() == cloud.valid().tobytes()
    valid = np.isfinite(cloud.points[..., 2])
    assert (points["rgb"] == cloud.colors[valid]).all() and (points["label"] == cloud.labels[valid]).all()


SUBSCRIBE = """
import sys
import nunet_py
with nunet_py.subscribe(sys.argv[1], topics=["depth", "labels"], timeout=60) as frames:
    frame = frames.next()
    sys.stdout.buffer.write(frame.depth.tobytes() + frame.labels.tobytes())
"""


def test_shared_memory_holds_what_the_python_package_computes(nunetd, contract, image, expected):
    name = f"pytest-truth-{os.getpid()}"
    source = ["--source", str(image[0].parent), "--loop", "--rate", "30", *ONE_THREAD]
    # In a process of its own: two copies of iceoryx2 in one process consider each other dead.
    subscribed = [sys.executable, "-c", SUBSCRIBE, name]
    with running([nunetd, "--model", str(MODEL), "--camera", name, *source]):
        header, payload = Reader(contract, name, "depth").next()
        seen = subprocess.run(subscribed, check=True, capture_output=True, timeout=120).stdout
    assert header.bytes_copied == 0
    assert bytes(payload) == expected[0].tobytes()
    assert seen == expected[0].tobytes() + expected[1].tobytes()


@pytest.fixture(scope="module")
def sequence(tmp_path_factory):
    """Images in a folder, and the depth of each, computed with the state that the earlier ones left."""
    session = open_session(RECURRENT)
    memory = json.loads(session.get_modelmeta().custom_metadata_map["nunet.state"])
    state = {tensor["input"]: np.zeros(tensor["shape"], np.float32) for tensor in memory}
    folder, depths = tmp_path_factory.mktemp("sequence"), []
    _, height, width, _ = session.get_inputs()[0].shape
    images = np.random.default_rng(8).integers(0, 256, (4, height, width, 3), np.uint8)
    for index, rgb in enumerate(images):
        Image.fromarray(rgb).save(folder / f"{index}.png")
        outputs = ["depth", *(tensor["output"] for tensor in memory)]
        depth, *left = session.run(outputs, {"rgb": rgb[None], **state})
        state = {tensor["input"]: value for tensor, value in zip(memory, left, strict=True)}
        depths.append(measured(session, depth))
    return folder, depths


def run_frames(nunetd, folder, out, frames):
    """The depth of the last of so many frames, as `nunetd run` writes it."""
    source = [
        "--source",
        str(folder),
        "--loop",
        "--frames",
        str(frames),
        "--camera",
        f"pytest-sequence-{os.getpid()}",
    ]
    command = [nunetd, "-q", "--model", str(RECURRENT), *source, "--out", str(out), *ONE_THREAD]
    subprocess.run(command, check=True)
    return np.load(out / "depth.npy")


def test_a_network_with_a_memory_sees_a_sequence_as_the_python_package_does(nunetd, sequence, tmp_path):
    folder, depths = sequence
    for index, depth in enumerate(depths):
        assert run_frames(nunetd, folder, tmp_path, index + 1).tobytes() == depth.tobytes(), f"frame {index}"


def test_a_loop_that_begins_again_begins_without_a_memory(nunetd, sequence, tmp_path):
    folder, depths = sequence
    for index in range(2):
        after_a_round = run_frames(nunetd, folder, tmp_path, len(depths) + index + 1)
        assert after_a_round.tobytes() == depths[index].tobytes()


def test_single_images_are_no_sequence(nunetd, sequence, tmp_path):
    folder, depths = sequence
    images = [str(folder / name) for name in ("1.png", "0.png")]
    subprocess.run(
        [nunetd, "-q", "infer", *images, "--out", str(tmp_path), "--model", str(RECURRENT), *ONE_THREAD],
        check=True,
    )
    assert np.load(tmp_path / "0" / "depth.npy").tobytes() == depths[0].tobytes()
    assert np.load(tmp_path / "1" / "depth.npy").tobytes() != depths[1].tobytes(), "it remembers nothing of 0"
