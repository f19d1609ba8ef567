"""Losses: each a function of prediction and truth, with its formula and its source.

Depth losses take float `[B, 1, h, w]` prediction and truth of one encoding (meters, or 0..1) and
skip pixels whose truth is NaN; they give a scalar. n counts the pixels that remain; where none
does, every loss is at its minimum and has no gradient. Where a loss works in logarithms,
`log_depth` tensors are its arguments.
"""

import math
from collections.abc import Callable
from functools import partial

import torch
import torch.nn.functional as F

from nunet_models.classes import IGNORE
from nunet_models.errors import OptionError

CLIP = 1e-7
"""Least number of which a logarithm is taken, as in the paper's code (Keras' epsilon)."""

LAMBDA = 0.5
"""Of the scale-invariant loss, in the paper's code."""

GRADIENT_SCALES = 4

SSI_LEAST_PIXELS = 16
SSI_LEAST_SPREAD = 0.01
"""Of inverse depth, 1/m: a flat wall has no shape to be scaled."""


def _valid(predicted: torch.Tensor, truth: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    mask = truth.isfinite()
    return predicted[mask].float(), truth[mask].float()


def _mean(values: torch.Tensor) -> torch.Tensor:
    """Mean, 0 of nothing (torch's own is NaN there)."""
    return values.sum() / max(values.numel(), 1)


def mse(predicted: torch.Tensor, truth: torch.Tensor) -> torch.Tensor:
    """Mean squared error, `sum((p - t)^2) / n`: the paper's own training loss."""
    p, t = _valid(predicted, truth)
    return _mean((p - t).square())


def scale_invariant(
    predicted: torch.Tensor, truth: torch.Tensor, *, lam: float = LAMBDA
) -> torch.Tensor:
    """The paper's scale-invariant loss, `sum(d^2) / n - lam * (sum(d) / n)^2`.

    `d = log(1 + max(p, 1e-7)) - log(1 + max(t, 1e-7))`, one value per image, averaged over the
    batch. From the code of Cantrell, Miller, Morato, "Practical depth estimation with image
    segmentation and serial U-Nets", 2020 (`losses.py`, `sil`, where n is every pixel of an image
    and lambda 0.5), after Eigen, Puhrsch, Fergus, 2014, equation 4, which has `log p - log t`:
    `silog` is of that form. `lam` lies in [0, 1): at 1 the scale of the whole image would not
    count.

    # Errors
    `OptionError` for another `lam`.
    """
    _check_lambda(lam)
    d = predicted.float().clamp(min=CLIP).log1p() - truth.clamp(min=CLIP).log1p()
    return _scale_invariant_of(d, lam).mean()


def _check_lambda(lam: float) -> None:
    if not 0.0 <= lam < 1.0:
        raise OptionError(
            f"lambda of the loss `scale_invariant` is {lam}; expected 0 <= lambda < 1",
            hint=f"the paper's is {LAMBDA}",
        )


def _scale_invariant_of(d: torch.Tensor, lam: float) -> torch.Tensor:
    """`[B, ...]` differences of logarithms, NaN = none, to `[B]`."""
    valid = d.isfinite()
    n = valid.flatten(1).sum(1).clamp(min=1)
    d = d.nan_to_num(0.0).flatten(1)
    return d.square().sum(1) / n - lam * (d.sum(1) / n).square()


def msle(predicted: torch.Tensor, truth: torch.Tensor) -> torch.Tensor:
    """Mean squared logarithmic error, `sum((log(1 + p) - log(1 + t))^2) / n`, as Keras has it.

    Both sides are clipped at 1e-7 first.
    """
    p, t = _valid(predicted, truth)
    return _mean((p.clamp(min=CLIP).log1p() - t.clamp(min=CLIP).log1p()).square())


def berhu(predicted: torch.Tensor, truth: torch.Tensor) -> torch.Tensor:
    """Reverse Huber: `|e|` up to c, `(e^2 + c^2) / (2 c)` beyond, `c = max|e| / 5` of the batch.

    Laina et al., "Deeper depth prediction with fully convolutional residual networks", 2016,
    equation 1.
    """
    p, t = _valid(predicted, truth)
    e = (p - t).abs()
    if not e.numel():
        return _mean(e)
    c = (e.max() / 5.0).detach().clamp(min=CLIP)
    return _mean(torch.where(e <= c, e, (e.square() + c.square()) / (2.0 * c)))


def l1(predicted: torch.Tensor, truth: torch.Tensor) -> torch.Tensor:
    """Mean absolute error, `sum(|p - t|) / n`, in the encoding of its arguments."""
    p, t = _valid(predicted, truth)
    return _mean((p - t).abs())


def silog(log_predicted: torch.Tensor, log_truth: torch.Tensor) -> torch.Tensor:
    """Square root of the scale-invariant error with lambda 0.85, of log depths, per image.

    Lee et al., "From big to small: multi-scale local planar guidance", 2019, equation 5, without
    its factor of 10.
    """
    error = _scale_invariant_of(log_predicted.float() - log_truth, 0.85)
    return error.clamp(min=CLIP).sqrt().mean()


def gradient_matching(log_predicted: torch.Tensor, log_truth: torch.Tensor) -> torch.Tensor:
    """Mean over 4 scales of `(sum |dx d| + sum |dy d|) / n`, `d = log p - log t`.

    Li and Snavely, "MegaDepth", 2018, equation 4 (there summed over scales, and n is of pixels;
    here n is of the differences that are known). Scale k takes every 2^k-th pixel.
    """
    d = log_predicted.float() - log_truth
    total = d.new_zeros(())
    for k in range(GRADIENT_SCALES):
        scaled = d[..., :: 2**k, :: 2**k]
        steps = (scaled.diff(dim=-1), scaled.diff(dim=-2))
        known = sum(step.isfinite().sum() for step in steps).clamp(min=1)
        total = total + sum(step.nan_to_num(0.0).abs().sum() for step in steps) / known
    return total / GRADIENT_SCALES


def expected_error(
    log_error: torch.Tensor, log_predicted: torch.Tensor, truth: torch.Tensor
) -> torch.Tensor:
    """Mean of `r exp(-s) + s`, least where `exp(s)` is the expected relative error.

    The negative logarithm of Laplace's density of scale `exp(s)` (Kendall and Gal, "What
    uncertainties do we need in Bayesian deep learning for computer vision?", 2017), of
    `r = |d - median(d)|`, `d = log p - log t`. The median is the image's own error of scale. With
    it in `r`, the head learns to tell scenes apart instead of pixels, and ranks pixels worse, also
    by their error with the scale. `log_error` may be smaller than depth; it is then resized
    bilinearly. It alone gets a gradient.
    """
    size = truth.shape[2:]
    s = F.interpolate(log_error.float(), size=size, mode="bilinear", align_corners=False)
    d = log_predicted.detach().float() - truth.clamp(min=CLIP).log()
    total, pixels = s.sum() * 0.0, 0
    for of_image, found in zip(d, s, strict=True):
        known = of_image.isfinite()
        if not known.any():
            continue
        r = (of_image[known] - of_image[known].median()).abs()
        total = total + (r * (-found[known]).exp() + found[known]).sum()
        pixels += r.numel()
    return total / max(pixels, 1)


def scale_shift_invariant(log_predicted: torch.Tensor, log_truth: torch.Tensor) -> torch.Tensor:
    """Mean absolute difference of inverse depths, each shifted by its median and scaled to 1.

    Ranftl et al., "Toward robust monocular depth estimation", 2020, equations 6 and 7: an image's
    own scale and shift do not count, so that images of unknown scale can be used. The scale is
    the mean absolute difference from the median. Images with fewer than 16 known pixels are
    skipped.
    """
    losses = []
    for p, t in zip((-log_predicted.float()).exp(), (-log_truth).exp(), strict=True):
        known = t.isfinite()
        if known.sum() < SSI_LEAST_PIXELS:
            continue
        losses.append((_unit_spread(p[known]) - _unit_spread(t[known])).abs().mean())
    return torch.stack(losses).mean() if losses else log_predicted.float().sum() * 0.0


def _unit_spread(values: torch.Tensor) -> torch.Tensor:
    centered = values - values.median()
    return centered / centered.abs().mean().clamp(min=SSI_LEAST_SPREAD)


def cross_entropy(
    logits: torch.Tensor,
    labels: torch.Tensor,
    *,
    weights: torch.Tensor | None = None,
    smoothing: float = 0.0,
) -> torch.Tensor:
    """Cross-entropy of logits `[B, C, h, w]` against labels int64 `[B, h, w]`, `IGNORE` skipped.

    `weights` `[C]` weighs classes; `smoothing` gives that share of the truth to all classes alike
    (Szegedy et al., "Rethinking the Inception architecture", 2016).
    """
    if not (labels != IGNORE).any():
        return logits.float().sum() * 0.0
    return F.cross_entropy(
        logits.float(), labels, weight=weights, ignore_index=IGNORE, label_smoothing=smoothing
    )


Loss = Callable[[torch.Tensor, torch.Tensor], torch.Tensor]

IN_LINEAR: dict[str, Loss] = {
    "mse": mse,
    "scale_invariant": scale_invariant,
    "msle": msle,
    "berhu": berhu,
    "l1": l1,
}
"""Losses of depth in the graph's encoding."""

IN_LOG: dict[str, Loss] = {
    "l1_log": l1,
    "berhu_log": berhu,
    "silog": silog,
    "gradient": gradient_matching,
    "ssi": scale_shift_invariant,
}
"""Losses of the logarithm of depth."""


def parse_loss(text: str) -> dict[str, float]:
    """`"l1_log=1,silog=0.5"` to weights by name; a name alone weighs 1.

    `scale_invariant:0.85=1` is the scale-invariant loss with a lambda of its own.

    # Errors
    `OptionError` for an unknown name, one named twice, a weight that is not a number above 0, or a
    lambda outside [0, 1).
    """
    weights = {}
    for part in text.split(","):
        name, _, weight = part.strip().partition("=")
        _loss_of(name)
        if name in weights:
            raise OptionError(f"`--loss {text}` names `{name}` twice", hint="one weight for it")
        weights[name] = _weight(weight, name) if weight else 1.0
    return weights


def _weight(text: str, name: str) -> float:
    try:
        weight = float(text)
    except ValueError as error:
        raise OptionError(f"weight `{text}` of loss `{name}` is not a number") from error
    if not 0.0 < weight < math.inf:
        raise OptionError(
            f"weight `{text}` of loss `{name}`; expected more than 0",
            hint="remove a loss that should not count",
        )
    return weight


def _loss_of(text: str) -> tuple[Loss, bool]:
    """A loss by its name, with its lambda behind a colon, and whether it works in logarithms."""
    name, colon, number = text.partition(":")
    if name not in IN_LINEAR and name not in IN_LOG:
        known = ", ".join([*IN_LINEAR, *IN_LOG])
        raise OptionError(f"no loss `{name}`", hint=f"one of {known}")
    if not colon:
        return (IN_LINEAR.get(name) or IN_LOG[name]), name in IN_LOG
    if name != "scale_invariant":
        raise OptionError(
            f"loss `{name}` has no lambda, got `{text}`", hint="`scale_invariant` alone has one"
        )
    try:
        lam = float(number)
    except ValueError as error:
        raise OptionError(
            f"lambda `{number}` of loss `{name}` is not a number", hint=f"`{name}:{LAMBDA}=1`"
        ) from error
    _check_lambda(lam)
    return partial(scale_invariant, lam=lam), False


def weighted_depth_loss(
    raw: torch.Tensor, truth: torch.Tensor, *, weights: dict[str, float], log_network: bool
) -> torch.Tensor:
    """Sum of weighted depth losses of a network's raw numbers `[B, 1, h, w]`.

    `truth` is in the graph's encoding, NaN = none; `log_network` says that `raw` is its logarithm.
    """
    raw = raw.float()
    linear = raw.exp() if log_network else raw
    log_raw = raw if log_network else raw.clamp(min=CLIP).log()
    log_truth = truth.clamp(min=CLIP).log()
    total = raw.new_zeros(())
    for name, weight in weights.items():
        loss, in_log = _loss_of(name)
        total = total + weight * (loss(log_raw, log_truth) if in_log else loss(linear, truth))
    return total
