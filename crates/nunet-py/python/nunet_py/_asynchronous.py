"""Frames of a subscriber as an asynchronous iterator."""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator

from nunet_py._native import Frame, Subscriber

# Longest wait on a worker thread, seconds: a canceled task leaves its thread behind for this long at most.
_MAX_WAIT = 0.05


async def frames(subscriber: Subscriber) -> AsyncIterator[Frame]:
    """Yield the newest frames until the subscriber is closed; the event loop runs meanwhile."""
    while not subscriber.closed:
        frame = await _next(subscriber)
        if frame is None:
            return
        yield frame


async def _next(subscriber: Subscriber) -> Frame | None:
    """The next frame; `None` if the subscriber is closed."""
    timeout = subscriber.timeout
    deadline = None if timeout is None else time.monotonic() + timeout
    while not subscriber.closed:
        left = _MAX_WAIT if deadline is None else min(_MAX_WAIT, deadline - time.monotonic())
        if left <= 0:
            return subscriber.next(timeout=0)  # raises, with the reason
        try:
            frame = await asyncio.to_thread(subscriber._poll, left)
        except Exception:
            if subscriber.closed:
                return None
            raise
        if frame is not None:
            return frame
    return None
