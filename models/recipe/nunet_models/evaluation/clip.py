"""A video: scale over the whole clip, and flicker from frame to frame."""

from collections.abc import Iterable

import numpy as np

from nunet_models.data.pairs import Pair
from nunet_models.errors import DataError
from nunet_models.evaluation.compare import Predict

STATIC = 0.02  # a pixel whose true depth changes by less than this share counts as static
STRIDE = 4  # pixels are sampled: neighbors are nearly equal


def clip_metrics(pairs: Iterable[Pair], predict: Predict) -> dict[str, float | None]:
    """Metrics of consecutive frames; None where no pixel can be compared.

    `abs_rel_median`: median of `|p - t| / t`. `aligned_abs_rel_median`: the same after one scale
    for the whole clip, the median of `t / p`. `flicker_m`: median of `|p_k - p_(k-1)|` over pixels
    whose truth is static, in meters.

    # Errors
    `DataError` naming a frame of another size than the one before.
    """
    none = np.empty(0, np.float32)
    guesses, truths, flickers = [none], [none], [none]
    before: tuple[np.ndarray, np.ndarray] | None = None
    for pair in pairs:
        p = predict(pair.rgb).depth[::STRIDE, ::STRIDE]
        t = pair.depth_m[::STRIDE, ::STRIDE]
        both = np.isfinite(p) & np.isfinite(t)
        guesses.append(p[both])
        truths.append(t[both])
        if before is not None:
            if t.shape != before[1].shape:
                raise DataError(
                    f"frame `{pair.id}` is of another size than the one before",
                    hint="`--clip` is for the frames of one video",
                )
            static = both & (np.abs(t - before[1]) < STATIC * t)
            flickers.append(np.abs(p - before[0])[static])
        before = (p, t)
    p, t, flicker = (np.concatenate(parts) for parts in (guesses, truths, flickers))
    scale = _median(t / p)
    return {
        "abs_rel_median": _median(np.abs(p - t) / t),
        "aligned_abs_rel_median": None if scale is None else _median(np.abs(p * scale - t) / t),
        "scale": scale,
        "flicker_m": _median(flicker[np.isfinite(flicker)]),
    }


def _median(values: np.ndarray) -> float | None:
    return float(np.median(values)) if values.size else None
