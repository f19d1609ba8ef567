"""Frames by `async for`: the event loop runs meanwhile, and nothing is left behind."""

import asyncio
import threading

import numpy as np
import nunet_py as nunet
import pytest
from streaming import TIMEOUT, attached
from support import hint_of


def image(value):
    return np.full((48, 64, 3), value, np.uint8)


def test_frames_arrive_while_other_tasks_run():
    async def run(publisher, frames):
        ready = asyncio.Event()
        seen = []

        async def publish():
            for value in range(5):
                publisher.publish(image(value))
                await ready.wait()
                ready.clear()

        task = asyncio.create_task(publish())
        async for frame in frames:
            seen.append(int(frame.rgb[0, 0, 0]))
            ready.set()
            if len(seen) == 5:
                break
        await task
        return seen

    with attached() as (publisher, frames):
        assert asyncio.run(run(publisher, frames)) == [0, 1, 2, 3, 4]


def test_a_silent_publisher_is_a_timeout_with_the_reason():
    async def run(frames):
        async for _ in frames:
            pass

    with attached() as (publisher, frames):
        with nunet.subscribe(publisher.camera, topics=["rgb"], timeout=0.1) as subscriber:
            assert subscriber.timeout == pytest.approx(0.1)
            with pytest.raises(TimeoutError, match="publishes it, but has sent nothing new") as error:
                asyncio.run(run(subscriber))
            hint_of(error)
        publisher.publish(image(1))
        assert frames.next().sequence == 0


def test_closing_ends_the_loop():
    async def run(publisher, frames):
        publisher.publish(image(1))
        seen = []
        async for frame in frames:
            seen.append(frame.sequence)
            asyncio.get_running_loop().call_later(0.01, frames.close)
        return seen

    with attached() as (publisher, frames):
        assert asyncio.run(run(publisher, frames)) == [0]
        with pytest.raises(nunet.NunetError, match="is closed") as error:
            asyncio.run(run(publisher, frames))
        hint_of(error)


def test_a_canceled_task_leaves_no_thread_behind_and_the_subscriber_usable():
    async def run(frames):
        waiting = asyncio.create_task(anext(aiter(frames)))
        await asyncio.sleep(0)
        waiting.cancel()
        with pytest.raises(asyncio.CancelledError):
            await waiting

    with attached() as (publisher, frames):
        before = threading.active_count()
        asyncio.run(run(frames))  # joins its threads
        assert threading.active_count() == before
        publisher.publish(image(3))
        assert frames.next(timeout=TIMEOUT).rgb[0, 0, 0] == 3


def test_two_tasks_follow_two_cameras():
    async def first(frames):
        async for frame in frames:
            return int(frame.rgb[0, 0, 0])

    async def run(both):
        return await asyncio.gather(*(first(frames) for frames in both))

    with attached() as (left, of_left), attached() as (right, of_right):
        left.publish(image(1))
        right.publish(image(2))
        assert asyncio.run(run([of_left, of_right])) == [1, 2]
