"""The command line: `python -m nunet_models SUBCOMMAND`."""

import argparse

from nunet_models.data import command as nyu_lists_command
from nunet_models.evaluation import command as evaluate_command
from nunet_models.experiments import command as experiment_command
from nunet_models.export import annotate as annotate_command
from nunet_models.export import command as export_command
from nunet_models.program import run_program
from nunet_models.quantization import command as quantize_command
from nunet_models.rendering import command as render_command
from nunet_models.reporting import command as report_command
from nunet_models.training import command as train_command

SUBPARSERS = (
    train_command,
    evaluate_command,
    quantize_command,
    export_command,
    annotate_command,
    report_command,
    experiment_command,
    nyu_lists_command,
    render_command,
)


def parser() -> argparse.ArgumentParser:
    """Every subcommand with its options."""
    top = argparse.ArgumentParser(prog="nunet_models", description=__doc__)
    subparsers = top.add_subparsers(required=True, metavar="SUBCOMMAND")
    for command in SUBPARSERS:
        command.add_parser(subparsers)
    return top


def main(arguments: list[str] | None = None) -> int:
    """Run a subcommand; its exit code (see `run_program`)."""
    return run_program(parser(), arguments)
