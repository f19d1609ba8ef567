"""Predictions against truth over a collection of pairs, and the trivial baseline."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field

import numpy as np

from nunet_models.data.pairs import Pair, Pairs
from nunet_models.errors import DataError
from nunet_models.evaluation.protocol import MIN_DEPTH_M, Protocol
from nunet_models.evaluation.sparsification import MEDIAN, of_depth
from nunet_models.metrics import METRICS, DepthMetrics, LabelMetrics, image_mean

MINMAX_METRICS = ("mse", "rmse")  # metrics of stretched depth in the paper
ROW = ("id", *METRICS, *(f"minmax_{name}" for name in MINMAX_METRICS))
"""Columns of a row an image, those of the `images.csv` that `nunetd eval --out DIR` writes."""


@dataclass(frozen=True)
class Prediction:
    """Depth float32 `[H, W]` in the model's unit (NaN = none); labels uint8 `[H, W]` or None.

    `confidence` is uint8 `[H, W]`, 255 = certain, or None where the model has none.
    """

    depth: np.ndarray
    labels: np.ndarray | None
    confidence: np.ndarray | None = None


Predict = Callable[[np.ndarray], Prediction]


@dataclass
class Comparison:
    """Metrics gathered per image.

    `depth` is meters under the protocol; `minmax` compares whole images, each stretched from
    its nearest to its farthest point, as the paper did; `per_image` has one row per image.
    `beyond` counts pixels whose true depth in meters is too near or too far to be compared.
    `sparsity` has the sparsification of each image that has a confidence.
    """

    protocol: Protocol
    metric: bool
    labels: LabelMetrics | None = None
    depth: DepthMetrics = field(default_factory=DepthMetrics)
    minmax: DepthMetrics = field(default_factory=DepthMetrics)
    beyond: int = 0
    sparsity: list[dict[str, float]] = field(default_factory=list)
    per_image: list[dict[str, float | str]] = field(default_factory=list)

    def add(self, pair: Pair, prediction: Prediction) -> None:
        """Count one image.

        # Errors
        `DataError` naming an image of another size than the prediction or the protocol's.
        """
        if prediction.depth.shape != pair.depth_m.shape:
            raise DataError(
                f"image `{pair.id}` is {pair.depth_m.shape}; expected "
                f"{prediction.depth.shape}, the size of what it is compared with",
                hint="a mean image is for images of its own size",
            )
        try:
            metrics = self.add_depth(prediction.depth, pair.depth_m, prediction.confidence)
        except DataError as error:
            raise DataError(f"image `{pair.id}`: {error}", hint=error.hint) from error
        if self.labels is not None and pair.labels is not None and prediction.labels is not None:
            self.labels.add(prediction.labels, pair.labels)
        self.per_image.append({"id": pair.id, **metrics})

    def add_depth(
        self, predicted: np.ndarray, truth_m: np.ndarray, confidence: np.ndarray | None = None
    ) -> dict[str, float]:
        """Count the depth of one image, all `[H, W]`; returns this image's own metrics.

        They are empty if the image has no depth, and without meters if the network is not metric.
        """
        alone, alone_minmax = DepthMetrics(), DepthMetrics()
        if self.metric:
            alone.add(self.protocol.predicted(predicted), self.protocol.truth(truth_m))
            self.depth.merge(alone)
            self.beyond += self.protocol.beyond(truth_m)
            if confidence is not None:
                self._add_confidence(predicted, truth_m, confidence)
        known = np.isfinite(truth_m)
        guess = stretched(predicted, known) if self.metric else predicted.clip(0.0, 1.0)
        alone_minmax.add(_positive(guess), _positive(stretched(truth_m, known)))
        self.minmax.merge(alone_minmax)
        minmax = alone_minmax.values()
        return alone.values() | {f"minmax_{k}": minmax[k] for k in MINMAX_METRICS if minmax}

    def _add_confidence(
        self, predicted: np.ndarray, truth_m: np.ndarray, confidence: np.ndarray
    ) -> None:
        p, t = self.protocol.predicted(predicted), self.protocol.truth(truth_m)
        both = np.isfinite(p) & np.isfinite(t)
        found = of_depth(p[both], t[both], self.protocol.cropped(confidence)[both])
        if found:
            self.sparsity.append(found)

    def sparsification(self) -> dict[str, float]:
        """Mean over images of the metrics of `evaluation.sparsification`."""
        return {k: float(np.mean([of[k] for of in self.sparsity])) for k in self.sparsity[0]}

    @property
    def counted(self) -> DepthMetrics:
        """The main metrics: in meters if the network outputs them, else of stretched depth."""
        return self.depth if self.metric else self.minmax

    @property
    def known(self) -> int:
        """Pixels with truth, those `beyond` too, that the protocol's crop leaves."""
        return self.beyond + self.counted.pixels + self.counted.missing

    def values(self) -> dict[str, object]:
        """All metrics, in the structure of `nunetd eval --json`."""
        minmax = self.minmax.values()
        counted = self.counted
        found: dict[str, object] = {
            "pictures": len(self.per_image),
            "pixels": counted.pixels,
            "pixels_without_prediction": counted.missing,
            "pixels_beyond": self.beyond,
            "metrics": self.depth.values(),
            "image_mean": image_mean(self.per_image),
            "minmax": {name: minmax[name] for name in MINMAX_METRICS} if minmax else {},
        }
        if self.sparsity:
            means = self.sparsification()
            fit = {name: means.pop(f"{name}{MEDIAN}") for name in list(means) if MEDIAN not in name}
            found["sparsification"] = {"images": len(self.sparsity), **means, "median_fit": fit}
        if self.labels is not None:
            labels = self.labels.values()
            found["labels"] = {**labels, "pixels": self.labels.pixels} if labels else {}
        return found


