"""The subcommand `report`."""

import argparse
from pathlib import Path

from nunet_models.data.options import add_data_options, open_pairs
from nunet_models.errors import ConfigError
from nunet_models.evaluation.predict import Predictor
from nunet_models.reporting.differences import METRICS, difference_table
from nunet_models.reporting.figures import (
    NetworkDepth,
    Panel,
    comparable_panels,
    evolution,
    loss_curves,
    side_by_side,
)
from nunet_models.reporting.table import metric_table, paper_table, read_evaluation


def add_parser(subparsers: argparse._SubParsersAction) -> None:
    """Register `report` and its options."""
    parser = subparsers.add_parser("report", help="tables and figures from runs and evaluations")
    parser.add_argument("--out", type=Path, required=True, help="folder for report.md and figures")
    parser.add_argument("--run", type=Path, action="append", default=[], help="a run's folder")
    parser.add_argument(
        "--evaluation",
        type=Path,
        action="append",
        default=[],
        help="a result of `evaluate` or `nunetd eval --json`",
    )
    parser.add_argument(
        "--difference",
        nargs=2,
        action="append",
        default=[],
        metavar=("FIRST.csv", "SECOND.csv"),
        help="compare two networks by image, from `evaluate --csv`; several seeds by comma",
    )
    parser.add_argument(
        "--metric",
        action="append",
        help=f"column that `--difference` compares (default {', '.join(METRICS)})",
    )
    parser.add_argument("--model", type=Path, action="append", default=[], help="draw its depth")
    add_data_options(parser, required=False)
    parser.add_argument("--ids", type=Path, help="images to show with `--model`")
    parser.set_defaults(carry_out=run)


def run(options: argparse.Namespace) -> int:
    """Carry out `report`; prints the files written."""
    if not (options.run or options.evaluation or options.difference or options.model):
        raise ConfigError(
            "nothing to report", hint="`--run`, `--evaluation`, `--difference` or `--model`"
        )
    options.out.mkdir(parents=True, exist_ok=True)
    parts = ["# Report\n"]
    if options.evaluation:
        evaluations = [read_evaluation(path) for path in options.evaluation]
        parts += ["## Meters\n", metric_table(evaluations)]
        parts += ["## Stretched per image\n", paper_table(evaluations)]
    if options.difference:
        parts += [
            "## Differences\n",
            difference_table(options.difference, options.metric or METRICS),
        ]
    if options.run:
        loss_curves(options.run, options.out / "losses.png")
        parts.append("![loss curves](losses.png)\n")
        evolving = [panels for panels in map(evolution, options.run) if panels]
        if evolving:
            side_by_side(evolving, options.out / "evolution.png")
            parts.append("![a prediction over the epochs](evolution.png)\n")
    if options.model:
        side_by_side(_panels(options), options.out / "images.png")
        parts.append("![input, truth and networks](images.png)\n")
    report = options.out / "report.md"
    report.write_text("\n".join(parts), encoding="utf-8")
    print(report)
    return 0


def _panels(options: argparse.Namespace) -> list[list[Panel]]:
    """One row per image: input, truth, then each model's depth."""
    if not (options.data and options.ids):
        raise ConfigError("`--model` needs `--data` and `--ids`: which images to show")
    predictors = [Predictor(path) for path in options.model]
    pairs = open_pairs(options, options.ids)
    rows = []
    for index in range(len(pairs)):
        pair = pairs[index]
        shown = [NetworkDepth(p.path.stem, p(pair.rgb).depth, metric=p.metric) for p in predictors]
        rows.append([(pair.id, pair.rgb), *comparable_panels(pair.depth_m, shown)])
    return rows
