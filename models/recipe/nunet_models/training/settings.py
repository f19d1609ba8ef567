"""Everything that decides a training run, as plain data kept in its checkpoints."""

from dataclasses import asdict, dataclass
from typing import Any, Self

from nunet_models.data.augment import BALANCED, NO_AUGMENTATION, STRONG, Augmentation

AUGMENTATIONS: dict[str, Augmentation] = {
    "none": NO_AUGMENTATION,
    "strong": STRONG,
    "balanced": BALANCED,
}


@dataclass(frozen=True)
class Settings:
    """Settings of the training of one component of a serial graph.

    `loss` is for depth components (see `losses.parse_loss`: weights by name, and
    `scale_invariant:LAMBDA=WEIGHT`); `smoothing` and `class_power` for
    segmentation: classes weigh as their frequency to the power `-class_power`. `joint_noise` is
    the probability that a picture's features from the component before are withheld, and sets how
    much they are scaled: a frozen component is surer of pictures it was trained on than it will
    be of others, and the next one must not learn to trust that. `unfrozen` lets the earlier
    components learn along, from this component's loss alone. `validate_every` is how many epochs
    lie between two validations; the last epoch is always validated. `workers` prepare batches in
    processes of their own; with 0 the training does it itself, which is quicker where augmentation
    is little work: a fork breaks the parent's huge pages.
    """

    component: str
    epochs: int
    batch: int = 8
    lr: float = 1e-3
    encoder_lr: float = 1.0
    weight_decay: float = 2e-2
    warmup: float = 0.05
    final_lr: float = 0.01
    schedule: str = "cosine"
    optimiser: str = "adamw"
    loss: str = "l1_log=1,silog=0.5,gradient=0.5"
    smoothing: float = 0.05
    class_power: float = 0.5
    joint_noise: float = 0.0
    unfrozen: bool = False
    augmentation: str = "strong"
    ema: float = 0.998
    clip: float = 1.0
    seed: int = 0
    bf16: bool = True
    compile: bool = False
    threads: int = 2
    workers: int = 1
    validate_every: int = 1

    def to_json(self) -> dict[str, Any]:
        """Plain JSON types."""
        return asdict(self)

    @classmethod
    def from_json(cls, values: dict[str, Any]) -> Self:
        """Rebuild settings from `to_json`'s answer."""
        return cls(**values)
