"""The parts of a serial graph as plain data, kept in checkpoints and in the model file."""

import re
from dataclasses import asdict, dataclass, field, replace
from typing import Any, Literal, Self

from nunet_models.classes import CLASSES_13
from nunet_models.errors import ConfigError, OptionError
from nunet_models.zoo.dense import DENSE

Task = Literal["segmentation", "normals", "objectness", "depth"]
Encoding = Literal["metric", "minmax"]
Recurrence = Literal["lstm", "gru"]
Reads = Literal["image", "depth"]

_CHANNELS = {"normals": 3, "objectness": 2, "depth": 1}
"""Of a task's raw numbers; a segmentation has one per class."""

PAPER_DECODER = (256, 128, 64, 32, 16)
"""Filters of the paper's decoder, deepest first."""
LITE_DECODER = (128, 64, 48, 32, 16)
"""Filters that keep the decoder's cost in proportion to EfficientNet-Lite0's."""
DECODERS = {"lite": LITE_DECODER, "paper": PAPER_DECODER}
"""By the name that `train --decoder` takes."""


def decoder_channels(text: str) -> tuple[int, ...]:
    """Filters of a decoder by its name, or a comma-separated list of them, deepest first.

    # Errors
    `OptionError` for another name, and for a list that is not five numbers of 1 or more.
    """
    if text in DECODERS:
        return DECODERS[text]
    filters = text.split(",")
    if len(filters) != len(LITE_DECODER) or not all(re.fullmatch(r"[1-9]\d*", n) for n in filters):
        raise OptionError(
            f"`--decoder {text}`; expected {' or '.join(sorted(DECODERS))}, or "
            f"{len(LITE_DECODER)} numbers of filters",
            hint=f"`lite` is {','.join(map(str, LITE_DECODER))}",
        )
    return tuple(map(int, filters))


def decoder_name(channels: tuple[int, ...]) -> str:
    """The filters of a decoder as `decoder_channels` reads them."""
    names = {filters: name for name, filters in DECODERS.items()}
    return names.get(channels) or ",".join(map(str, channels))


_KEYS_IN_FILE = {"state_units": "memory"}
"""Fields of a component whose key in a checkpoint is another: it has always been that one."""


@dataclass(frozen=True)
class ComponentSpec:
    """One U-Net of a serial graph.

    `connected` says whether it sees the image; the first component always does. `sigmoid_joint`
    keeps a final sigmoid on what the next component reads, as in the paper's code. `dropout` (of
    whole channels before the head) and `drop_path` (of encoder blocks) act in training only.
    `backbone` may also be `cnn`, `rcnn1` or `rcnn`, whose hidden layers `width` scales.
    `state_units` is how many units the state of a convolutional LSTM or GRU (`recurrence`) at the
    bottleneck has, 0 for none.
    With `latent` channels above 0, the decoder reads such a map alone, without skip connections,
    and `reads` is "depth" for the autoencoder that this decoder comes from (`zoo.autoencoder`).
    """

    name: str
    task: Task
    backbone: str
    connected: bool = True
    decoder_channels: tuple[int, ...] = LITE_DECODER
    dropout: float = 0.0
    drop_path: float = 0.0
    sigmoid_joint: bool = False
    width: float = 1.0
    state_units: int = 0
    recurrence: Recurrence = "lstm"
    latent: int = 0
    reads: Reads = "image"

    def changed(self, **fields: object) -> Self:
        """The same component with some fields changed."""
        return replace(self, **fields)

    @property
    def is_recurrent(self) -> bool:
        """Whether it carries a state from frame to frame."""
        return self.state_units > 0

    def to_json(self) -> dict[str, Any]:
        """Plain JSON types, read back by `from_json`."""
        return {_KEYS_IN_FILE.get(name, name): value for name, value in asdict(self).items()}

    @classmethod
    def from_json(cls, values: dict[str, Any]) -> Self:
        """Rebuild a spec from `to_json`'s result; fields that a file lacks have their default."""
        names = {in_file: name for name, in_file in _KEYS_IN_FILE.items()}
        fields = {names.get(key, key): value for key, value in values.items()}
        return cls(**{**fields, "decoder_channels": tuple(fields["decoder_channels"])})


_LENGTH, _PLACE = r"(\d+(?:\.\d*)?)", r"(-?\d+(?:\.\d*)?)"
_INTRINSICS = re.compile(rf"{_LENGTH},{_LENGTH},{_PLACE},{_PLACE}@(\d+)x(\d+)")


