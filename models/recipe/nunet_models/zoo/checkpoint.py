"""Checkpoints: written whole or not at all, read with a clear word when they do not fit."""

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Self

import torch

from nunet_models.errors import ConfigError
from nunet_models.zoo import GraphSpec, SerialGraph

VERSION = 1


@dataclass
class Checkpoint:
    """A serial graph and what is needed to go on training it.

    `weights` are the averaged ones, `progress` the trainer's own state (None in a file made only
    to be exported), `history` the figures of each epoch by component name. `provenance` says by
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
        """The same to start from, in half the size: convolutions in 16 bits, no optimiser."""
        weights = {
            name: tensor.half() if tensor.is_floating_point() and tensor.dim() > 1 else tensor
            for name, tensor in self.weights.items()
        }
        return replace(self, weights=weights, progress=None)

    def untrained_component(self) -> str | None:
        """The first component that no validated epoch of any training has changed, if there is one.

        A component learns in its own training, and in that of a later one which left it unfrozen.
        """
        names = [component.name for component in self.spec.components]
        learnt: set[str] = set()
        for index, name in enumerate(names):
            if self.history.get(name):
                unfrozen = self.settings.get(name, {}).get("unfrozen", False)
                learnt.update(names[: index + 1] if unfrozen else [name])
        return next((name for name in names if name not in learnt), None)

    def component_weights(self, name: str) -> dict[str, torch.Tensor]:
        """The averaged weights of the component called `name`, by its own keys."""
        names = [component.name for component in self.spec.components]
        if name not in names:
            raise ConfigError(f"the checkpoint has no component `{name}`; hint: {', '.join(names)}")
        prefix = f"components.{names.index(name)}."
        return {k.removeprefix(prefix): v for k, v in self.weights.items() if k.startswith(prefix)}

    def save(self, path: Path) -> None:
        """Write to `path`; a crash meanwhile leaves the file that was there."""
        beside = path.with_suffix(".partial")
        torch.save(
            {
                "version": VERSION,
                "spec": self.spec.to_json(),
                "weights": self.weights,
                "progress": self.progress,
                "history": self.history,
                "settings": self.settings,
                "provenance": self.provenance,
            },
            beside,
        )
        beside.replace(path)

    @classmethod
    def load(cls, path: Path) -> Self:
        """Read a checkpoint.

        # Errors
        `ConfigError` for a file that is no checkpoint or of another version.
        """
        if not path.is_file():
            raise ConfigError(f"no checkpoint `{path}`")
        try:
            values = torch.load(path, weights_only=True, map_location="cpu")
            version = values.pop("version")
        except Exception as error:  # whose text advises to load what may run code: not repeated
            raise ConfigError(
                f"`{path}` is no checkpoint of this package, or damaged; hint: `train` writes "
                "`last.pt` and `best.pt`"
            ) from error
        if version != VERSION:
            raise ConfigError(f"checkpoint `{path}` is of version {version}; expected {VERSION}")
        return cls(**{**values, "spec": GraphSpec.from_json(values["spec"])})
