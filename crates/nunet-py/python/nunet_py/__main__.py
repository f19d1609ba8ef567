"""The command `nunetd`: `python -m nunet_py` or the console script."""

from __future__ import annotations

import signal
import sys
from pathlib import Path

if not __package__:
    # Started by its path: make the package importable instead of the files in it.
    sys.path[0] = str(Path(__file__).absolute().parent.parent)

from nunet_py import _native


def main() -> None:
    """Run the command line and exit with its code."""
    # Python handles Ctrl-C only while the interpreter runs. nunetd handles it itself.
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    sys.exit(_native.command(["nunetd", *sys.argv[1:]]))


if __name__ == "__main__":
    main()
