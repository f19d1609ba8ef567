"""Subscribers over time: waiting, closing, threads, forks, and publishers that end."""

import os
import pathlib
import signal
import threading
import time

import numpy as np
import nunet_py as nunet
import pytest
from streaming import (
    TIMEOUT,
    attached,
    daemon,
    eventually,
    run_python,
    start_python,
    unique_name,
)
from support import hint_of


def image(value, shape=(48, 64, 3)):
    return np.full(shape, value, np.uint8)


def is_sleeping(pid):
    """Whether the main thread of a process waits for something."""
    return pathlib.Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] == "S"


def test_a_subscriber_waits_for_a_daemon_that_starts_later(nunetd):
    name = unique_name()
    found = []
    waiting = threading.Thread(
        target=lambda: found.append(nunet.subscribe(name, timeout=TIMEOUT).next().sequence)
    )
    waiting.start()
    with daemon(nunetd, name, "--rate", "30"):
        waiting.join(timeout=2 * TIMEOUT)
    assert len(found) == 1


def test_a_killed_daemon_is_named_and_the_same_subscriber_continues_with_its_successor(nunetd):
    name = unique_name()
    with daemon(nunetd, name, "--rate", "30") as process:
        frames = nunet.subscribe(name, topics=["depth", "labels"], timeout=TIMEOUT)
        held = frames.next().depth
        expected = held.copy()
        process.kill()
        process.wait(timeout=30)
    # Another process on this machine may have cleaned up after it first.
    dead = f"process {process.pid}, which published `depth`, is dead|`depth` is no longer published"
    with pytest.raises(TimeoutError, match=dead) as error:
        for _ in range(1000):
            frames.next(timeout=0.3)
    assert "start it again" in hint_of(error)
    assert not frames.connected
    with daemon(nunetd, name, "--rate", "30"):
        assert frames.next().depth.shape == expected.shape
        assert frames.connected
    assert np.array_equal(held, expected, equal_nan=True)
    frames.close()


def test_a_daemon_that_ends_normally_is_a_timeout_too(nunetd):
    name = unique_name()
    with daemon(nunetd, name, "--rate", "30") as process, nunet.subscribe(name, timeout=TIMEOUT) as frames:
        frames.next()
        process.terminate()
        process.wait(timeout=30)
        with pytest.raises(TimeoutError, match="`depth` is no longer published"):
            for _ in range(1000):
                frames.next(timeout=0.2)


def test_without_a_camera_the_hint_names_its_own_publisher():
    with attached() as (publisher, frames):
        publisher.close()
        with pytest.raises(TimeoutError, match="`rgb` is no longer published") as error:
            frames.next(timeout=0.2)
        assert "nunetd feed" in hint_of(error)


def test_a_closed_subscriber_raises_errors(still):
    frames = nunet.subscribe(still.camera, topics=["rgb"], timeout=TIMEOUT)
    frames.close()
    frames.close()
    assert frames.closed
    for use in (frames.next, frames.latest, lambda: iter(frames), frames.__enter__):
        with pytest.raises(nunet.NunetError, match="is closed") as error:
            use()
        hint_of(error)


def test_closing_ends_the_loop_from_inside_and_from_another_thread(still):
    with nunet.subscribe(still.camera, topics=["rgb"], timeout=TIMEOUT) as frames:
        still.publish(image(1))
        assert [frames.close() for _ in frames] == [None]
    frames = nunet.subscribe(still.camera, topics=["rgb"], timeout=float("inf"))
    seen, first = [], threading.Event()

    def follow():
        for frame in frames:
            seen.append(frame.sequence)
            first.set()

    waiting = threading.Thread(target=follow)
    waiting.start()
    still.publish(image(2))
    assert first.wait(TIMEOUT)
    frames.close()
    waiting.join(timeout=TIMEOUT)
    assert seen == [1] and not waiting.is_alive()


def test_connected_can_be_read_while_another_thread_waits(still):
    with nunet.subscribe(still.camera, topics=["rgb"], timeout=float("inf")) as frames:
        waiting = threading.Thread(target=lambda: list(frames))
        waiting.start()
        try:
            for _ in range(20):
                assert frames.connected
            still.close()
            eventually("the end of the publisher", lambda: not frames.connected)
            assert waiting.is_alive()
        finally:
            frames.close()
            waiting.join(timeout=TIMEOUT)
    with pytest.raises(nunet.NunetError, match="is closed") as error:
        _ = frames.connected
    hint_of(error)


def test_waiting_lets_other_threads_run_and_takes_no_processor(still):
    count, stop = 0, threading.Event()

    def work():
        nonlocal count
        while not stop.wait(0.001):
            count += 1

    worker = threading.Thread(target=work)
    with nunet.subscribe(still.camera, topics=["rgb"], timeout=1.0) as frames:
        worker.start()
        start = time.thread_time()
        with pytest.raises(TimeoutError):
            frames.next()
        spent = time.thread_time() - start
        stop.set()
        worker.join()
    assert count > 50
    assert spent < 0.25, "it spins"


def test_threads_that_share_a_subscriber_get_different_frames(still):
    seen, errors = [], []

    def read(frames):
        try:
            while not frames.closed:
                seen.append(frames.next().sequence)  # and drops it: the limit applies to all threads together
        except Exception as error:
            errors.append(error)

    with nunet.subscribe(still.camera, topics=["rgb"], timeout=TIMEOUT) as frames:
        readers = [threading.Thread(target=read, args=(frames,)) for _ in range(3)]
        for reader in readers:
            reader.start()
        for value in range(50):
            still.publish(image(value))
            eventually("a frame", lambda value=value: value in seen)
        frames.close()
        for reader in readers:
            reader.join(timeout=TIMEOUT)
    assert all("is closed" in str(error) for error in errors), errors
    assert sorted(seen) == list(range(50)), "each frame goes to one of them"


