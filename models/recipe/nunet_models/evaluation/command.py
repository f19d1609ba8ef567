"""The subcommand `evaluate`."""

import argparse
import json
import math
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from tqdm import tqdm

from nunet_models.data.nyu_mat import MAT_LABELS, MAT_LABELS_HINT, MAT_SUFFIX
from nunet_models.data.options import (
    add_data_options,
    add_sets_option,
    check_sets_or_data,
    open_pairs,
)
from nunet_models.data.pairs import Pair, Pairs
from nunet_models.errors import ConfigError, DataError, OptionError, with_hint
from nunet_models.evaluation.baseline import kept_baseline, named_baseline
from nunet_models.evaluation.clip import clip_metrics
from nunet_models.evaluation.compare import (
    ROW,
    Comparison,
    Predict,
    Prediction,
    compare,
)
from nunet_models.evaluation.flat_command import run_flat_images
from nunet_models.evaluation.predict import Predictor
from nunet_models.evaluation.protocol import MIN_DEPTH_M, PROTOCOLS
from nunet_models.evaluation.sets_command import run_sets
from nunet_models.files import check_output_file, write_table

MUCH_BEYOND = 0.05  # of the truth; rooms of NYU Depth V2 and 7-Scenes have next to none there


def add_parser(subparsers: argparse._SubParsersAction) -> None:
    """Register `evaluate` and its options."""
    parser = subparsers.add_parser("evaluate", help="measure a model file against truth")
    parser.add_argument("--model", type=Path, required=True, help="model file, .onnx")
    add_data_options(parser, required=False)
    parser.add_argument("--ids", type=Path, help="images of `--data` to measure on")
    add_sets_option(parser)
    parser.add_argument(
        "--accuracy-only",
        action="store_true",
        help="with `--sets`: skip border, noise, roughness and rotation, in a fifth of the time",
    )
    parser.add_argument(
        "--flat-images",
        type=Path,
        metavar="DIR",
        help="folder of `render --flat-images`: measure the relief on flat panes, no other metric",
    )
    _add_baseline_options(parser)
    parser.add_argument(
        "--protocol",
        choices=sorted(PROTOCOLS),
        default="full",
        help="whole images, or Eigen's crop of NYU Depth V2's (default %(default)s)",
    )
    parser.add_argument(
        "--fx",
        type=float,
        help="focal length of the images in pixels; scales the depth of models with metric depth",
    )
    parser.add_argument(
        "--clip",
        action="store_true",
        help="the ids are frames of one video, in order; a recurrent network carries its state "
        "from each to the next; for models with metric depth only",
    )
    parser.add_argument("--csv", type=Path, help="write one row per image")
    parser.add_argument("--threads", type=int, default=1)
    parser.set_defaults(carry_out=run)


def _add_baseline_options(parser: argparse.ArgumentParser) -> None:
    """Add where the mean image comes from, and where it is saved."""
    baseline = parser.add_mutually_exclusive_group()
    baseline.add_argument(
        "--baseline-ids", type=Path, help="training images of this data, for the mean image"
    )
    baseline.add_argument(
        "--baseline",
        type=Path,
        metavar="FILE.npy",
        help="the mean image of other data (float32 [H, W], meters), of these images' size",
    )
    parser.add_argument(
        "--save-baseline",
        type=Path,
        metavar="FILE.npy",
        help="save the mean image of --baseline-ids",
    )


def run(options: argparse.Namespace) -> int:
    """Carry out `evaluate`; prints JSON."""
    if options.flat_images is not None:
        return run_flat_images(options)
    check_sets_or_data(options, "ids")
    if options.sets is not None:
        _check_alone(options)
        return run_sets(options)
    _check_options(options)
    predictor = Predictor(options.model, threads=options.threads)
    if options.fx is not None and predictor.metric:
        predictor.focal_scale(options.fx, 1)  # fails now if the model states no camera
    pairs = open_pairs(options, options.ids)
    if options.clip:
        _check_clip(options, predictor, pairs)
    _warn_no_labels(options, predictor, pairs)
    # First, because it fails at once on images of another size, while the network takes minutes.
    baseline = _baseline(options, pairs)
    comparison = compare(
        _progress(pairs, predictor.path.name),
        _predict(predictor, options),
        protocol=PROTOCOLS[options.protocol],
        metric=predictor.metric,
        classes=len(predictor.classes),
    )
    _warn_out_of_range(comparison)
    found = {
        "model": options.model.name,
        "architecture": predictor.architecture,
        "epoch": predictor.best_epoch,
        "protocol": options.protocol,
        **comparison.values(),
    }
    if baseline:
        found["baseline"] = baseline
    if options.clip:
        found["clip"] = clip_metrics(_progress(pairs, "as a clip"), _predict(predictor, options))
    if options.csv:
        write_table(options.csv, ROW, comparison.per_image)
    print(json.dumps(found, indent=1))
    return 0


