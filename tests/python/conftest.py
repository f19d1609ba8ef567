"""Fixtures that several files share. `NUNETD` is the path of nunetd."""

import contextlib
import itertools
import json
import os
import pathlib
import subprocess
import tempfile

import pytest

# Before any test imports onnxruntime itself. Only 0 allows telemetry; ONNX Runtime treats an empty value as
# 0.
if os.environ.get("ORT_DISABLE_TELEMETRY") != "0":
    os.environ["ORT_DISABLE_TELEMETRY"] = "1"

# `/tmp/iceoryx2` may belong to another user, who then alone can use it.
os.environ.setdefault("NUNET_IPC_ROOT", f"{tempfile.gettempdir()}/nunet-{os.getuid()}")

COUNTER = itertools.count()
MODEL = pathlib.Path(__file__).parents[2] / "models" / "tiny" / "tiny_wnet_c.onnx"


def unavailable(reason, *, needs_root=False):
    """Skips a test with the reason. CI must not skip: there it fails, if it needs root then as root alone."""
    if os.environ.get("CI") == "true" and (not needs_root or os.geteuid() == 0):
        pytest.fail(reason)
    pytest.skip(reason)


@pytest.fixture(scope="session")
def nunetd():
    """The path of the daemon's binary. A missing one fails: these tests are never skipped."""
    path = os.environ.get("NUNETD")
    assert path and pathlib.Path(path).exists(), "set NUNETD to the daemon's binary (`cargo xtask test` does)"
    return path


@pytest.fixture(scope="session")
def contract(nunetd):
    """What `nunetd contract --json` prints."""
    return json.loads(subprocess.run([nunetd, "contract", "--json"], check=True, capture_output=True).stdout)


@contextlib.contextmanager
def running(command):
    """A process that ends with the block."""
    process = subprocess.Popen(command, stderr=subprocess.DEVNULL)
    try:
        yield process
    finally:
        process.terminate()
        process.wait(timeout=30)


@pytest.fixture
def camera(nunetd):
    """The name of a camera that a daemon publishes while the test runs, from the demo scene."""
    name = f"pytest-{os.getpid()}-{next(COUNTER)}"
    with running([nunetd, "--model", str(MODEL), "--source", "demo", "--camera", name, "--rate", "30"]):
        yield name


# The tests of the Python package. It is imported late: other tests run without it.


@pytest.fixture(scope="module")
def tiny():
    """The tiny model with untrained weights, in this process."""
    from support import model

    return model()


@pytest.fixture
def pair():
    """A publisher, and a subscriber to its images."""
    from streaming import attached

    with attached(frame_id="front_optical") as both:
        yield both


@pytest.fixture
def still():
    """A publisher that sends only when the test does."""
    import nunet_py
    from streaming import unique_name

    with nunet_py.publisher(unique_name(), size=(64, 48)) as publisher:
        yield publisher