def stretched(depth: np.ndarray, known: np.ndarray) -> np.ndarray:
    """Depth `[H, W]` stretched to 0..1 over its `known` pixels, NaN elsewhere."""
    values = depth[known]
    if not np.isfinite(values).any():
        return np.full_like(depth, np.nan)
    nearest, farthest = np.nanmin(values), np.nanmax(values)
    return np.where(known, (depth - nearest) / max(farthest - nearest, 1e-6), np.nan)


def _positive(stretched_depth: np.ndarray) -> np.ndarray:
    """Replace 0, which has no logarithm, by a tiny value; squared errors do not change."""
    return np.clip(stretched_depth, 1e-7, None)


def compare(
    pairs: Iterable[Pair], predict: Predict, *, protocol: Protocol, metric: bool, classes: int
) -> Comparison:
    """Predict every pair and gather the metrics; `classes` 0 leaves labels out.

    # Errors
    `DataError` when meters are compared and no pair has truth within the protocol's cap.
    """
    comparison = Comparison(protocol, metric, LabelMetrics(classes) if classes else None)
    for pair in pairs:
        comparison.add(pair, predict(pair.rgb))
    if metric and not comparison.depth.pixels + comparison.depth.missing:
        raise DataError(
            f"no true depth is between {MIN_DEPTH_M} and {protocol.cap_m} m, the range that is "
            "compared",
            hint="`--depth-scale METERS` sets the unit of the depth images",
        )
    return comparison


def mean_image(pairs: Pairs) -> np.ndarray:
    """Mean depth of every pixel over `pairs`, float32 meters `[H, W]`: the trivial prediction.

    # Errors
    `DataError` naming an image of another size than the first.
    """
    total, count = 0.0, 0
    for depth in _depths(pairs):
        total = total + np.nan_to_num(depth.astype(np.float64))
        count = count + np.isfinite(depth)
    known = np.maximum(count, 1)
    overall = np.sum(total) / max(1, np.sum(count))
    return np.where(count > 0, total / known, overall).astype(np.float32)


def mean_stretched_image(pairs: Pairs) -> np.ndarray:
    """Mean of depth stretched to 0..1 per image, `[H, W]`: the paper's trivial prediction."""
    total, count = 0.0, 0
    for depth in _depths(pairs):
        known = np.isfinite(depth)
        total = total + np.nan_to_num(stretched(depth, known).astype(np.float64))
        count = count + known
    return np.where(count > 0, total / np.maximum(count, 1), 0.5).astype(np.float32)


def _depths(pairs: Pairs) -> Iterator[np.ndarray]:
    """Depth of every pair, all of one size."""
    first: tuple[int, ...] | None = None
    for index in range(len(pairs)):
        pair = pairs[index]
        first = first or pair.depth_m.shape
        if pair.depth_m.shape != first:
            raise DataError(
                f"image `{pair.id}` is {pair.depth_m.shape}, the first one {first}",
                hint="a mean image needs images of one size",
            )
        yield pair.depth_m
