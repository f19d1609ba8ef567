"""From the send to a numpy view in another process, with the reader asleep:
`python benches/python_hop.py [FRAMES]`.

Nothing is copied, so size should not matter. Run it with a release build of nunet_py on an idle machine.
"""

from __future__ import annotations

import datetime
import multiprocessing
import os
import platform
import sys
import time
from multiprocessing.connection import Connection
from pathlib import Path

import numpy as np
import nunet_py as nunet

# Maps of one byte a pixel, so that sides are whole: of 512x512, 640x480 and 1280x960 depths.
SIZES = {"256 KB": (512, 512), "1.2 MB": (1280, 960), "4.9 MB": (2560, 1920)}
WARM_UP = 50
PACE = 0.005
TIMEOUT = 30.0


def is_shared(address: int) -> bool:
    """Whether a file in shared memory is mapped at an address."""
    for line in Path("/proc/self/maps").read_text().splitlines():
        start, end = (int(part, 16) for part in line.split(maxsplit=1)[0].split("-"))
        if start <= address < end:
            return "/dev/shm/" in line
    return False


def read(camera: str, count: int, results: Connection) -> None:
    """Send back the nanoseconds from each send to its view, and how many bytes were copied."""
    nanos, copied = [], 0
    with nunet.subscribe(camera, topics=["rgb"], timeout=TIMEOUT) as frames:
        results.send("ready")
        for frame in frames:
            view = frame.image
            now = time.monotonic_ns()
            nanos.append(now - frame.header.publish_nanos)
            copied += 0 if is_shared(view.__array_interface__["data"][0]) else view.nbytes
            if len(nanos) == count:
                break
            results.send(frame.sequence)
    results.send((nanos, copied))


def hop(size: tuple[int, int], count: int) -> tuple[np.ndarray, int]:
    """Microseconds of each frame, without the first ones, and the bytes copied on both sides."""
    ours, theirs = multiprocessing.Pipe()
    width, height = size
    camera = f"bench-py-{os.getpid()}-{width}"
    with nunet.publisher(camera, size, encoding="mono8") as publisher:
        reader = multiprocessing.get_context("spawn").Process(
            target=read, args=(camera, count + WARM_UP, theirs)
        )
        reader.start()
        answer = ours.recv()
        while not isinstance(answer, tuple):
            time.sleep(PACE)  # the reader falls asleep
            with publisher.loan() as image:
                image[0, 0] = 1
            answer = ours.recv()
        reader.join()
        nanos, copied = answer
        copied += publisher.copied * width * height
    return np.array(nanos[WARM_UP:]) / 1e3, copied


def processor() -> str:
    """The processor's name."""
    for line in Path("/proc/cpuinfo").read_text().splitlines():
        if line.startswith("model name"):
            return line.split(":", 1)[1].strip()
    return platform.machine()


def main(count: int) -> None:
    """Print a table."""
    print(
        f"{datetime.date.today()}, {os.cpu_count()} cores of {processor()}, "
        f"Python {platform.python_version()}"
    )
    print(f"from the send to a numpy view, microseconds, {count} frames\n")
    print("| map | p50 | p99 | bytes copied |")
    print("|---|---|---|---|")
    for name, size in SIZES.items():
        micros, copied = hop(size, count)
        print(
            f"| {name} | {np.percentile(micros, 50):.1f} | {np.percentile(micros, 99):.1f} | {copied} |",
            flush=True,
        )


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 1000)
