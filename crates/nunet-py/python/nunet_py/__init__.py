"""Depth, labels and point clouds from one colour camera.

>>> import nunet_py as nunet
>>> model = nunet.Model("wnet_c.onnx")
>>> result = model.infer(rgb)        # uint8 (H, W, 3)
>>> result.depth                     # float32 (H, W), metres, NaN where there is none
>>> result.cloud().points            # float32 (H, W, 3)

`Model` runs the pipeline of `nunetd` in this process, `replay` takes recordings through it, `Camera` says what is known
of the lens, `colorize` paints depth. `subscribe` reads what a running `nunetd` publishes, and `publisher` feeds it
pictures, both in shared memory without a copy. The command `nunetd` is `python -m nunet_py` as well.
"""

# Nothing heavy is imported here, not even numpy: the child process that tests a new model file starts with this
# module, within limits of memory that numpy's threads alone may reach on a large machine.

from __future__ import annotations

import os
import sys
from importlib.util import find_spec
from pathlib import Path

from nunet_py import _native
from nunet_py._native import (
    Camera,
    CameraError,
    Cloud,
    ContractVersionError,
    Frame,
    FrameHeader,
    Loan,
    Model,
    ModelError,
    NunetError,
    Publisher,
    Replay,
    Result,
    Stats,
    Subscriber,
    WiringError,
    __version__,
    colorize,
    publisher,
    replay,
    subscribe,
)

__all__ = [
    "Camera",
    "CameraError",
    "Cloud",
    "ContractVersionError",
    "Frame",
    "FrameHeader",
    "Loan",
    "Model",
    "ModelError",
    "NunetError",
    "Publisher",
    "Replay",
    "Result",
    "Stats",
    "Subscriber",
    "WiringError",
    "__version__",
    "colorize",
    "publisher",
    "replay",
    "subscribe",
]

# Before the first model opens ONNX Runtime's library, which otherwise reports to its vendor. `os.environ` also writes the
# C library's environment, which ONNX Runtime reads. Only 0 allows telemetry; any other value becomes 1.
if os.environ.get("ORT_DISABLE_TELEMETRY") != "0":
    os.environ["ORT_DISABLE_TELEMETRY"] = "1"

_PACKAGE = Path(__file__).absolute().parent


def _library_folders() -> list[Path]:
    """Where the package onnxruntime keeps its shared library; the package itself is not imported."""
    spec = find_spec("onnxruntime")
    return [Path(folder) / "capi" for folder in (spec.submodule_search_locations if spec else None) or []]


_native.describe_installation(
    # By its path: the working directory, which `-m` would search first, may hold files with the names of modules.
    command=[sys.executable or "", str(_PACKAGE / "__main__.py")],
    model_folders=[_PACKAGE / "models"],
    library_folders=_library_folders(),
)
