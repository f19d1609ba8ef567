"""Helpers for the tests of shared memory: daemons, cameras, and the address of memory."""

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
TIMEOUT = 30.0


def unique_name():
    """The name of a camera that no other test uses, in this process or another one."""
    return f"pytest-py-{os.getpid()}-{next(COUNTER)}"


@contextlib.contextmanager
def daemon(nunetd, name, *more, source="demo", model=MODEL):
    """A daemon, with the tiny model by default. It is killed at the end of the block."""
    command = [nunetd, "-q", "--model", str(model), "--source", source, "--camera", name, *more]
    process = subprocess.Popen(command, stderr=subprocess.DEVNULL)
    try:
        yield process
    finally:
        process.kill()
        process.wait(timeout=30)


@contextlib.contextmanager
def attached(**options):
    """A publisher of small images, and a subscriber to them."""
    options = {"camera": unique_name(), "size": (64, 48)} | options
    with (
        nunet.publisher(**options) as publisher,
        nunet.subscribe(publisher.camera, topics=["rgb"], timeout=TIMEOUT) as frames,
    ):
        yield publisher, frames


def run_python(code, *arguments, check=True):
    """Runs code in another interpreter and returns its output."""
    command = [sys.executable, "-c", code, *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=120, check=check)


def start_python(code, *arguments, cwd=None):
    """Starts code in another interpreter, with pipes."""
    command = [sys.executable, "-c", code, *arguments]
    return subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=cwd
    )


def mapping(address, pid="self"):
    """The mapped file at an address, and the offset of the address in it: (path, inode, offset)."""
    for line in pathlib.Path(f"/proc/{pid}/maps").read_text().splitlines():
        fields = line.split(maxsplit=5)
        start, end = (int(part, 16) for part in fields[0].split("-"))
        if start <= address < end:
            path = fields[5] if len(fields) > 5 else ""
            return path, int(fields[4]), int(fields[2], 16) + address - start
    raise AssertionError(f"nothing is mapped at {address:#x}")


def inodes(pid):
    """Inodes of the shared memory files that a process has mapped."""
    lines = pathlib.Path(f"/proc/{pid}/maps").read_text().splitlines()
    return {int(line.split()[4]) for line in lines if "/dev/shm/" in line}


def address(array):
    """The address of an array's first element."""
    return array.__array_interface__["data"][0]


def memory_bytes(kind):
    """Resident memory of this process: `RssAnon` is private, `RssShmem` is shared."""
    for line in pathlib.Path("/proc/self/status").read_text().splitlines():
        if line.startswith(f"{kind}:"):
            return int(line.split()[1]) * 1024
    raise AssertionError(f"no {kind}")


def eventually(what, poll, timeout=TIMEOUT):
    """Polls until `poll` returns something."""
    deadline = time.monotonic() + timeout
    while time.monotonic() < deadline:
        found = poll()
        if found:
            return found
        time.sleep(0.005)
    raise AssertionError(f"{what} did not happen")
