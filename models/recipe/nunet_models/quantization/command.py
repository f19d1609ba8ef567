"""The subcommand `quantize`."""

import argparse
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from nunet_models.data.options import add_data_options, open_pairs
from nunet_models.data.pairs import Pairs
from nunet_models.errors import ConfigError, OptionError
from nunet_models.files import check_output_file
from nunet_models.quantization.static import METHODS, Plan, quantize
from nunet_models.training.provenance import list_of_ids

IMAGES = 32  # with more images, rare values widen the ranges, at the cost of all others


def add_parser(subparsers: argparse._SubParsersAction) -> None:
    """Register `quantize` and its options."""
    parser = subparsers.add_parser("quantize", help="convert a model file to 8-bit integers")
    parser.add_argument("--model", type=Path, required=True, help="fp32 model file, .onnx")
    parser.add_argument("--out", type=Path, required=True)
    add_data_options(parser)
    parser.add_argument(
        "--ids", type=Path, required=True, help="images to calibrate on: training ids only"
    )
    parser.add_argument("--images", type=int, default=IMAGES, help="default %(default)s")
    parser.add_argument("--method", choices=sorted(METHODS), default="minmax")
    parser.add_argument(
        "--float-node", action="append", default=[], metavar="NAME", help="leave a node in float"
    )
    parser.add_argument(
        "--quantize-heads", action="store_true", help="quantize the last layers too"
    )
    parser.add_argument(
        "--equalize",
        action=argparse.BooleanOptionalAction,
        default=True,
        help="bring the channels of each tensor to one range first (default %(default)s)",
    )
    parser.add_argument(
        "--correct-biases",
        action=argparse.BooleanOptionalAction,
        default=True,
        help="subtract the mean of what rounding of weights adds (default %(default)s)",
    )
    parser.add_argument(
        "--reduce-range",
        action=argparse.BooleanOptionalAction,
        default=True,
        help="7-bit weights, for x86 processors without VNNI (default %(default)s)",
    )
    parser.set_defaults(carry_out=run)


def run(options: argparse.Namespace) -> int:
    """Carry out `quantize`; prints the file written."""
    if options.images < 1:
        raise OptionError(
            f"`--images {options.images}`: expected one or more", hint=f"{IMAGES} are enough"
        )
    out, model = options.out, options.model
    if out.exists() and model.exists() and out.samefile(model):
        raise ConfigError(
            f"`--out {out}` would overwrite the file of `--model`", hint="use another name"
        )
    check_output_file("--out", out)
    pairs = open_pairs(options, options.ids)
    plan = Plan(
        options.method,
        float_heads=not options.quantize_heads,
        float_nodes=tuple(options.float_node),
        equalize=options.equalize,
        correct_biases=options.correct_biases,
        reduce_range=options.reduce_range,
    )
    quantize(
        options.model,
        options.out,
        _spread(pairs, options.images),
        plan,
        calibration=list_of_ids(pairs.ids),
    )
    before, after = (path.stat().st_size / 1e6 for path in (options.model, options.out))
    print(f"{options.out}: {before:.1f} MB to {after:.1f} MB")
    return 0


def _spread(pairs: Pairs, count: int) -> Iterator[np.ndarray]:
    """`count` images spread evenly over the collection: neighbors are of one room."""
    chosen = np.linspace(0, len(pairs) - 1, min(count, len(pairs))).astype(int)
    return (pairs[int(index)].rgb for index in chosen)
