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
from nunet_models.data.options import (
    add_data_options,
    add_sets_option,
    check_sets_or_data,
    open_pairs,
)
from nunet_models.data.pairs import Pair, Pairs
from nunet_models.errors import ConfigError, DataError, OptionError
from nunet_models.evaluation.baseline import kept_baseline, named_baseline
from nunet_models.evaluation.clip import clip_figures
from nunet_models.evaluation.compare import (
    ROW,
    Comparison,
    Predict,
    Prediction,
    compare,
)
from nunet_models.evaluation.predict import Predictor
from nunet_models.evaluation.protocol import MIN_DEPTH_M, PROTOCOLS
from nunet_models.evaluation.sets_command import run_sets

MUCH_BEYOND = 0.05  # of the truth; rooms of NYU Depth V2 and 7-Scenes have next to none there


def add_parser(verbs: argparse._SubParsersAction) -> None:
    """Register `evaluate` and its options."""
    parser = verbs.add_parser("evaluate", help="measure a model file against truth")
    parser.add_argument("--model", type=Path, required=True, help="model file, .onnx")
    add_data_options(parser, required=False)
    parser.add_argument("--ids", type=Path, help="images of `--data` to measure on")
    add_sets_option(parser)
    parser.add_argument(
        "--accuracy-only",
        action="store_true",
        help="of `--sets`: no border, noise, roughness and rotation, a fifth of the time",
    )
    baseline = parser.add_mutually_exclusive_group()
    baseline.add_argument(
        "--baseline-ids", type=Path, help="training pictures of this data, for the mean image"
    )
    baseline.add_argument(
        "--baseline",
        type=Path,
        metavar="FILE.npy",
        help="the mean image of other data (float32 [H, W], metres), of these pictures' size",
    )
    parser.add_argument(
        "--save-baseline",
        type=Path,
        metavar="FILE.npy",
        help="keep the mean image of --baseline-ids",
    )
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
    check_sets_or_data(options, "ids")
    if options.sets is not None:
        return run_sets(options)
    if options.fx is not None and not 0.0 < options.fx < math.inf:
        raise OptionError(
            f"`--fx {options.fx}`; expected a focal length in pixels, more than 0; hint: the first "
            "number of the camera's matrix, at the pictures' size"
        )
    if options.save_baseline is not None and options.baseline_ids is None:
        raise OptionError(
            f"`--save-baseline {options.save_baseline}` keeps the mean image of `--baseline-ids`, "
            "which are not given; hint: `--baseline-ids FILE` names training pictures"
        )
    predictor = Predictor(options.model, threads=options.threads)
    pairs = open_pairs(options, options.ids)
    if options.clip:
        _check_clip(options, predictor, pairs)
    if predictor.classes and not pairs.has_labels:
        why = "has no folder `labels` or `label40`"
        if options.data.suffix == MAT_SUFFIX:
            why = f"has no labels of its own: {MAT_LABELS}"
        print(f"nunet_models: no label figures: `{options.data}` {why}", file=sys.stderr)
    # First, since its pictures may not fit and a network takes minutes.
    baseline = _baseline(options, pairs)
    comparison = compare(
        _progress(pairs, predictor.path.name),
        _predict(predictor, options),
        protocol=PROTOCOLS[options.protocol],
        metric=predictor.metric,
        classes=len(predictor.classes),
    )
    _say_beyond(comparison)
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


def _say_beyond(comparison: Comparison) -> None:
    """Tell of truth that cannot be compared where it is so much that its unit may be wrong."""
    beyond, known = comparison.beyond, comparison.known
    if beyond <= MUCH_BEYOND * known:
        return
    print(
        f"nunet_models: {100 * beyond / known:.1f} % of the true depth ({beyond} of {known} "
        f"pixels) is not between {MIN_DEPTH_M} and {comparison.protocol.cap_m} m and so not "
        "compared; hint: `--depth-scale METRES` says what a unit of the depth pictures is",
        file=sys.stderr,
    )


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


def _baseline(options: argparse.Namespace, pairs: Pairs) -> dict[str, object] | None:
    """Figures of a mean image, that of training pictures or one that was kept."""
    protocol = PROTOCOLS[options.protocol]

    def pictures() -> Iterator[Pair]:
        return _progress(pairs, "mean image")

    if options.baseline is not None:
        return kept_baseline(options.baseline, pictures, protocol=protocol)
    if options.baseline_ids is None:
        return None
    training = open_pairs(options, options.baseline_ids)
    return named_baseline(training, pictures, protocol=protocol, save=options.save_baseline)


def _write_csv(path: Path, comparison: Comparison) -> None:
    """A row a picture; a figure that could not be measured is left empty."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, fieldnames=ROW)
        writer.writeheader()
        writer.writerows(comparison.per_picture)
