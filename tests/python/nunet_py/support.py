"""Helpers for the tests of the Python package."""

import pathlib
import subprocess
import sys
import textwrap
import warnings

import numpy as np
import nunet_py as nunet

ROOT = pathlib.Path(__file__).parents[3]
TINY = ROOT / "models" / "tiny" / "tiny_wnet_c.onnx"
RECURRENT = TINY.with_name("tiny_wnet_c_lstm.onnx")
ROOM = ROOT / "models" / "clip" / "rgb" / "bedroom_00.jpg"
ONE_THREAD = {"provider": "cpu", "threads": 1}
ON_THE_COMMAND_LINE = ["--provider", "cpu", "--threads", "1"]
# Of the rendered rooms: pixels at 640x480.
INTRINSICS = (518.858, 519.470, 325.582, 253.736)


def model(path=TINY, **options):
    """A model with untrained weights, without the warning about them."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        return nunet.Model(path, **(ONE_THREAD | options))


def noise(height, width, seed=7):
    """An image of random pixels."""
    return np.random.default_rng(seed).integers(0, 256, (height, width, 3), np.uint8)


def hint_of(error):
    """The message of an exception from `pytest.raises`,
    which must have a hint, in its text and as an attribute.
    """
    text = str(error.value)
    assert "\nhint: " in text, text
    assert error.value.hint == text.partition("\nhint: ")[2].replace("\nhint: ", "\n"), text
    return text


def run_python(code, *arguments, timeout=120):
    """Runs `code` in another interpreter and returns the finished process with its output."""
    command = [sys.executable, "-W", "ignore", "-c", textwrap.dedent(code), *map(str, arguments)]
    return subprocess.run(command, check=False, capture_output=True, text=True, timeout=timeout)
