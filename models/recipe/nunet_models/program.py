"""How a program of this package runs: exit codes, and errors as text."""

import argparse
import sys

from nunet_models.errors import OptionError, RecipeError, with_hint

EXIT_FAILURE = 1
EXIT_USAGE = 2  # argparse's own, too
EXIT_INTERRUPTED = 130


def run_program(parser: argparse.ArgumentParser, arguments: list[str] | None) -> int:
    """Carry out what the arguments say; exit code 0 done, 1 failure, 2 bad arguments, 130 stopped.

    Errors are printed to stderr.
    """
    options = parser.parse_args(arguments)
    try:
        return options.carry_out(options)
    except (RecipeError, OSError) as error:
        print(f"nunet_models: {error_text(error)}", file=sys.stderr)
        return EXIT_USAGE if isinstance(error, OptionError) else EXIT_FAILURE
    except KeyboardInterrupt:
        return EXIT_INTERRUPTED


def error_text(error: RecipeError | OSError) -> str:
    """A system error as text in this package's form: the file, then the reason."""
    if isinstance(error, OSError) and error.filename is not None and error.strerror:
        return f"`{error.filename}`: {error.strerror.lower()}"
    return with_hint(str(error), getattr(error, "hint", None))