def _check_alone(options: argparse.Namespace) -> None:
    """Refuse options of one folder's images that a dataset list does not use."""
    given = {
        "--fx": options.fx,
        "--csv": options.csv,
        "--baseline": options.baseline,
        "--baseline-ids": options.baseline_ids,
        "--save-baseline": options.save_baseline,
        "--clip": options.clip or None,
        "--protocol": None if options.protocol == "full" else options.protocol,
    }
    for option, value in given.items():
        if value is not None:
            raise OptionError(
                f"`{option}` cannot be combined with `--sets {options.sets}`",
                hint=f"omit `{option}`",
            )


def _check_options(options: argparse.Namespace) -> None:
    """Refuse values and combinations that make no sense, before any work."""
    if options.fx is not None and not 0.0 < options.fx < math.inf:
        raise OptionError(
            f"`--fx {options.fx}`; expected a focal length in pixels, more than 0",
            hint="the first number of the camera's matrix, at the images' size",
        )
    if options.save_baseline is not None and options.baseline_ids is None:
        raise OptionError(
            f"`--save-baseline {options.save_baseline}` saves the mean image of `--baseline-ids`, "
            "which is missing",
            hint="`--baseline-ids FILE` names training images",
        )
    check_output_file("--csv", options.csv)
    check_output_file("--save-baseline", options.save_baseline)


def _warn_no_labels(options: argparse.Namespace, predictor: Predictor, pairs: Pairs) -> None:
    """Print why there are no label metrics for a network with labels."""
    if predictor.classes and not pairs.has_labels:
        why, hint = "has no folder `labels` or `label40`", None
        if options.data.suffix == MAT_SUFFIX:
            why, hint = f"has no labels of its own: {MAT_LABELS}", MAT_LABELS_HINT
        message = f"nunet_models: no label metrics: `{options.data}` {why}"
        print(with_hint(message, hint), file=sys.stderr)


def _warn_out_of_range(comparison: Comparison) -> None:
    """Warn if so much truth is out of range that its unit may be wrong."""
    beyond, known = comparison.beyond, comparison.known
    if beyond <= MUCH_BEYOND * known:
        return
    print(
        with_hint(
            f"nunet_models: {100 * beyond / known:.1f} % of the true depth ({beyond} of {known} "
            f"pixels) is not between {MIN_DEPTH_M} and {comparison.protocol.cap_m} m and is not "
            "compared",
            "`--depth-scale METERS` sets the unit of the depth images",
        ),
        file=sys.stderr,
    )


def _check_clip(options: argparse.Namespace, predictor: Predictor, pairs: Pairs) -> None:
    """Refuse to measure a clip without meters or without a second frame."""
    if not predictor.metric:
        raise ConfigError(
            f"`--clip` compares meters, but `{options.model}` outputs depth as "
            f"`{predictor.encoding}`",
            hint="omit `--clip`; `minmax` contains such a network's metrics",
        )
    if len(pairs) < 2:
        raise DataError(
            f"`{options.ids}` names one image; expected two frames or more of a video",
            hint="omit `--clip`",
        )


def _progress(pairs: Pairs, what: str) -> Iterator[Pair]:
    for index in tqdm(range(len(pairs)), desc=what, unit="image", disable=None):
        yield pairs[index]


def _predict(predictor: Predictor, options: argparse.Namespace) -> Predict:
    """The predictor for one pass over the images: frames of a video, or independent images."""
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
    """Metrics of a mean image: of training images, or one that was saved."""
    protocol = PROTOCOLS[options.protocol]

    def images() -> Iterator[Pair]:
        return _progress(pairs, "mean image")

    if options.baseline is not None:
        return kept_baseline(options.baseline, images, protocol=protocol)
    if options.baseline_ids is None:
        return None
    training = open_pairs(options, options.baseline_ids)
    return named_baseline(training, images, protocol=protocol, save=options.save_baseline)
