"""`evaluate --sets`: the accuracy and robustness of a model file, set by set."""

import argparse
import json
import sys
from collections.abc import Iterable

import numpy as np
from tqdm import tqdm

from nunet_models.data.sets.mixture import Mixture, open_dataset_list
from nunet_models.errors import ConfigError
from nunet_models.evaluation.predict import Predictor
from nunet_models.evaluation.sets import set_metrics
from nunet_models.evaluation.sparsification import KEPT
from nunet_models.zoo.spec import Camera

Columns = tuple[tuple[str, str, str], ...]

COLUMNS: Columns = (
    ("images", "images", "{:.0f}"),
    ("AbsRel", "abs_rel", "{:.3f}"),
    ("delta1", "delta1", "{:.3f}"),
    ("AbsRel fit", "abs_rel_median", "{:.3f}"),
    ("delta1 fit", "delta1_median", "{:.3f}"),
    ("factor", "factor", "{:.2f}"),
    ("constant", "baseline_abs_rel", "{:.3f}"),
    ("left", "border_left_ratio", "{:.2f}"),
    ("right", "border_right_ratio", "{:.2f}"),
    ("top", "border_top_ratio", "{:.2f}"),
    ("bottom", "border_bottom_ratio", "{:.2f}"),
    ("noise mm", "noise_mm", "{:.1f}"),
    ("rough mm", "roughness_mm", "{:.1f}"),
    ("turned 20", "turn20_ratio", "{:.2f}"),
)
"""Title, metric and format of each column. `factor` is the median of truth over prediction,
`constant` the AbsRel of one depth for every pixel, and borders are relative to what is inside."""
CONFIDENCE_COLUMNS: Columns = (
    ("AbsRel", "abs_rel", "{:.3f}"),
    *((f"certain {percent} %", f"certain_{percent}", "{:.3f}") for percent in KEPT),
    *((f"oracle {percent} %", f"oracle_{percent}", "{:.3f}") for percent in KEPT),
    ("area", "area", "{:.3f}"),
    ("random", "area_random", "{:.3f}"),
    ("AbsRel fit", "abs_rel_median", "{:.3f}"),
    *((f"fit {percent} %", f"certain_{percent}_median", "{:.3f}") for percent in KEPT),
    ("area fit", "area_median", "{:.3f}"),
    ("random fit", "area_random_median", "{:.3f}"),
)
"""Of models with a confidence: the AbsRel of all and of the most certain pixels, the same ranked by
the true error, the area between both, and that of a random order; the same after a median fit."""
MEAN = "mean over sets"


def run_sets(options: argparse.Namespace) -> int:
    """Measure the validation sets; prints JSON, and a table on stderr."""
    predictor = Predictor(options.model, threads=options.threads)
    if not predictor.metric:
        raise ConfigError(f"`--sets` compares meters; `{options.model}` gives stretched depth")
    camera = predictor.camera
    train, val = open_dataset_list(options.sets)
    constant = median_depth(train, camera)
    found = {}
    for images in val.sets:
        name = images.entry.name

        def progress(places: Iterable[int], name: str = name) -> Iterable[int]:
            return tqdm(places, desc=name, unit="image", disable=None)

        found[name] = set_metrics(
            images,
            predictor,
            training=camera,
            baseline_m=constant,
            robustness=not options.accuracy_only,
            progress=progress,
        )
    found[MEAN] = mean_over_sets(list(found.values()))
    print(table(found), file=sys.stderr)
    if "area" in found[MEAN]:
        print(f"\n{table(found, CONFIDENCE_COLUMNS)}", file=sys.stderr)
    print(
        json.dumps({"model": options.model.name, "constant_m": constant, "sets": found}, indent=1)
    )
    return 0


def median_depth(train: Mixture, camera: Camera, *, images: int = 100) -> float:
    """Median depth of training images for the training camera, weighed as they are drawn.

    The trivial prediction: the same depth for every pixel.
    """
    medians = []
    for place in train.drawn(images, seed=0, epoch=0):
        image = train[int(place)]
        known = image.pair.depth_m[np.isfinite(image.pair.depth_m)]
        factor = (image.camera.fx / image.camera.width) / (camera.fx / camera.width)
        if known.size:
            medians.append(float(np.median(known)) / factor)
    return float(np.median(medians))


def mean_over_sets(sets: list[dict[str, float]]) -> dict[str, float]:
    """Each metric's mean over the sets that have it, sets equally weighted."""
    names = {name: None for metrics in sets for name in metrics}
    means = {n: float(np.mean([f[n] for f in sets if n in f])) for n in names}
    return {**means, **{n: sum(f[n] for f in sets) for n in ("images", "scenes")}}


def table(found: dict[str, dict[str, float]], columns: Columns = COLUMNS) -> str:
    """The metrics as a Markdown table."""
    rows = [["set", *(title for title, _, _ in columns)]]
    for name, metrics in found.items():
        cells = [form.format(metrics[key]) if key in metrics else "" for _, key, form in columns]
        rows.append([name, *cells])
    lines = [f"| {' | '.join(row)} |" for row in rows]
    return "\n".join([lines[0], "|---" * len(rows[0]) + "|", *lines[1:]])
