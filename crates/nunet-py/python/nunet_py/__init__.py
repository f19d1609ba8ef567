"""Depth, labels and point clouds from one colour camera.

`Model` runs the pipeline in this process; `subscribe` reads what a running `nunetd` publishes, and `publisher` feeds
it, both in shared memory. Nothing heavy is imported here: the child process that tests a new model file starts with this
module, within limits of memory.
"""

from __future__ import annotations

import sys
from importlib.util import find_spec
from pathlib import Path

from nunet_py import _native
from nunet_py._native import (
    CameraError,
    CloudView,
    ContractVersionError,
    Frame,
    FrameHeader,
    Loan,
    ModelError,
    NunetError,
    Publisher,
    Stats,
    Subscriber,
    WiringError,
    __version__,
    publisher,
    subscribe,
)

__all__ = [
    "CameraError",
    "CloudView",
    "ContractVersionError",
    "Frame",
    "FrameHeader",
    "Loan",
    "ModelError",
    "NunetError",
    "Publisher",
    "Stats",
    "Subscriber",
    "WiringError",
    "__version__",
    "publisher",
    "subscribe",
]

_PACKAGE = Path(__file__).absolute().parent


def _library_folders() -> list[Path]:
    """Where the package onnxruntime keeps its shared library; the package itself is not imported."""
    spec = find_spec("onnxruntime")
    return [Path(folder) / "capi" for folder in (spec.submodule_search_locations if spec else None) or []]


_native.describe_installation(
    # By its path: the working directory, which `-m` would search first, may hold files with the names of modules.
    command=[sys.executable, str(_PACKAGE / "__main__.py")],
    model_folders=[_PACKAGE / "models"],
    library_folders=_library_folders(),
)
