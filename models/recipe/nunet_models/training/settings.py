"""Everything that decides a training run, as plain data kept in its checkpoints."""

import math
from dataclasses import MISSING, asdict, dataclass, fields
from typing import Any

from nunet_models.data.augment import BALANCED, NO_AUGMENTATION, STRONG, Augmentation
from nunet_models.data.sets.draw import WHOLE, ViewRanges
from nunet_models.errors import OptionError
from nunet_models.losses import parse_loss

AUGMENTATIONS: dict[str, Augmentation] = {
    "none": NO_AUGMENTATION,
    "strong": STRONG,
    "balanced": BALANCED,
}

VIEWS: dict[str, ViewRanges] = {
    "none": WHOLE,
    "strong": ViewRanges(),
    "balanced": ViewRanges(near_chance=0.1, zoom=(0.85, 1.2)),
}
"""The same names for the images of a dataset list, whose cameras are known."""

MAY_CHANGE = frozenset({"epochs", "threads", "workers", "validate_every"})
"""Settings that may change on `--resume`: none of them changes a step already made."""

_SEEDS = 2**64  # what torch takes

_NUMBERS = {
    "epochs": ("at least 1", lambda n: n >= 1),
    "batch": ("at least 1", lambda n: n >= 1),
    "frames": ("at least 1", lambda n: n >= 1),
    "threads": ("at least 1", lambda n: n >= 1),
    "workers": ("0 or more", lambda n: n >= 0),
    "validate_every": ("at least 1", lambda n: n >= 1),
    "patch": ("0 < x <= 1", lambda x: 0.0 < x <= 1.0),
    "seed": ("0 to 2^64 - 1", lambda n: 0 <= n < _SEEDS),
    "lr": ("more than 0", lambda x: 0.0 < x < math.inf),
    "encoder_lr": ("0 or more", lambda x: 0.0 <= x < math.inf),
    "final_lr": ("0 or more", lambda x: 0.0 <= x < math.inf),
    "weight_decay": ("0 or more", lambda x: 0.0 <= x < math.inf),
    "warmup": ("0 <= x < 1", lambda x: 0.0 <= x < 1.0),
    "ema": ("0 <= x < 1", lambda x: 0.0 <= x < 1.0),
    "smoothing": ("0 <= x < 1", lambda x: 0.0 <= x < 1.0),
    "class_power": ("a number", math.isfinite),
    "clip": ("0 (none) or more", lambda x: 0.0 <= x < math.inf),
    "joint_noise": ("0 <= x <= 1", lambda x: 0.0 <= x <= 1.0),
    "label_loss": ("0 or more", lambda x: 0.0 <= x < math.inf),
}
"""What a setting must be, in words and as a test that NaN does not pass."""


@dataclass(frozen=True)
class Settings:
    """Settings of the training of one component of a serial graph.

    `loss` is for depth components (see `losses.parse_loss`: weights by name, and
    `scale_invariant:LAMBDA=WEIGHT`); `smoothing` and `class_power` for
    segmentation: classes weigh as their frequency to the power `-class_power`. `joint_noise` is
    the probability that an image's features from the component before are withheld, and sets how
    much they are scaled: a frozen component is more confident on images it was trained on than on
    others, and the next one must not rely on that. `unfrozen` lets the earlier components learn
    along, from this component's loss; `label_loss` adds the cross-entropy of those that segment,
    with this weight, for images that have labels. `validate_every` is how many epochs lie between
    two validations; the last epoch is always validated. `workers` prepare batches in processes of
    their own; with 0 the training does it itself, which is quicker where augmentation is little
    work: forking splits the parent's huge pages.

    `frames` is how many consecutive frames of a video a recurrent component learns from at once;
    `batch` then counts such windows.

    `patch` trains on parts of the views of `--sets`, of this share of each side: pixels are as
    large as in the whole view, so that the weights fit, and a step takes less time.

    A run resumed with more `epochs` follows the schedule of the new length: with `cosine` the rate
    rises at once to the longer curve; `constant` does not change.

    # Errors
    `OptionError` naming an invalid setting.
    """

    component: str
    epochs: int
    batch: int = 8
    frames: int = 1
    lr: float = 1e-3
    encoder_lr: float = 1.0
    weight_decay: float = 2e-2
    warmup: float = 0.05
    final_lr: float = 0.01
    schedule: str = "cosine"
    optimizer: str = "adamw"
    loss: str = "l1_log=1,silog=0.5,gradient=0.5"
    smoothing: float = 0.05
    class_power: float = 0.5
    joint_noise: float = 0.0
    unfrozen: bool = False
    label_loss: float = 0.0
    augmentation: str = "strong"
    patch: float = 1.0
    ema: float = 0.998
    clip: float = 1.0
    seed: int = 0
    bf16: bool = True
    compile: bool = False
    threads: int = 2
    workers: int = 1
    validate_every: int = 1

    def __post_init__(self) -> None:
        for name, (expected, holds) in _NUMBERS.items():
            if not holds(getattr(self, name)):
                raise OptionError(f"`{_option(name, getattr(self, name))}`; expected {expected}")
        parse_loss(self.loss)
        if self.label_loss and not self.unfrozen:
            raise OptionError(
                f"`--label-loss {self.label_loss}` trains the components before `{self.component}`",
                hint="add `--unfrozen`",
            )

    def to_json(self) -> dict[str, Any]:
        """Plain JSON types."""
        return asdict(self)

    def differences(self, started: dict[str, Any]) -> list[str]:
        """What differs from the settings that a run was started with (`to_json`'s result).

        One phrase per option, except those of `MAY_CHANGE`. A setting that `started` lacks was
        added after that run, which had its default.
        """
        found = []
        for setting in fields(self):
            name, given = setting.name, getattr(self, setting.name)
            before = started.get(name, given if setting.default is MISSING else setting.default)
            if name not in MAY_CHANGE and given != before:
                found.append(f"`{_option(name, before)}`, given `{_option(name, given)}`")
        return found


def _option(name: str, value: object) -> str:
    """A setting as it is written on the command line."""
    dashed = name.replace("_", "-")
    if isinstance(value, bool):
        return f"--{dashed}" if value else f"--no-{dashed}"
    return f"--{dashed} {value}"
