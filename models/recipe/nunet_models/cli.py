"""The command line: `python -m nunet_models SUBCOMMAND`."""

import argparse
import sys

from nunet_models.data import command as nyu_lists_command
from nunet_models.errors import OptionError, RecipeError, with_hint
from nunet_models.evaluation import command as evaluate_command
from nunet_models.export import annotate as annotate_command
from nunet_models.export import command as export_command
from nunet_models.quantization import command as quantize_command
from nunet_models.rendering import command as render_command
from nunet_models.reporting import command as report_command
from nunet_models.training import command as train_command

EXIT_FAILURE = 1
EXIT_USAGE = 2  # argparse's own, too
EXIT_INTERRUPTED = 130

SUBPARSERS = (
    train_command,
    evaluate_command,
    quantize_command,
    export_command,
    annotate_command,
    report_command,
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
    """Run a subcommand; exit code 0 done, 1 failure, 2 bad arguments, 130 interrupted."""
    options = parser().parse_args(arguments)
    try:
        return options.carry_out(options)
    except (RecipeError, OSError) as error:
        print(f"nunet_models: {_error_text(error)}", file=sys.stderr)
        return EXIT_USAGE if isinstance(error, OptionError) else EXIT_FAILURE
    except KeyboardInterrupt:
        return EXIT_INTERRUPTED


def _error_text(error: RecipeError | OSError) -> str:
    """A system error as text in this package's form: the file, then the reason."""
    if isinstance(error, OSError) and error.filename is not None and error.strerror:
        return f"`{error.filename}`: {error.strerror.lower()}"
    return with_hint(str(error), getattr(error, "hint", None))
