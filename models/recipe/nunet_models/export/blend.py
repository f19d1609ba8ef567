"""Changes of a checkpoint before it is exported: weights between two trainings, another range."""

import hashlib
from dataclasses import replace
from pathlib import Path

from nunet_models.errors import ConfigError, OptionError
from nunet_models.zoo.checkpoint import Checkpoint


def blended(checkpoint: Checkpoint, text: str) -> Checkpoint:
    """`checkpoint` with a share of another one's weights; `text` is `FILE=SHARE`.

    Fine-tuned weights that are mixed with those they started from often keep what either is good
    at (Wortsman et al., "Robust fine-tuning of zero-shot models", 2022). A confidence head that the
    other one does not have stays as it is.

    # Errors
    `OptionError` for other text, `ConfigError` for a checkpoint of another graph.
    """
    name, _, number = text.rpartition("=")
    share = _share(number)
    if not name or share is None:
        raise OptionError(f"`--blend {text}`: expected FILE=SHARE, with a share between 0 and 1")
    other = Checkpoint.load(Path(name))
    if other.spec.components != checkpoint.spec.components:
        raise ConfigError(
            f"cannot blend with `{name}`: it is a `{other.spec.architecture}` with other components"
        )
    weights = {
        key: value.float() * (1 - share) + other.weights[key].float() * share
        if value.is_floating_point() and key in other.weights
        else value
        for key, value in checkpoint.weights.items()
    }
    digest = hashlib.sha256(Path(name).read_bytes()).hexdigest()
    blend = {"blended_with": {"sha256": digest, "share": share}}
    last = checkpoint.spec.components[-1].name
    provenance = {**checkpoint.provenance, last: {**checkpoint.provenance.get(last, {}), **blend}}
    return replace(checkpoint, weights=weights, provenance=provenance)


def with_range(checkpoint: Checkpoint, text: str) -> Checkpoint:
    """`checkpoint` with another range of valid depth; `text` is `NEAR,FAR` in meters.

    # Errors
    `OptionError` for other text or an empty range.
    """
    parts = [_number(part) for part in text.split(",")]
    if len(parts) != 2 or None in parts or not 0 < parts[0] < parts[1] < float("inf"):
        raise OptionError(f"`--depth-range {text}`: expected NEAR,FAR in meters, 0 < NEAR < FAR")
    return replace(checkpoint, spec=replace(checkpoint.spec, min_m=parts[0], max_m=parts[1]))


def _share(text: str) -> float | None:
    share = _number(text)
    return share if share is not None and 0 < share < 1 else None


def _number(text: str) -> float | None:
    try:
        return float(text)
    except ValueError:
        return None
