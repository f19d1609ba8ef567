"""Results of `evaluate` and `nunetd eval --json`, which name their model differently."""

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Measured:
    """The file that was measured: its name, and its SHA-256 where nunetd measured it."""

    name: str | None
    sha256: str | None = None


def measured(result: dict[str, Any]) -> Measured:
    """The model file that a result is for; None if the result does not name it.

    # Errors
    `TypeError` where `model` is neither a name nor nunetd's `{"name", "hash"}`.
    """
    model = result.get("model")
    found = Measured(model)
    if isinstance(model, dict):
        found = Measured(model["name"], model.get("hash")) if model.get("name") else None
    if found is None or any(not isinstance(x, str | None) for x in (found.name, found.sha256)):
        raise TypeError("`model` is neither a name nor an object of `name` and `hash`")
    return found


def by_name(result: dict[str, Any]) -> dict[str, Any]:
    """The result with its model by name only: the hash changes when metadata is written."""
    name = measured(result).name
    return result if name is None else {**result, "model": name}
