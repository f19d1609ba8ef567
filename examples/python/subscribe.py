"""Read depth from a running nunetd: `subscribe.py CAMERA [FRAMES]`.

Prints the number, the age and the depth at the center of each frame. Nothing is copied: `frame.depth` is the
memory that the network wrote.
"""

from __future__ import annotations

import argparse
import os
import sys

import numpy as np
import nunet_py as nunet


def line(frame: nunet.Frame) -> str:
    """One frame as text."""
    height, width = frame.depth.shape
    center = frame.depth[height // 2, width // 2]
    valid = np.isfinite(frame.depth).mean()
    unit = "m" if frame.header.units == "metre" else "(relative)"
    return (
        f"frame {frame.sequence}: {1e3 * frame.age:.1f} ms old, center {center:.3f} {unit}, "
        f"{valid:.0%} valid ({frame.header.scale_source})"
    )


def main(camera: str, count: int | None) -> None:
    """Print frames until `count`, Ctrl-C, or the end of nunetd."""
    with nunet.subscribe(camera, topics=["depth"], timeout=5.0) as frames:
        for seen, frame in enumerate(frames, start=1):
            print(line(frame), flush=True)
            if seen == count:
                break


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("camera")
    parser.add_argument("frames", type=int, nargs="?")
    arguments = parser.parse_args()
    try:
        main(arguments.camera, arguments.frames)
    except (TimeoutError, nunet.NunetError) as error:
        sys.exit(f"subscribe: {error}")
    except KeyboardInterrupt:
        sys.exit(130)
    except BrokenPipeError:  # the pipe was closed, as in `subscribe.py demo | head -1`
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
