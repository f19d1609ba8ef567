"""Read depth from a running nunetd: `subscribe.py CAMERA [FRAMES]`.

Prints each frame's number, its age, and the depth at the picture's centre. Nothing is copied: `frame.depth` is the
memory that the network wrote.
"""

from __future__ import annotations

import sys

import numpy as np
import nunet_py as nunet


def line(frame: nunet.Frame) -> str:
    """What there is to say about a frame."""
    height, width = frame.depth.shape
    centre = frame.depth[height // 2, width // 2]
    measured = np.isfinite(frame.depth).mean()
    unit = "m" if frame.header.units == "metre" else "(relative)"
    return (
        f"frame {frame.sequence}: {1e3 * frame.age:.1f} ms old, centre {centre:.3f} {unit}, "
        f"{measured:.0%} measured ({frame.header.scale_source})"
    )


def main(camera: str, count: int | None) -> None:
    """Follow the camera until the frames are seen, Ctrl-C, or the daemon's end."""
    with nunet.subscribe(camera, topics=["depth"], timeout=5.0) as frames:
        for seen, frame in enumerate(frames, start=1):
            print(line(frame), flush=True)
            if seen == count:
                break


if __name__ == "__main__":
    try:
        main(
            sys.argv[1] if len(sys.argv) > 1 else "demo",
            int(sys.argv[2]) if len(sys.argv) > 2 else None,
        )
    except (TimeoutError, nunet.NunetError) as error:
        sys.exit(f"subscribe: {error}")
    except KeyboardInterrupt:
        sys.exit(130)
