"""What a service manager sees, and the files for one in `dist/`."""

import os
import pathlib
import shutil
import signal
import socket
import subprocess

import pytest
from conftest import MODEL, unavailable

CALIBRATION = """image_width: 1280
image_height: 960
camera_matrix: {rows: 3, cols: 3, data: [1037, 0, 651, 0, 1038, 507, 0, 0, 1]}
distortion_model: plumb_bob
distortion_coefficients: {rows: 1, cols: 5, data: [-0.31, 0.11, 0.0007, -0.0004, 0]}
"""
DIST = pathlib.Path(__file__).parents[2] / "dist"


@pytest.fixture
def manager(tmp_path):
    """The notification socket of a service manager, and the environment variables that name it."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as listener:
        listener.bind(str(tmp_path / "notify"))
        listener.settimeout(30)
        yield listener, {"NOTIFY_SOCKET": str(tmp_path / "notify"), "WATCHDOG_USEC": "400000"}


def wait_for(listener, word):
    """Waits for a message with `word`, until the listener's timeout; returns the earlier messages."""
    before = []
    for _ in range(1000):
        message = listener.recv(4096).decode()
        if word in message:
            return before
        before.append(message)
    raise AssertionError(f"no {word} among {before[:5]} ...")


def test_ready_comes_after_the_selftest_and_frames_feed_the_watchdog(nunetd, manager):
    listener, environment = manager
    name = f"pytest-service-{os.getpid()}"
    command = [nunetd, "--model", str(MODEL), "--source", "demo", "--rate", "20", "--camera", name]
    with subprocess.Popen(
        command, env={**os.environ, **environment}, stderr=subprocess.PIPE, text=True
    ) as daemon:
        assert wait_for(listener, "READY=1") == []
        for _ in range(3):
            wait_for(listener, "WATCHDOG=1")
        daemon.send_signal(signal.SIGTERM)
        wait_for(listener, "STOPPING=1")
        stderr = daemon.communicate(timeout=30)[1]
    assert "self-test passed" in stderr
    assert daemon.returncode == 0


def test_a_camera_that_is_waited_for_feeds_the_watchdog(nunetd, manager):
    listener, environment = manager
    name = f"pytest-waited-{os.getpid()}"
    command = [nunetd, "-q", "--model", str(MODEL), "--source", f"shm:{name}-nobody", "--camera", name]
    with subprocess.Popen(command, env={**os.environ, **environment}) as daemon:
        wait_for(listener, "READY=1")
        for _ in range(3):
            wait_for(listener, "WATCHDOG=1")
        daemon.terminate()
        assert daemon.wait(timeout=30) == 0


def silent_pipe(_):
    return ["--source", "-"]


def damaged_images(folder):
    # More than the test lasts: a round without a good image would end the source.
    (folder / "images").mkdir()
    for number in range(1000):
        (folder / "images" / f"{number:03}.png").write_bytes(b"no image")
    return ["--source", str(folder / "images"), "--loop", "--rate", "20"]


@pytest.mark.parametrize("source", [silent_pipe, damaged_images])
def test_a_source_that_hangs_and_frames_that_never_come_out_do_not_feed_the_watchdog(
    nunetd, manager, tmp_path, source
):
    listener, environment = manager
    name = f"pytest-{source.__name__}-{os.getpid()}"
    command = [nunetd, "-q", "--model", str(MODEL), *source(tmp_path), "--camera", name]
    with subprocess.Popen(command, env={**os.environ, **environment}, stdin=subprocess.PIPE) as daemon:
        wait_for(listener, "READY=1")
        listener.settimeout(1.5)
        with pytest.raises(TimeoutError):
            wait_for(listener, "WATCHDOG=1")
        assert daemon.poll() is None, "it ended by itself"
        daemon.terminate()
        daemon.wait(timeout=30)


def test_the_example_configuration_is_accepted(nunetd):
    command = [nunetd, "config", "--config", str(DIST / "nunetd.toml")]
    stdout = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    assert 'source = "shm:front"\n' in stdout
    # Every setting that is commented out would be accepted.
    example = (DIST / "nunetd.toml").read_text().split("# [[camera]]")[0].splitlines()
    settings = [line[2:].split(" = ")[0] for line in example if line.startswith("# ") and " = " in line]
    assert settings and all(f"# {name} is not set\n" in stdout for name in settings), settings


def test_the_example_of_several_cameras_is_accepted(nunetd, tmp_path):
    sections = (DIST / "nunetd.toml").read_text().split("# [[camera]]")[1:]
    assert len(sections) == 2
    text = ""
    for section in sections:
        lines = [line.removeprefix("# ") for line in section.splitlines() if " = " in line]
        text += "\n".join(["[[camera]]", *lines, ""])
    path, calibration = tmp_path / "several.toml", tmp_path / "front.yaml"
    calibration.write_text(CALIBRATION)  # `config` reads it, as `run` does
    assert "/etc/nunet/front.yaml" in text
    path.write_text(text.replace("/etc/nunet/front.yaml", str(calibration)))
    command = [nunetd, "config", "--config", str(path)]
    stdout = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    assert stdout.count("[[camera]]") == 2 and 'name = "rear"' in stdout


def test_the_unit_never_gives_a_camera_up():
    assert "StartLimitIntervalSec=0\n" in (DIST / "nunetd.service").read_text()


def test_systemd_takes_the_unit(tmp_path):
    if shutil.which("systemd-analyze") is None:
        unavailable("systemd-analyze is not installed")
    unit = (DIST / "nunetd.service").read_text().replace("/usr/bin/nunetd", "/bin/true")
    (tmp_path / "nunetd.service").write_text(unit)
    done = subprocess.run(
        ["systemd-analyze", "verify", str(tmp_path / "nunetd.service")],
        check=False,
        capture_output=True,
        text=True,
    )
    assert not [line for line in done.stderr.splitlines() if "nunetd.service" in line], done.stderr
