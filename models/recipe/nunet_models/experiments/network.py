"""One network of an experiment: trained, exported and measured by the subcommands themselves."""

import argparse
import contextlib
import io
import json
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn

from nunet_models.errors import OptionError, RecipeError
from nunet_models.evaluation import command as evaluate_command
from nunet_models.export import command as export_command
from nunet_models.reporting import command as report_command
from nunet_models.training import command as train_command
from nunet_models.training.trainer import Trainer
from nunet_models.zoo.checkpoint import Checkpoint, LoadCheckpoint

DATA_OPTIONS = ("data", "class_map", "depth_scale", "depth_offset", "window")
_SUBCOMMANDS = (train_command, export_command, evaluate_command, report_command)


class _Parser(argparse.ArgumentParser):
    """A parser whose errors do not end the program."""

    def error(self, message: str) -> NoReturn:
        raise OptionError(message)


def parse(*arguments: object) -> argparse.Namespace:
    """The options of a subcommand.

    # Errors
    `OptionError` for options that it does not have.
    """
    parser = _Parser(prog="nunet_models")
    subparsers = parser.add_subparsers(required=True)
    for command in _SUBCOMMANDS:
        command.add_parser(subparsers)
    return parser.parse_args([str(argument) for argument in arguments])


def carry_out(*arguments: object) -> str:
    """Carry out a subcommand; what it printed."""
    options = parse(*arguments)
    with contextlib.redirect_stdout(io.StringIO()) as printed:
        options.carry_out(options)
    return printed.getvalue()


@dataclass(frozen=True)
class Network:
    """A run of `train` with `arguments`, whose files in `folder` begin with `name`."""

    folder: Path
    name: str
    arguments: tuple[str, ...]

    @property
    def best(self) -> Path:
        """Its checkpoint."""
        return self.folder / self.name / Trainer.BEST

    def file(self, suffix: str) -> Path:
        """Its file with this suffix: `onnx`, `csv` (a row per image) or `json`."""
        return self.folder / f"{self.name}.{suffix}"

    def check(self) -> None:
        """Refuse options that `train` would refuse without a look at any file."""
        with self._named_errors():
            train_command.settings_of(parse(*self._train()))

    def foreseen(self, load: LoadCheckpoint) -> Checkpoint:
        """What `train` will leave in `best`, with initial weights; nothing is trained or written.

        `load` reads the checkpoints that the options name, also of networks that do not exist yet.

        # Errors
        Those of `train` that need no decoded data, and begin with the name of the network.
        """
        with self._named_errors(), contextlib.redirect_stderr(io.StringIO()):
            settings, graph, before = train_command.prepare(parse(*self._train()), load)
        name, last_epoch = settings.component, {"epoch": settings.epochs}
        return Checkpoint(
            graph.spec,
            graph.state_dict(),
            history={**before.history, name: [last_epoch]},
            settings={**before.settings, name: settings.to_json()},
            provenance=before.provenance,
        )

    def check_export(self, foreseen: Checkpoint, options: argparse.Namespace) -> None:
        """Refuse a network that `export` would refuse once it is trained."""
        random = _untrained(foreseen)
        with self._named_errors():
            export_command.require_exportable(
                foreseen, self.best, random=random, license_text=options.license
            )

    @contextlib.contextmanager
    def _named_errors(self) -> Iterator[None]:
        try:
            yield
        except RecipeError as error:
            raise type(error)(f"`{self.name}`: {error}", hint=error.hint) from error

    def train(self) -> None:
        """Train to the end, from where an earlier call was interrupted.

        # Errors
        Those of `train`, also where the run in the folder was started with other options.
        """
        carry_out(*self._train())

    def _train(self) -> tuple[object, ...]:
        return "train", "--run", self.folder / self.name, "--resume", "--quiet", *self.arguments

    def is_measured(self, protocol: str) -> bool:
        """Whether its result is that of its present weights under this protocol."""
        result = self.file("json")
        if not result.is_file() or result.stat().st_mtime < self.best.stat().st_mtime:
            return False
        return json.loads(result.read_text(encoding="utf-8"))["protocol"] == protocol

    def measure(self, options: argparse.Namespace, *, with_baseline: bool) -> None:
        """Write its model file, its result and a row per image."""
        license_text = ("--license", options.license) if options.license else ()
        random = [
            word for name in _untrained(Checkpoint.load(self.best)) for word in ("--random", name)
        ]
        model = self.file("onnx")
        carry_out("export", "--checkpoint", self.best, "--out", model, *random, *license_text)
        baseline = ("--baseline-ids", options.train_ids) if with_baseline else ()
        result = carry_out(
            *("evaluate", "--model", model, *data_arguments(options), "--ids", options.val_ids),
            *("--protocol", options.protocol, "--threads", options.threads, *baseline),
            *("--csv", self.file("csv")),
        )
        partial = self.file("partial")
        partial.write_text(result, encoding="utf-8")
        partial.replace(self.file("json"))


def _untrained(checkpoint: Checkpoint) -> list[str]:
    """Components that keep their random weights, for a control."""
    found: list[str] = []
    while (name := checkpoint.untrained_component(besides=found)) is not None:
        found.append(name)
    return found


def data_arguments(options: argparse.Namespace) -> list[str]:
    """The data options as they were given."""
    found = []
    for name in DATA_OPTIONS:
        value = getattr(options, name)
        if value is not None:
            found += [f"--{name.replace('_', '-')}", str(value)]
    return found


def say(text: str) -> None:
    """Print progress to stderr; stdout is for the report."""
    print(f"nunet_models: {text}", file=sys.stderr, flush=True)
