"""What came of the rooms or videos that were asked for. Needs no Blender."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field

from nunet_models.errors import RenderError
from nunet_models.rendering.folder import RoomsFolder

LOG = logging.getLogger(__name__)
MAX_ROOMS = 100_000
"""Rooms are numbered with five digits."""
NAMES_SHOWN = 5


@dataclass
class Outcome:
    """Rooms that are complete, images that this run wrote, and rooms that gave none."""

    complete: int = 0
    images: int = 0
    empty: list[str] = field(default_factory=list)


def render_missing(
    names: Iterable[str], folder: RoomsFolder, render: Callable[[str], int]
) -> Outcome:
    """Render the rooms that are not complete yet; `render` gives the number of their images."""
    outcome = Outcome()
    for name in names:
        if not folder.is_complete(name):
            count = render(name)
            if count == 0:
                outcome.empty.append(name)
                continue
            outcome.images += count
        outcome.complete += 1
    return outcome


def require_all(outcome: Outcome, *, option: str, lacks: str, start: int) -> None:
    """Log the counts; refuse to call less than was asked for a success.

    `option` is `--rooms` or `--videos`, `lacks` what was not found in an empty room, and `start`
    the number of the first room.

    # Errors
    `RenderError` with the names of the empty rooms.
    """
    empty, asked = len(outcome.empty), outcome.complete + len(outcome.empty)
    unit = option.removeprefix("--")
    LOG.info("%d of %d %s complete, %d new images", outcome.complete, asked, unit, outcome.images)
    if not empty:
        return
    shown = ", ".join(f"`{name}`" for name in outcome.empty[:NAMES_SHOWN])
    more = " ..." if empty > NAMES_SHOWN else ""
    following = start + asked
    raise RenderError(
        f"{outcome.complete} of {asked} {unit} are complete; no {lacks} was found for "
        f"{empty}: {shown}{more}",
        hint=f"`{option} {empty} --start {following}` renders as many others"
        if following + empty <= MAX_ROOMS
        else None,
    )
