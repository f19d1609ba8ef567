"""The subcommand `experiment`."""

import argparse
import copy
from collections.abc import Iterable
from pathlib import Path

from nunet_models.data.options import add_cache_option, add_data_options
from nunet_models.errors import RecipeError
from nunet_models.evaluation.protocol import PROTOCOLS
from nunet_models.experiments.network import Network, carry_out, data_arguments, say
from nunet_models.experiments.plan import Plan, read_plan
from nunet_models.files import check_output_folder
from nunet_models.program import EXIT_FAILURE, error_text
from nunet_models.zoo.checkpoint import Checkpoint


def add_parser(subparsers: argparse._SubParsersAction) -> None:
    """Register `experiment` and its options."""
    parser = subparsers.add_parser(
        "experiment",
        help="train, measure and compare the networks of a plan; the same command continues it",
    )
    parser.add_argument("--plan", type=Path, required=True, metavar="PLAN.toml")
    parser.add_argument(
        "--out", type=Path, required=True, help="folder for runs, model files and report.md"
    )
    add_data_options(parser)
    add_cache_option(parser)
    parser.add_argument("--train-ids", type=Path, required=True)
    parser.add_argument("--val-ids", type=Path, required=True, help="images to measure on, too")
    parser.add_argument(
        "--protocol",
        choices=sorted(PROTOCOLS),
        default="full",
        help="that of `evaluate` (default %(default)s)",
    )
    parser.add_argument("--license", metavar="TEXT", help="that of `export`")
    parser.add_argument("--threads", type=int, default=1, help="default %(default)s")
    parser.set_defaults(carry_out=run)


def run(options: argparse.Namespace) -> int:
    """Carry out `experiment`; prints the report."""
    plan = read_plan(options.plan)
    check_output_folder("--out", options.out)
    pretrained = [_network(name, given, plan, options) for name, given in plan.pretrained.items()]
    networks = {
        name: [_network(name, given, plan, options, seed) for seed in plan.seeds]
        for name, given in plan.networks.items()
    }
    every = [*pretrained, *(network for seeds in networks.values() for network in seeds)]
    for network in every:
        network.check()
    _check_graphs(pretrained, [seeds[0] for seeds in networks.values()], options)
    options.out.mkdir(parents=True, exist_ok=True)
    failed = set()
    for place, network in enumerate(every, start=1):
        say(f"{network.name}, {place} of {len(every)}")
        try:
            network.train()
            if network not in pretrained and not network.is_measured(options.protocol):
                network.measure(options, with_baseline=network is every[len(pretrained)])
        except (RecipeError, OSError) as error:  # the others may still be of use
            say(f"{network.name}: {error_text(error)}")
            failed.add(network.name)
    measured = [
        seeds for seeds in networks.values() if failed.isdisjoint(seed.name for seed in seeds)
    ]
    if measured:
        _report(options.out, measured, compared=measured[0] is next(iter(networks.values())))
    return EXIT_FAILURE if failed else 0


def _check_graphs(
    pretrained: list[Network], networks: list[Network], options: argparse.Namespace
) -> None:
    """Build every graph of the plan once, so that no option is refused after hours of training.

    Checkpoints that the plan will make are those that its networks foresee.
    """
    made: dict[Path, Checkpoint] = {}

    def load(path: Path) -> Checkpoint:
        return copy.deepcopy(made[path]) if path in made else Checkpoint.load(path)

    for network in pretrained:
        made[network.best] = network.foreseen(load)
    for network in networks:
        network.check_export(network.foreseen(load), options)


def _network(
    name: str,
    given: Iterable[str],
    plan: Plan,
    options: argparse.Namespace,
    seed: int | None = None,
) -> Network:
    """A run of the plan: pretrained without a seed."""
    for other in plan.pretrained:
        best = str(Network(options.out, other, ()).best)
        given = [text.replace(f"{{{other}}}", best) for text in given]
    cache = ("--cache", str(options.cache)) if options.cache else ()
    machine = ("--threads", str(options.threads), "--workers", "0")
    ids = ("--train-ids", str(options.train_ids), "--val-ids", str(options.val_ids))
    arguments = (*data_arguments(options), *ids, *cache, *machine, *plan.common, *given)
    if seed is None:
        return Network(options.out, name, arguments)
    return Network(options.out, f"{name}-{seed}", (*arguments, "--seed", str(seed)))


def _report(out: Path, networks: list[list[Network]], *, compared: bool) -> None:
    """Print the table of all, and the differences of each to the first, mean over the seeds."""
    arguments = []
    for network in (network for seeds in networks for network in seeds):
        arguments += ["--evaluation", network.file("json")]
    first, *others = [",".join(str(n.file("csv")) for n in seeds) for seeds in networks]
    for other in others if compared else ():
        arguments += ["--difference", first, other]
    carry_out("report", "--out", out, *arguments)
    print((out / "report.md").read_text(encoding="utf-8"))
