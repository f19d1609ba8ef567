"""Daemon, feeder and reader are ended at random times by SIGTERM or SIGKILL: frames flow again, and nothing
is left.

`NUNET_CRASH_CYCLES=100 NUNETD=target/release/nunetd python -m pytest -s tests/python/test_crashes.py` prints
the table of recovery times: from the kill to the first frame that another process reads.
"""

import collections
import json
import os
import pathlib
import random
import signal
import subprocess
import time

import numpy as np
import pytest
from conftest import MODEL
from PIL import Image

CYCLES = int(os.environ.get("NUNET_CRASH_CYCLES", "12"))
SIGNALS = {"TERM": signal.SIGTERM, "KILL": signal.SIGKILL}
SHARED_MEMORY = pathlib.Path("/dev/shm")
# iceoryx2's own counter of nodes, which it never removes.
ALLOWED_REST = ".global_mgmt"


class Robot:
    """A camera's feeder, the daemon, and a reader, each a process of its own that can be replaced."""

    def __init__(self, nunetd, images):
        self.nunetd = nunetd
        self.camera = f"pytest-crash-{os.getpid()}"
        self.commands = {
            "feeder": ["feed", str(images), "--camera", self.camera, "--loop", "--rate", "30"],
            "daemon": ["--model", str(MODEL), "--source", f"shm:{self.camera}", "--camera", self.camera],
            "reader": ["watch", self.camera, "--json", "--timeout", "60"],
        }
        self.processes = {}
        for role in self.commands:
            self.start(role)

    def start(self, role):
        """Starts a process in that role."""
        command = [self.nunetd, "-q", *self.commands[role]]
        self.processes[role] = subprocess.Popen(command, stdout=subprocess.DEVNULL)

    def replace(self, role, sent):
        """Ends the process of a role with a signal, and starts another."""
        self.processes[role].send_signal(sent)
        self.processes[role].wait(timeout=60)
        self.start(role)

    def first_frame(self):
        """The first frame of a new reader."""
        watch = [self.nunetd, "-q", "watch", self.camera, "--json", "--frames", "1", "--timeout", "60"]
        return json.loads(subprocess.run(watch, check=True, capture_output=True, timeout=90).stdout)

    def stop(self):
        """Ends all three by SIGTERM, and returns their exit codes."""
        for process in self.processes.values():
            process.terminate()
        return {role: process.wait(timeout=60) for role, process in self.processes.items()}


@pytest.fixture
def robot(nunetd, tmp_path):
    """Three processes that pass frames on."""
    Image.fromarray(np.zeros((96, 128, 3), np.uint8)).save(tmp_path / "black.png")
    robot = Robot(nunetd, tmp_path)
    yield robot
    for process in robot.processes.values():
        process.kill()


def rest():
    """The files of iceoryx2 in shared memory, without those that it keeps on purpose."""
    return {path.name for path in SHARED_MEMORY.iterdir() if path.name.startswith("iox2_")} - {
        path.name for path in SHARED_MEMORY.iterdir() if path.name.endswith(ALLOWED_REST)
    }


def table(times):
    rows = ["role    signal  times  median  worst (s)"]
    for (role, name), seconds in sorted(times.items()):
        median = sorted(seconds)[len(seconds) // 2]
        rows.append(f"{role:<8}{name:<8}{len(seconds):>5}  {median:>6.2f}  {max(seconds):>5.2f}")
    return "\n".join(rows)


def test_frames_flow_again_after_any_death_and_nothing_stays_behind(robot):
    before = rest()
    chance = random.Random(CYCLES)
    robot.first_frame()
    times = collections.defaultdict(list)
    for _ in range(CYCLES):
        time.sleep(chance.random() * 0.5)
        role, name = chance.choice(list(robot.commands)), chance.choice(list(SIGNALS))
        start = time.monotonic()
        robot.replace(role, SIGNALS[name])
        robot.first_frame()
        times[role, name].append(time.monotonic() - start)
        alive = {role: process.poll() for role, process in robot.processes.items()}
        assert set(alive.values()) == {None}, f"{role} got SIG{name}, and others ended: {alive}"
    print("\n" + table(times))
    robot.first_frame()
    assert robot.stop() == {"feeder": 0, "daemon": 0, "reader": 0}
    assert rest() <= before
