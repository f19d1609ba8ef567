"""Checkpoints: written atomically; reading an incompatible one is an error."""

from collections.abc import Callable, Collection
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Self

import torch

from nunet_models.errors import ConfigError
from nunet_models.zoo import GraphSpec, SerialGraph
from nunet_models.zoo.confidence import CONFIDENCE

VERSION = 1
_SETTINGS_IN_FILE = {"optimizer": "optimiser"}
"""Settings whose key in the file is spelled otherwise: version 1 has always had that key."""


@dataclass
class Checkpoint:
    """A serial graph and what is needed to continue its training.

    `weights` are the averaged ones, `progress` the trainer's own state (None in a file made only
    to be exported), `history` the metrics of each epoch by component name. `provenance` says by
    component what its run was made from (see `training.provenance`); older files have none.
    """

    spec: GraphSpec
    weights: dict[str, torch.Tensor]
    progress: dict[str, Any] | None = None
    history: dict[str, list[dict[str, float]]] = field(default_factory=dict)
    settings: dict[str, dict[str, Any]] = field(default_factory=dict)
    provenance: dict[str, dict[str, Any]] = field(default_factory=dict)

    def graph(self) -> SerialGraph:
        """The network with the averaged weights, ready to evaluate."""
        graph = SerialGraph(self.spec)
        graph.load_state_dict(self.weights)
        return graph.eval()

    def halved(self) -> Self:
        """The checkpoint in half the size, to start from: convolutions in 16 bits, no optimizer."""
        weights = {
            name: tensor.half() if tensor.is_floating_point() and tensor.dim() > 1 else tensor
            for name, tensor in self.weights.items()
        }
        return replace(self, weights=weights, progress=None)

    def untrained_component(self, *, besides: Collection[str] = ()) -> str | None:
        """The first component that no validated epoch of any training has changed, if there is one.

        A component learns in its own training, and in that of a later one which left it unfrozen.
        Those named by `besides` are not looked at.
        """
        names = self._names()
        learned = set(besides)
        for index, name in enumerate(names):
            if self.history.get(name):
                unfrozen = self.settings.get(name, {}).get("unfrozen", False)
                learned.update(names[: index + 1] if unfrozen else [name])
        return next((name for name in names if name not in learned), None)

    def training_of(self, name: str) -> dict[str, Any]:
        """How a trained component was trained, as `nunet.training` states it."""
        return {
            **self.settings.get(name, {}),
            "epochs_done": self.history[name][-1]["epoch"],
            **self.provenance.get(name, {}),
        }

    def component_weights(self, name: str) -> dict[str, torch.Tensor]:
        """The averaged weights of the component called `name`, by its own keys."""
        names = self._names()
        if name not in names:
            raise ConfigError(
                f"the checkpoint has no component `{name}`", hint=f"{', '.join(names)}"
            )
        prefix = f"{CONFIDENCE}." if name == CONFIDENCE else f"components.{names.index(name)}."
        return {k.removeprefix(prefix): v for k, v in self.weights.items() if k.startswith(prefix)}

    def without_confidence(self) -> Self:
        """The checkpoint without its confidence head, which belongs to the weights as they are."""

        def kept(of: dict[str, Any]) -> dict[str, Any]:
            return {name: value for name, value in of.items() if name != CONFIDENCE}

        return replace(
            self,
            spec=replace(self.spec, confidence=False),
            weights={k: v for k, v in self.weights.items() if not k.startswith(f"{CONFIDENCE}.")},
            history=kept(self.history),
            settings=kept(self.settings),
            provenance=kept(self.provenance),
        )

    def _names(self) -> list[str]:
        """What can be trained: the components in order, then the confidence head."""
        names = [component.name for component in self.spec.components]
        return [*names, CONFIDENCE] if self.spec.confidence else names

    def save(self, path: Path) -> None:
        """Write to `path` atomically: a crash keeps the earlier file."""
        partial = path.with_suffix(".partial")
        torch.save(
            {
                "version": VERSION,
                "spec": self.spec.to_json(),
                "weights": self.weights,
                "progress": self.progress,
                "history": self.history,
                "settings": _renamed(self.settings, _SETTINGS_IN_FILE),
                "provenance": self.provenance,
            },
            partial,
        )
        partial.replace(path)

    @classmethod
    def load(cls, path: Path) -> Self:
        """Read a checkpoint.

        # Errors
        `ConfigError` for a file that is not a checkpoint or of another version.
        """
        if not path.is_file():
            raise ConfigError(f"no checkpoint `{path}`")
        try:
            values = torch.load(path, weights_only=True, map_location="cpu")
            version = values.pop("version")
        except Exception as error:  # not shown: suggests an unsafe way to load
            raise ConfigError(
                f"`{path}` is not a checkpoint of this package, or damaged",
                hint="`train` writes `last.pt` and `best.pt`",
            ) from error
        if version != VERSION:
            raise ConfigError(f"checkpoint `{path}` is of version {version}; expected {VERSION}")
        names = {in_file: name for name, in_file in _SETTINGS_IN_FILE.items()}
        values["settings"] = _renamed(values.get("settings", {}), names)
        return cls(**{**values, "spec": GraphSpec.from_json(values["spec"])})


def _renamed(settings: dict[str, dict[str, Any]], names: dict[str, str]) -> dict[str, Any]:
    """The settings of each component with the keys of `names` renamed."""
    return {
        component: {names.get(key, key): value for key, value in values.items()}
        for component, values in settings.items()
    }


LoadCheckpoint = Callable[[Path], Checkpoint]
