"""Depth, semantic labels and point clouds from one color camera.

>>> import nunet_py as nunet
>>> model = nunet.Model("wnet_c.onnx")
>>> result = model.infer("room.jpg")  # or uint8 (H, W, 3), or a PIL image
>>> result.depth                      # float32 (H, W), meters, NaN where there is no depth
>>> result.cloud().points             # float32 (H, W, 3)

`Model` runs the pipeline of `nunetd` in this process, and `replay` runs recordings through it. `Camera` holds
intrinsics and distortion, `colorize` colors a depth map. `subscribe` reads the topics of a running `nunetd`,
and `publisher` sends images to it, both through shared memory without a copy. The command `nunetd` is also
`python -m nunet_py`.
"""

# Nothing large is imported here, not even numpy: the child process that checks a new model file imports this
# module, and the threads of numpy alone may reach its memory limit on a large machine.

from __future__ import annotations

import os
import sys
from importlib.util import find_spec
from pathlib import Path

from nunet_py import _native
from nunet_py._native import (
    AttitudePublisher,
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
    Obstacles,
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
    "AttitudePublisher",
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
    "Obstacles",
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

# Before the first model opens ONNX Runtime's library, which otherwise reports to its vendor. `os.environ`
# also writes the C library's environment, which ONNX Runtime reads. Only 0 allows telemetry; any other value
# becomes 1.
if os.environ.get("ORT_DISABLE_TELEMETRY") != "0":
    os.environ["ORT_DISABLE_TELEMETRY"] = "1"

_PACKAGE = Path(__file__).absolute().parent


def _library_folders() -> list[Path]:
    """The folder with the shared library of the package onnxruntime, which is not imported itself."""
    spec = find_spec("onnxruntime")
    return [Path(folder) / "capi" for folder in (spec.submodule_search_locations if spec else None) or []]


_native.describe_installation(
    # By path: `-m` would search the working directory first, which may hold files with the names of modules.
    command=[sys.executable or "", str(_PACKAGE / "__main__.py")],
    model_folders=[_PACKAGE / "models"],
    library_folders=_library_folders(),
)
