"""The license of trained weights: what the runs behind them state of their images."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

from nunet_models.errors import ConfigError
from nunet_models.export.metadata import DATA_LICENSE
from nunet_models.zoo import NYU_CAMERA, Camera
from nunet_models.zoo.checkpoint import Checkpoint


def license_of(checkpoint: Checkpoint, path: Path) -> str:
    """The licenses that `train --license` stated for the components and their decoders.

    A part without one counts as trained on NYU Depth V2. `path` is for the message.

    # Errors
    `ConfigError` for such a part that was trained with another camera.
    """
    texts = {}
    for part, trained in _parts(checkpoint):
        camera = Camera(**trained["camera"]) if "camera" in trained else checkpoint.spec.camera
        if "license" not in trained and camera != NYU_CAMERA:
            raise ConfigError(
                f"{part} of `{path}` was trained with another camera than NYU Depth V2's, whose "
                "license text is the default",
                hint="`--license TEXT` names the license of the images",
            )
        text = trained.get("license", DATA_LICENSE)
        texts.setdefault(text, []).append(part)
    if len(texts) < 2:
        return next(iter(texts), DATA_LICENSE)
    return "; ".join(f"{', '.join(parts)}: {text}" for text, parts in texts.items())


def with_license(checkpoint: Checkpoint, text: str) -> Checkpoint:
    """`checkpoint` with this license of all trained components and their decoders."""
    trained = [name for name, epochs in checkpoint.history.items() if epochs]
    known = checkpoint.provenance
    stated = {name: _stated(known.get(name, {}), text) for name in trained}
    return replace(checkpoint, provenance={**known, **stated})


def _stated(trained: dict[str, Any], text: str) -> dict[str, Any]:
    decoder = {"decoder": _stated(trained["decoder"], text)} if "decoder" in trained else {}
    return {**trained, "license": text, **decoder}


def _parts(checkpoint: Checkpoint) -> Iterator[tuple[str, dict[str, Any]]]:
    """What is known of each trained component, and of decoders that came from other networks."""
    for name in checkpoint.history:
        if not checkpoint.history[name]:
            continue
        part, trained = f"`{name}`", checkpoint.provenance.get(name, {})
        yield part, trained
        while "decoder" in trained:
            part, trained = f"the decoder of {part}", trained["decoder"]
            yield part, trained
