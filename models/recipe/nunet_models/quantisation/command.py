"""The verb `quantize`."""

import argparse
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from nunet_models.data.options import add_data_options, open_pairs
from nunet_models.data.pairs import Pairs
from nunet_models.errors import ConfigError, OptionError
from nunet_models.quantisation.static import METHODS, Plan, quantise
from nunet_models.training.provenance import list_of_ids

PICTURES = 32  # for calibration: more widen the ranges by rare values, at the cost of all others


def add_parser(verbs: argparse._SubParsersAction) -> None:
    """Register `quantize` and its options."""
    parser = verbs.add_parser("quantize", help="turn a model file's arithmetic into integers")
    parser.add_argument("--model", type=Path, required=True, help="fp32 model file, .onnx")
    parser.add_argument("--out", type=Path, required=True)
    add_data_options(parser)
    parser.add_argument(
        "--ids", type=Path, required=True, help="pictures to calibrate on: training ids only"
    )
    parser.add_argument("--pictures", type=int, default=PICTURES, help="default %(default)s")
    parser.add_argument("--method", choices=sorted(METHODS), default="minmax")
    parser.add_argument(
        "--float-node", action="append", default=[], metavar="NAME", help="leave a node in float"
    )
    parser.add_argument(
        "--quantise-heads", action="store_true", help="quantise the last layers too"
    )
    parser.add_argument(
        "--equalize",
        action=argparse.BooleanOptionalAction,
        default=True,
        help="bring the channels of each tensor to one range first (default %(default)s)",
    )
    parser.add_argument("--reduce-range", action="store_true", help="7-bit weights, without VNNI")
    parser.set_defaults(carry_out=run)


def run(options: argparse.Namespace) -> int:
    """Carry out `quantize`; prints the file written."""
    if options.pictures < 1:
        raise OptionError(
            f"`--pictures {options.pictures}`: expected one or more; hint: {PICTURES} do"
        )
    out, model = options.out, options.model
    if out.exists() and model.exists() and out.samefile(model):
        raise ConfigError(
            f"`--out {out}` is the file of `--model`, which would be lost; hint: another name"
        )
    pairs = open_pairs(options, options.ids)
    plan = Plan(
        options.method,
        float_heads=not options.quantise_heads,
        float_nodes=tuple(options.float_node),
        equalize=options.equalize,
        reduce_range=options.reduce_range,
    )
    quantise(
        options.model,
        options.out,
        _spread(pairs, options.pictures),
        plan,
        calibration=list_of_ids(pairs.ids),
    )
    before, after = (path.stat().st_size / 1e6 for path in (options.model, options.out))
    print(f"{options.out}: {before:.1f} MB to {after:.1f} MB")
    return 0


def _spread(pairs: Pairs, count: int) -> Iterator[np.ndarray]:
    """`count` pictures spread evenly over the collection: neighbours are of one room."""
    chosen = np.linspace(0, len(pairs) - 1, min(count, len(pairs))).astype(int)
    return (pairs[int(index)].rgb for index in chosen)
