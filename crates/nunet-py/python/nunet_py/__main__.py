"""The command `nunetd`: `python -m nunet_py` or the console script."""

from __future__ import annotations

import signal
import sys
from pathlib import Path

if not __package__:
    # Started by its path: what is beside the package is importable, what is in it is not.
    sys.path[0] = str(Path(__file__).absolute().parent.parent)

from nunet_py import _native


def main() -> None:
    """Run the command line and end with its exit code."""
    # Python's handler would only note Ctrl-C for an interpreter that is not running; nunetd's own ends it in order.
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    sys.exit(_native.command(["nunetd", *sys.argv[1:]]))


if __name__ == "__main__":
    main()