def test_ctrl_c_ends_the_waiting_for_a_frame_and_for_a_daemon():
    name = unique_name()
    with nunet.publisher(name, size=(64, 48)):
        for topic in ("rgb", "depth"):
            code = (
                "import sys, nunet_py\n"
                "print('ready', flush=True)\n"
                "frames = nunet_py.subscribe(sys.argv[1], topics=[sys.argv[2]], timeout=None)\n"
                "print('open', flush=True)\n"
                "frames.next()\n"
            )
            process = start_python(code, name, topic)
            assert process.stdout.readline() == "ready\n"
            if topic == "rgb":
                assert process.stdout.readline() == "open\n"
            eventually("the wait", lambda process=process: is_sleeping(process.pid))
            process.send_signal(signal.SIGINT)
            _, error = process.communicate(timeout=TIMEOUT)
            assert "KeyboardInterrupt" in error and process.returncode != 0


def test_a_fork_gets_an_error_and_does_not_affect_its_parent(still):
    with nunet.subscribe(still.camera, topics=["rgb"], timeout=TIMEOUT) as frames:
        still.publish(image(7))
        frame = frames.next()
        read_end, write_end = os.pipe()
        child = os.fork()
        if child == 0:
            texts = []
            for use in (
                frames.next,
                frames.latest,
                frames.close,
                lambda: frames.closed,
                lambda: list(frames),
            ):
                try:
                    use()
                    texts.append("no error")
                except nunet.NunetError as error:
                    texts.append(str(error))
            del frame, frames  # must give nothing back
            os.write(write_end, "\0".join(texts).encode())
            os._exit(0)
        os.close(write_end)
        with os.fdopen(read_end) as pipe:
            texts = pipe.read().split("\0")
        assert os.waitpid(child, 0)[1] == 0
        assert len(texts) == 5
        for text in texts:
            assert text.startswith(f"this subscriber belongs to process {os.getpid()}") and "\nhint: " in text
        for value in range(10):
            still.publish(image(value))
            assert frames.next().rgb[0, 0, 0] == value
        assert (frame.rgb == 7).all()


FORK = """
import os, sys
import nunet_py as nunet
publisher = nunet.publisher(sys.argv[1], size=(64, 48))
frames = nunet.subscribe(sys.argv[1], topics=["rgb"], timeout=30)
with publisher.loan() as image:
    image[:] = 3
frame = frames.next()
view = frame.rgb
child = os.fork()
if child == 0:
    sys.exit(5)  # takes the whole interpreter down, with everything that is inherited
assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 5
for value in range(10):
    with publisher.loan() as image:
        image[:] = value
    assert (
        nunet.subscribe(sys.argv[1], topics=["rgb"], timeout=30).closed, frames.next().rgb.max()
    ) == (False, value)
print(int(view.sum()))
"""


def test_a_fork_that_ends_does_not_affect_its_parent():
    ended = run_python(FORK, unique_name(), check=False)
    assert (ended.returncode, ended.stdout, ended.stderr) == (0, f"{48 * 64 * 3 * 3}\n", "")


EXIT = """
import sys, threading
import nunet_py as nunet
publisher = nunet.publisher(sys.argv[1], size=(64, 48))
frames = nunet.subscribe(sys.argv[1], topics=["rgb"], timeout=30)
with publisher.loan() as image:
    image[:] = 3
frame = frames.next()
view = frame.rgb[::2, 1:]
sys.modules["json"] = view  # what the interpreter takes down late
if sys.argv[2] == "thread":
    waiting = nunet.subscribe(sys.argv[1], topics=["rgb"], timeout=None)
    waiting.latest()
    threading.Thread(target=lambda: list(waiting), daemon=True).start()
print(int(view.sum()))
"""


@pytest.mark.parametrize("how", ["views", "thread"])
def test_an_interpreter_that_ends_with_live_views_ends_cleanly(how):
    ended = run_python(EXIT, unique_name(), how, check=False)
    assert (ended.returncode, ended.stdout, ended.stderr) == (0, f"{24 * 63 * 3 * 3}\n", "")


def test_a_killed_subscriber_affects_neither_the_publisher_nor_the_next_subscriber(still):
    code = (
        "import sys, nunet_py\n"
        "frames = nunet_py.subscribe(sys.argv[1], topics=['rgb'], timeout=30)\n"
        "print('open', flush=True)\n"
        "held = [frames.next(timeout=30), frames.next(timeout=30)]\n"
        "print('held', flush=True)\n"
        "sys.stdin.read()\n"
    )
    for _ in range(3):
        process = start_python(code, still.camera)
        assert process.stdout.readline() == "open\n"
        stop = threading.Event()

        def drive(stop=stop):
            while not stop.wait(0.01):
                still.publish(image(5))

        driver = threading.Thread(target=drive)
        driver.start()
        line = process.stdout.readline()
        process.kill()
        process.communicate(timeout=TIMEOUT)
        stop.set()
        driver.join()
        assert line == "held\n"
    with nunet.subscribe(still.camera, topics=["rgb"], timeout=TIMEOUT) as frames:
        for value in range(20):
            still.publish(image(value))
            assert frames.next().rgb[0, 0, 0] == value
