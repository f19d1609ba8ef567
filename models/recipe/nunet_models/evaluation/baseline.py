"""The trivial baseline: one depth image as the prediction for every image."""

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
"""`of` for the mean image of `--baseline-ids`, as in `nunetd eval`."""
OF_FILE = "baseline-file"
"""`of` for a saved mean image."""

Again = Callable[[], Iterable[Pair]]
"""Iterates over the images to measure, from the first."""


def named_baseline(
    training: Pairs, images: Again, *, protocol: Protocol, save: Path | None = None
) -> dict[str, object]:
    """Metrics of the mean image of `training`, in meters and stretched; saves the former."""
    image = mean_image(training)
    if save is not None:
        write_mean_image(save, image)
    stretched = mean_stretched_image(training)
    return {
        "of": OF_NAMED,
        **_metric_figures(image, images, protocol),
        "minmax": _figures(stretched, images, protocol, metric=False)["minmax"],
    }


def kept_baseline(path: Path, images: Again, *, protocol: Protocol) -> dict[str, object]:
    """The same for a saved mean image, in meters; it is stretched like a prediction."""
    image = read_mean_image(path)
    return {"of": OF_FILE, **_metric_figures(image, images, protocol, "minmax")}


def write_mean_image(path: Path, image: np.ndarray) -> None:
    """Save a mean image, float32 `[H, W]`, meters, under exactly this name."""
    with path.open("wb") as file:
        np.save(file, image, allow_pickle=False)


def read_mean_image(path: Path) -> np.ndarray:
    """Read a mean image: float32 `[H, W]`, meters.

    # Errors
    `DataError` naming a file that is missing or not a mean image.
    """
    expected = "a mean image in meters, float32 [H, W], as `--save-baseline` writes it"
    if not path.is_file():
        raise DataError(f"`{path}` is missing; expected {expected}")
    try:
        image = np.load(path, allow_pickle=False)
    except (OSError, ValueError, EOFError) as error:
        raise DataError(f"`{path}` is not a .npy file: {error}; expected {expected}") from error
    if not isinstance(image, np.ndarray) or image.ndim != 2 or image.dtype.kind != "f":
        what = f"{image.dtype} {list(image.shape)}" if isinstance(image, np.ndarray) else "several"
        raise DataError(f"`{path}` holds {what}; expected {expected}")
    if not (np.isfinite(image) & (image > 0)).all():
        raise DataError(
            f"`{path}` has pixels without depth; expected {expected}, with more than 0 in each"
        )
    return image.astype(np.float32)


def _metric_figures(
    image: np.ndarray, images: Again, protocol: Protocol, *more: str
) -> dict[str, object]:
    found = _figures(image, images, protocol, metric=True)
    return {name: found[name] for name in ("metrics", "image_mean", *more)}


def _figures(
    image: np.ndarray, images: Again, protocol: Protocol, *, metric: bool
) -> dict[str, object]:
    prediction = Prediction(image, labels=None)
    return compare(
        images(), lambda _: prediction, protocol=protocol, metric=metric, classes=0
    ).values()
