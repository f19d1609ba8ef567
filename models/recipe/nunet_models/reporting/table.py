"""Markdown tables of evaluations, the paper's metrics and the trivial baseline among them."""

import json
from pathlib import Path
from typing import Any

from nunet_models.errors import DataError
from nunet_models.metrics import METRICS
from nunet_models.results import by_name

PAPER_MSE = {
    "unet": 0.0436,
    "wnet": 0.0421,
    "wnet_c": 0.0412,
}
"""Table 1 of "Practical Depth Estimation with Image Segmentation and Serial U-Nets": mean squared
error of depth stretched to 0..1 per image."""

_RMSE = METRICS.index("rmse") + 1
_COLUMNS = (
    *(("metrics", name) for name in METRICS[:_RMSE]),
    ("image_mean", "rmse"),  # papers mean either by it, and the two differ by a tenth
    *(("metrics", name) for name in METRICS[_RMSE:]),
)
"""Group and name of the table's metrics of depth."""


def read_evaluation(path: Path) -> dict[str, Any]:
    """Read a result of `evaluate` or `nunetd eval --json`; its `model` becomes the name alone.

    # Errors
    `DataError` naming a file that is not such a result.
    """
    try:
        values = by_name(json.loads(path.read_text(encoding="utf-8-sig")))
        if values.get("model") is None:
            raise KeyError("model")
        for group, kind in (("minmax", dict), ("metrics", dict | None), ("pictures", int)):
            if not isinstance(values[group], kind):
                raise TypeError(f"`{group}` is `{values[group]}`")
    except (ValueError, AttributeError, KeyError, TypeError) as error:
        raise DataError(
            f"`{path}` is not a result of `evaluate`: {error}",
            hint="`evaluate` and `nunetd eval --json` write such results",
        ) from error
    return values


def metric_table(evaluations: list[dict[str, Any]]) -> str:
    """One row per model with metric depth, then the mean image where an evaluation has it.

    Metrics are pooled over all pixels; the RMSE is given as the mean over images as well.
    """
    names = [f"{n}, mean of images" if group == "image_mean" else n for group, n in _COLUMNS]
    rows = [("model", "images", *names, "mIoU", "accuracy")]
    for found in evaluations:
        if found["metrics"]:
            labels = [_n(found.get("labels", {}).get(name)) for name in ("miou", "accuracy")]
            metrics = _cells(found)
            rows.append((found["model"], str(found["pictures"]), *metrics, *labels))
    for found in evaluations:
        baseline = found.get("baseline") or {}
        if baseline.get("metrics"):
            none = [_n(None)] * 2
            rows.append(("mean image", str(found["pictures"]), *_cells(baseline), *none))
            break
    return markdown(rows)


def paper_table(evaluations: list[dict[str, Any]]) -> str:
    """One row per model: metrics of depth stretched per image, and the paper's value."""
    rows = [("model", "best epoch", "MSE", "RMSE", "paper's MSE")]
    for found in evaluations:
        minmax = found["minmax"]
        paper = PAPER_MSE.get(found.get("architecture", ""))
        epoch = found.get("epoch")
        when = "-" if epoch is None else str(epoch)
        ours = [_n(minmax.get(name)) for name in ("mse", "rmse")]
        rows.append((found["model"], when, *ours, _n(paper)))
    for found in evaluations:
        baseline = (found.get("baseline") or {}).get("minmax")
        if baseline:
            rows.append(("mean image", "-", _n(baseline["mse"]), _n(baseline["rmse"]), _n(None)))
            break
    return markdown(rows)


def markdown(rows: list[tuple[str, ...]]) -> str:
    """Rows of text as a Markdown table, the first one its head."""
    lines = ["| " + " | ".join(row) + " |" for row in rows]
    return "\n".join([lines[0], "|" + "---|" * len(rows[0]), *lines[1:]]) + "\n"


def _cells(found: dict[str, Any]) -> list[str]:
    # Results of earlier versions have no `image_mean`.
    return [_n((found.get(group) or {}).get(name)) for group, name in _COLUMNS]


def _n(value: float | None) -> str:
    return "-" if value is None else f"{value:.4f}"
