"""The trivial baseline: one depth image for all pictures, whatever they show."""

from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np

from nunet_models.data.pairs import Pair, Pairs
from nunet_models.errors import DataError
from nunet_models.evaluation.compare import (
    Prediction,
    compare,
    mean_image,
    mean_stretched_image,
)
from nunet_models.evaluation.protocol import Protocol

OF_NAMED = "baseline-ids"
"""Of the mean image of pictures that the user named, as `nunetd eval` calls it."""
OF_FILE = "baseline-file"
"""Of a mean image that was kept."""

Again = Callable[[], Iterable[Pair]]
"""Gives the pictures to measure on once more, from the first."""


def named_baseline(
    training: Pairs, pictures: Again, *, protocol: Protocol, save: Path | None = None
) -> dict[str, object]:
    """Figures of the mean image of `training`, in metres and stretched; `save` keeps the first."""
    image = mean_image(training)
    if save is not None:
        write_mean_image(save, image)
    stretched = mean_stretched_image(training)
    return {
        "of": OF_NAMED,
        **_metric_figures(image, pictures, protocol),
        "minmax": _figures(stretched, pictures, protocol, metric=False)["minmax"],
    }


def kept_baseline(path: Path, pictures: Again, *, protocol: Protocol) -> dict[str, object]:
    """The same of a mean image that was kept: it is in metres, and stretched as predictions are."""
    image = read_mean_image(path)
    return {"of": OF_FILE, **_metric_figures(image, pictures, protocol, "minmax")}


def write_mean_image(path: Path, image: np.ndarray) -> None:
    """Keep a mean image, float32 `[H, W]`, metres, under this very name."""
    with path.open("wb") as file:
        np.save(file, image, allow_pickle=False)


def read_mean_image(path: Path) -> np.ndarray:
    """A mean image that was kept, or that others made: float32 `[H, W]`, metres.

    # Errors
    `DataError` naming a file that is missing or none.
    """
    expected = "a mean image in metres, float32 [H, W], as `--save-baseline` writes it"
    if not path.is_file():
        raise DataError(f"`{path}` is missing; expected {expected}")
    try:
        image = np.load(path, allow_pickle=False)
    except (OSError, ValueError, EOFError) as error:
        raise DataError(f"`{path}` is no .npy file: {error}; expected {expected}") from error
    if not isinstance(image, np.ndarray) or image.ndim != 2 or image.dtype.kind != "f":
        what = f"{image.dtype} {list(image.shape)}" if isinstance(image, np.ndarray) else "several"
        raise DataError(f"`{path}` holds {what}; expected {expected}")
    if not (np.isfinite(image) & (image > 0)).all():
        raise DataError(
            f"`{path}` has pixels without depth; expected {expected}, with more than 0 in each"
        )
    return image.astype(np.float32)


def _metric_figures(
    image: np.ndarray, pictures: Again, protocol: Protocol, *more: str
) -> dict[str, object]:
    found = _figures(image, pictures, protocol, metric=True)
    return {name: found[name] for name in ("metrics", "picture_mean", *more)}


def _figures(
    image: np.ndarray, pictures: Again, protocol: Protocol, *, metric: bool
) -> dict[str, object]:
    prediction = Prediction(image, labels=None)
    return compare(
        pictures(), lambda _: prediction, protocol=protocol, metric=metric, classes=0
    ).figures()
