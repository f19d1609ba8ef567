"""What the tests of frames in shared memory share: daemons, cameras, and where memory really lies."""

import contextlib
import itertools
import os
import pathlib
import subprocess
import sys
import time

import nunet_py as nunet
from conftest import MODEL

COUNTER = itertools.count()
PATIENCE = 30.0


def unique_name():
    """A camera that no other test, of this or another process, uses."""
    return f"pytest-py-{os.getpid()}-{next(COUNTER)}"


@contextlib.contextmanager
def daemon(nunetd, name, *more, source="demo"):
    """A daemon on the tiny model; killed with the block, if it still runs."""
    command = [nunetd, "-q", "--model", str(MODEL), "--source", source, "--camera", name, *more]
    process = subprocess.Popen(command, stderr=subprocess.DEVNULL)
    try:
        yield process
    finally:
        process.kill()
        process.wait(timeout=30)


@contextlib.contextmanager
def attached(**options):
    """A publisher of small pictures, and a subscriber to them."""
    options = {"camera": unique_name(), "size": (64, 48)} | options
    with (
        nunet.publisher(**options) as publisher,
        nunet.subscribe(publisher.camera, topics=["rgb"], timeout=PATIENCE) as frames,
    ):
        yield publisher, frames


def run_python(code, *arguments, check=True):
    """Runs a program of its own; its output."""
    command = [sys.executable, "-c", code, *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=120, check=check)


def start_python(code, *arguments, cwd=None):
    """Starts a program of its own, with pipes."""
    command = [sys.executable, "-c", code, *arguments]
    return subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=cwd
    )


def mapping(address, pid="self"):
    """The file that is mapped at an address, and where in it the address lies: (path, inode, offset)."""
    for line in pathlib.Path(f"/proc/{pid}/maps").read_text().splitlines():
        fields = line.split(maxsplit=5)
        start, end = (int(part, 16) for part in fields[0].split("-"))
        if start <= address < end:
            path = fields[5] if len(fields) > 5 else ""
            return path, int(fields[4]), int(fields[2], 16) + address - start
    raise AssertionError(f"nothing is mapped at {address:#x}")


def inodes(pid):
    """Inodes of the files in shared memory that a process has mapped."""
    lines = pathlib.Path(f"/proc/{pid}/maps").read_text().splitlines()
    return {int(line.split()[4]) for line in lines if "/dev/shm/" in line}


def address(array):
    """Where an array's first element lies."""
    return array.__array_interface__["data"][0]


def memory_bytes(kind):
    """Resident memory of this process: `RssAnon` is its own, `RssShmem` is shared."""
    for line in pathlib.Path("/proc/self/status").read_text().splitlines():
        if line.startswith(f"{kind}:"):
            return int(line.split()[1]) * 1024
    raise AssertionError(f"no {kind}")


def eventually(what, look, patience=PATIENCE):
    """Polls until there is something."""
    deadline = time.monotonic() + patience
    while time.monotonic() < deadline:
        found = look()
        if found:
            return found
        time.sleep(0.005)
    raise AssertionError(f"{what} did not happen")
