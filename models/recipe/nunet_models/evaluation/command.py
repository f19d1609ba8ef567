"""The verb `evaluate`."""

import argparse
import csv
import json
import math
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from tqdm import tqdm

from nunet_models.data.nyu_mat import MAT_LABELS, MAT_SUFFIX
from nunet_models.data.options import add_data_options, open_pairs
from nunet_models.data.pairs import Pair, Pairs
from nunet_models.errors import ConfigError, DataError, OptionError
from nunet_models.evaluation.clip import clip_figures
from nunet_models.evaluation.compare import (
    ROW,
    Comparison,
    Predict,
    Prediction,
    compare,
    mean_image,
    mean_stretched_image,
)
from nunet_models.evaluation.predict import Predictor
from nunet_models.evaluation.protocol import PROTOCOLS


def add_parser(verbs: argparse._SubParsersAction) -> None:
    """Register `evaluate` and its options."""
    parser = verbs.add_parser("evaluate", help="measure a model file against truth")
    parser.add_argument("--model", type=Path, required=True, help="model file, .onnx")
    add_data_options(parser)
    parser.add_argument("--ids", type=Path, required=True, help="pictures to measure on")
    parser.add_argument("--baseline-ids", type=Path, help="training pictures, for the mean image")
    parser.add_argument(
        "--protocol",
        choices=sorted(PROTOCOLS),
        default="full",
        help="whole pictures, or Eigen's crop of NYU Depth V2's (default %(default)s)",
    )
    parser.add_argument(
        "--fx",
        type=float,
        help="focal length in pixels of the pictures; scales depth of networks that give metres, "
        "and of no other",
    )
    parser.add_argument(
        "--clip",
        action="store_true",
        help="the ids are frames of one video, in order, and a network with a memory carries it "
        "from each to the next; for networks that give metres",
    )
    parser.add_argument("--csv", type=Path, help="write a row a picture")
    parser.add_argument("--threads", type=int, default=1)
    parser.set_defaults(carry_out=run)


def run(options: argparse.Namespace) -> int:
    """Carry out `evaluate`; prints JSON."""
    if options.fx is not None and not 0.0 < options.fx < math.inf:
        raise OptionError(
            f"`--fx {options.fx}`; expected a focal length in pixels, more than 0; hint: the first "
            "number of the camera's matrix, at the pictures' size"
        )
    predictor = Predictor(options.model, threads=options.threads)
    pairs = open_pairs(options, options.ids)
    if options.clip:
        _check_clip(options, predictor, pairs)
    if predictor.classes and not pairs.has_labels:
        why = "has no folder `labels` or `label40`"
        if options.data.suffix == MAT_SUFFIX:
            why = f"has no labels to use: {MAT_LABELS}"
        print(f"nunet_models: no label figures: `{options.data}` {why}", file=sys.stderr)
    # First, since its pictures may not fit and a network takes minutes.
    baseline = _baseline(options, pairs) if options.baseline_ids else None
    comparison = compare(
        _progress(pairs, predictor.path.name),
        _predict(predictor, options),
        protocol=PROTOCOLS[options.protocol],
        metric=predictor.metric,
        classes=len(predictor.classes),
    )
    found = {
        "model": options.model.name,
        "architecture": predictor.metadata["nunet.architecture"],
        "epoch": predictor.best_epoch,
        "protocol": options.protocol,
        **comparison.figures(),
    }
    if baseline:
        found["baseline"] = baseline
    if options.clip:
        found["clip"] = clip_figures(_progress(pairs, "as a clip"), _predict(predictor, options))
    if options.csv:
        _write_csv(options.csv, comparison)
    print(json.dumps(found, indent=1))
    return 0


def _check_clip(options: argparse.Namespace, predictor: Predictor, pairs: Pairs) -> None:
    """Refuse to measure a clip without metres or without a second frame."""
    if not predictor.metric:
        raise ConfigError(
            f"`--clip` compares metres, but `{options.model}` gives depth as "
            f"`{predictor.encoding}`; hint: leave `--clip` out, `minmax` holds such a network's "
            "figures"
        )
    if len(pairs) < 2:
        raise DataError(
            f"`{options.ids}` names one picture; expected two frames or more of a video; hint: "
            "leave `--clip` out"
        )


def _progress(pairs: Pairs, what: str) -> Iterator[Pair]:
    for index in tqdm(range(len(pairs)), desc=what, unit="picture", disable=None):
        yield pairs[index]


def _predict(predictor: Predictor, options: argparse.Namespace) -> Predict:
    """What answers for one pass over the pictures: the frames of a video, or pictures alone."""
    answer = predictor.stream() if options.clip else predictor
    fx_px = options.fx
    if fx_px is None or not predictor.metric:  # 0..1 is the same for every camera
        return answer

    def predict(rgb: np.ndarray) -> Prediction:
        prediction = answer(rgb)
        scale = predictor.focal_scale(fx_px, rgb.shape[1])
        return replace(prediction, depth=prediction.depth * np.float32(scale))

    return predict


def _baseline(options: argparse.Namespace, pairs: Pairs) -> dict[str, object]:
    """Figures of the mean image of the training pictures, in metres and stretched."""
    training = open_pairs(options, options.baseline_ids)
    protocol = PROTOCOLS[options.protocol]
    figures = {}
    for metric, image in ((True, mean_image(training)), (False, mean_stretched_image(training))):
        prediction = Prediction(image, labels=None)
        comparison = compare(
            _progress(pairs, "mean image"),
            lambda _, answer=prediction: answer,
            protocol=protocol,
            metric=metric,
            classes=0,
        ).figures()
        for name in ("metrics", "picture_mean") if metric else ("minmax",):
            figures[name] = comparison[name]
    return figures


def _write_csv(path: Path, comparison: Comparison) -> None:
    """A row a picture; a figure that could not be measured is left empty."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, fieldnames=ROW)
        writer.writeheader()
        writer.writerows(comparison.per_picture)