@dataclass(frozen=True)
class Camera:
    """Pinhole camera that the training images were taken with: pixels at `width` x `height`."""

    width: int
    height: int
    fx: float
    fy: float

    @classmethod
    def from_intrinsics(cls, text: str) -> Self:
        """Read `fx,fy,cx,cy@WxH` in pixels, as nunetd's `--intrinsics` is written.

        The principal point does not affect depth and is dropped.

        # Errors
        `OptionError` for other text, and for lengths that are not positive.
        """
        found = _INTRINSICS.fullmatch(text)
        numbers = [float(number) for number in found.groups()] if found else [0.0]
        if min(numbers[:2] + numbers[4:]) <= 0.0:
            raise OptionError(
                f"`--intrinsics {text}`: expected fx,fy,cx,cy@WxH in pixels",
                hint="NYU's are 518.858,519.470,325.582,253.736@640x480",
            )
        fx, fy, _, _, width, height = numbers
        return cls(int(width), int(height), fx, fy)


NYU_CAMERA = Camera(width=640, height=480, fx=518.858, fy=519.470)


@dataclass(frozen=True)
class GraphSpec:
    """A serial graph with its sizes and its depth encoding.

    Sizes are (height, width) in pixels. `input_size` is that of the model file's input and outputs;
    `inner_size`, where the components work, divides it without remainder. `confidence` says that
    the last component has a head that predicts the error of its depth (`zoo.confidence`).
    """

    architecture: str
    components: tuple[ComponentSpec, ...]
    input_size: tuple[int, int] = (480, 640)
    inner_size: tuple[int, int] = (240, 320)
    encoding: Encoding = "metric"
    min_m: float = 0.3  # below any depth in training, also after augmentation
    max_m: float = 12.0  # a fifth beyond the training sensor's range of 10 m
    classes: tuple[str, ...] = CLASSES_13
    camera: Camera = field(default=NYU_CAMERA)
    confidence: bool = False

    def __post_init__(self) -> None:
        if not self.components:
            raise ConfigError(f"architecture `{self.architecture}` has no components")
        if self.components[-1].task != "depth":
            raise ConfigError(
                f"the last component of `{self.architecture}` must be of task `depth`"
            )
        if any(c.is_recurrent for c in self.components[:-1]):
            raise ConfigError("only the last component can be recurrent")
        for c in self.components:
            if (c.latent or c.is_recurrent) and c.backbone in DENSE:
                part = "decoder" if c.latent else "bottleneck"
                raise ConfigError(
                    f"component `{c.name}` of `{self.architecture}` has no U-Net {part} with "
                    f"backbone `{c.backbone}`",
                    hint="`--backbone efficientnet_lite0` has one",
                )
        if len(self.components) > 1 and any(c.reads == "depth" for c in self.components):
            raise ConfigError("only a single component can read depth")
        if self.confidence and not self.may_have_confidence:
            raise ConfigError(
                f"`{self.architecture}` cannot have a confidence head: it needs metric depth of a "
                "U-Net that reads images and has no state"
            )
        for outer, inner in zip(self.input_size, self.inner_size, strict=True):
            if outer % inner:
                raise ConfigError(
                    f"inner size {self.inner_size} does not divide input size {self.input_size}; "
                    "area downsampling inside the graph needs a whole factor"
                )

    @property
    def may_have_confidence(self) -> bool:
        """Whether a confidence head could read the last component's decoder."""
        last = self.components[-1]
        u_net = not last.is_recurrent and last.backbone not in DENSE
        return self.encoding == "metric" and u_net and not self.reads_depth

    @property
    def reads_depth(self) -> bool:
        """Whether this is an autoencoder of depth, which sees no image and cannot be exported."""
        return self.components[0].reads == "depth"

    @property
    def downsampling(self) -> tuple[int, int]:
        """Whole factors (vertical, horizontal) from input size to inner size."""
        return (
            self.input_size[0] // self.inner_size[0],
            self.input_size[1] // self.inner_size[1],
        )

    def component(self, name: str) -> ComponentSpec:
        """The component called `name`.

        # Errors
        `ConfigError` that lists the names.
        """
        for component in self.components:
            if component.name == name:
                return component
        names = ", ".join(component.name for component in self.components)
        raise ConfigError(f"no component `{name}` in `{self.architecture}`", hint=f"{names}")

    def outputs_of(self, component: ComponentSpec) -> int:
        """Output channels of a component: one logit per class, or as many as its task has."""
        return len(self.classes) if component.task == "segmentation" else _CHANNELS[component.task]

    def with_sizes(self, *, input_size: tuple[int, int], inner_size: tuple[int, int]) -> Self:
        """The same graph at other sizes: weights of a fully convolutional graph still fit."""
        return replace(self, input_size=input_size, inner_size=inner_size)

    def to_json(self) -> dict[str, Any]:
        """Plain JSON types, read back by `from_json`."""
        return {**asdict(self), "components": tuple(c.to_json() for c in self.components)}

    @classmethod
    def from_json(cls, values: dict[str, Any]) -> Self:
        """Rebuild a spec from `to_json`'s result, also after a round trip through JSON text."""
        return cls(
            **{
                **values,
                "components": tuple(map(ComponentSpec.from_json, values["components"])),
                "input_size": tuple(values["input_size"]),
                "inner_size": tuple(values["inner_size"]),
                "classes": tuple(values["classes"]),
                "camera": Camera(**values["camera"]),
            }
        )
