"""The same picture gives the same depth, byte for byte, in ONNX Runtime's own Python package, in the files of
`nunetd infer`, and in shared memory as an independent client reads it."""

import os
import subprocess

import numpy as np
import onnxruntime
import pytest
from conftest import MODEL, running
from contract import Reader
from PIL import Image

MIN_M, MAX_M = "nunet.depth.min_m", "nunet.depth.max_m"


@pytest.fixture(scope="module")
def session():
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1
    return onnxruntime.InferenceSession(str(MODEL), options, providers=["CPUExecutionProvider"])


@pytest.fixture(scope="module")
def picture(session, tmp_path_factory):
    """A picture of the model's size: noise, so that every pixel counts. Its path and its bytes."""
    _, height, width, _ = session.get_inputs()[0].shape
    rgb = np.random.default_rng(7).integers(0, 256, (height, width, 3), np.uint8)
    path = tmp_path_factory.mktemp("pictures") / "noise.png"
    Image.fromarray(rgb).save(path)
    return path, rgb


@pytest.fixture(scope="module")
def expected(session, picture):
    """Depth and labels as the contract defines them: what lies outside the model's range is no measurement."""
    depth, labels = session.run(["depth", "labels"], {"rgb": picture[1][None]})
    range_m = session.get_modelmeta().custom_metadata_map
    least, most = np.float32(range_m[MIN_M]), np.float32(range_m[MAX_M])
    valid = (depth >= least) & (depth <= most)
    assert valid.any(), "a model without any valid depth proves nothing"
    return np.where(valid, depth, np.float32(np.nan))[0, 0], labels[0]


def test_infer_writes_what_the_python_package_computes(nunetd, picture, expected, tmp_path):
    command = [nunetd, "-q", "infer", str(picture[0]), "--out", str(tmp_path), "--model", str(MODEL)]
    subprocess.run([*command, "--provider", "cpu", "--threads", "1"], check=True)
    depth = np.load(tmp_path / "depth.npy")
    assert depth.dtype == np.float32
    assert depth.tobytes() == expected[0].tobytes()
    assert (np.asarray(Image.open(tmp_path / "labels.png")) == expected[1]).all()


def test_shared_memory_holds_what_the_python_package_computes(nunetd, contract, picture, expected):
    name = f"pytest-truth-{os.getpid()}"
    source = ["--source", str(picture[0].parent), "--loop", "--rate", "30", "--provider", "cpu", "--threads", "1"]
    with running([nunetd, "--model", str(MODEL), "--camera", name, *source]):
        header, payload = Reader(contract, name, "depth").next()
    assert header.bytes_copied == 0
    assert bytes(payload) == expected[0].tobytes()
