"""One component of a serial graph: a U-Net, with a state or without, or a dense system."""

from abc import ABC, abstractmethod
from itertools import chain
from typing import Self

import torch
from torch import nn
from torch.func import functional_call

from nunet_models.errors import ConfigError
from nunet_models.zoo.autoencoder import SkiplessDecoder, adapter
from nunet_models.zoo.backbones import build_unet
from nunet_models.zoo.dense import DENSE
from nunet_models.zoo.recurrent import RECURRENT
from nunet_models.zoo.spec import ComponentSpec

State = tuple[torch.Tensor, ...]
"""What a component's LSTM or GRU carries, each `[B, units, h, w]` of the encoder's last map."""


def build_component(
    spec: ComponentSpec, *, in_channels: int, out_channels: int, size: tuple[int, int]
) -> "Component":
    """The component that `spec` describes, for images of `size`, (height, width)."""
    if spec.backbone in DENSE:
        return DenseComponent(spec, in_channels=in_channels, out_channels=out_channels, size=size)
    if spec.is_recurrent:
        return RecurrentComponent(
            spec, in_channels=in_channels, out_channels=out_channels, size=size
        )
    return UNetComponent(spec, in_channels=in_channels, out_channels=out_channels)


class Component(nn.Module, ABC):
    """`[B, in, h, w]` to raw numbers `[B, out, h, w]`.

    Raw numbers are logits (segmentation, objectness) or the head's linear output (depth, normals).
    The names of its parts are those of the weights in checkpoints.
    """

    def __init__(self, spec: ComponentSpec) -> None:
        super().__init__()
        self.spec = spec

    @property
    @abstractmethod
    def head(self) -> nn.Conv2d | nn.Linear:
        """The last layer, which outputs the raw numbers."""

    @property
    def state_names(self) -> list[tuple[str, str]]:
        """Input and output in the model file of each tensor of the state; without one, none."""
        return []

    def load_weights(self, weights: dict[str, torch.Tensor]) -> None:
        """Take weights trained elsewhere.

        # Errors
        `ConfigError` when they are of another backbone, decoder or number of channels.
        """
        try:
            self.load_state_dict(weights)
        except RuntimeError as error:
            raise ConfigError(
                f"the weights do not fit component `{self.spec.name}` "
                f"({self.spec.backbone}, decoder {self.spec.decoder_channels}): {error}"
            ) from error

    def freeze(self) -> None:
        """Stop all learning here, batch-norm statistics included (see `train`)."""
        self.requires_grad_(False)
        self.eval()

    @property
    def frozen(self) -> bool:
        """Whether no parameter of this component learns."""
        return _is_frozen(self)

    def train(self, mode: bool = True) -> Self:
        """Enter or leave training; a frozen component stays as it is evaluated."""
        return super().train(mode and not self.frozen)


class DenseComponent(Component):
    """One of the paper's systems that end in dense layers (`zoo.dense`)."""

    def __init__(
        self,
        spec: ComponentSpec,
        *,
        in_channels: int,
        out_channels: int,
        size: tuple[int, int],
    ) -> None:
        super().__init__(spec)
        self.dense = DENSE[spec.backbone](
            in_channels=in_channels, out_channels=out_channels, size=size, width=spec.width
        )

    @property
    def head(self) -> nn.Linear:
        """The last layer, which outputs the raw numbers."""
        return self.dense.head

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """Raw numbers of one image."""
        return self.dense(x)


class UNetComponent(Component):
    """A U-Net; with `latent` channels, one whose decoder reads such a map alone."""

    def __init__(self, spec: ComponentSpec, *, in_channels: int, out_channels: int) -> None:
        super().__init__(spec)
        self.unet = build_unet(
            spec.backbone,
            in_channels=in_channels,
            out_channels=out_channels,
            decoder_channels=spec.decoder_channels,
            drop_path=spec.drop_path,
        )
        self.dropout = nn.Dropout2d(spec.dropout) if spec.dropout else nn.Identity()
        self.adapter = nn.Identity()
        if spec.latent:
            self.adapter = adapter(self.unet.encoder.out_channels[-1], spec.latent)
            self.unet.decoder = SkiplessDecoder(spec.latent, spec.decoder_channels)

    @property
    def head(self) -> nn.Conv2d:
        """The last layer, which outputs the raw numbers."""
        return self.unet.segmentation_head[0]

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """Raw numbers of one image."""
        return self._decoded(self.unet.encoder(x))

    def with_maps(self, x: torch.Tensor) -> tuple[torch.Tensor, list[torch.Tensor]]:
        """Raw numbers of one image, and the maps of the decoder, the deepest first.

        For a U-Net without a state. The decoder's own `forward` does the same and keeps no map.
        """
        encoded = self.unet.encoder(x)
        found = self.unet.decoder.center(self.adapter(encoded[-1]))
        maps = []
        levels = range(len(encoded) - 2, -1, -1)
        for level, block in zip(levels, self.unet.decoder.blocks, strict=True):
            height, width = encoded[level].shape[2:]
            skips = level > 0 and not self.spec.latent  # level 0 is the image itself
            skip = encoded[level] if skips else None
            found = block(found, height, width, skip_connection=skip)
            maps.append(found)
        return self.unet.segmentation_head(self.dropout(found)), maps

    def _decoded(self, maps: list[torch.Tensor]) -> torch.Tensor:
        maps = [*maps[:-1], self.adapter(maps[-1])]
        return self.unet.segmentation_head(self.dropout(self.unet.decoder(maps)))

    def freeze_decoder(self) -> None:
        """Stop all learning of decoder and head; encoder and adapter still learn."""
        for part in (self.unet.decoder, self.unet.segmentation_head):
            part.requires_grad_(False)
        self.train(self.training)

    def train(self, mode: bool = True) -> Self:
        """Enter or leave training; what is frozen, decoder or all, stays as it is evaluated."""
        super().train(mode)
        if _is_frozen(self.unet.decoder):
            self.unet.decoder.eval()
        return self


class RecurrentComponent(UNetComponent):
    """A U-Net with a convolutional LSTM or GRU at the bottleneck (`zoo.recurrent`).

    This part is called `memory` in checkpoints and in the names of a model file's weights.
    """

    def __init__(
        self,
        spec: ComponentSpec,
        *,
        in_channels: int,
        out_channels: int,
        size: tuple[int, int],
    ) -> None:
        super().__init__(spec, in_channels=in_channels, out_channels=out_channels)
        channels = self.unet.encoder.out_channels[-1]
        self.memory = RECURRENT[spec.recurrence](channels, spec.state_units)
        self.bottleneck = _last_map(self.unet.encoder, in_channels, size)

    @property
    def state_names(self) -> list[tuple[str, str]]:
        """Input and output in the model file of each tensor of the state, float32.

        Zeros go in before the first frame and after every discontinuity of the stream; each output
        is the next frame's input.
        """
        return [(f"{name}_in", f"{name}_out") for name in self.memory.state]

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """Raw numbers of the first image of a stream."""
        return self.with_state(x, self.no_state(len(x)))[0]

    def with_state(self, x: torch.Tensor, state: State) -> tuple[torch.Tensor, State]:
        """Raw numbers of the next image of a stream, and the state to pass with the one after."""
        maps = list(self.unet.encoder(x))
        maps[-1], *state = self.memory(maps[-1], *state)
        return self._decoded(maps), tuple(state)

    def over_frames(self, x: torch.Tensor, frames: int) -> torch.Tensor:
        """Raw numbers of the frames of several videos, each from no state on.

        `x` is `[frames * B, in, h, w]`: the first frame of every video, then the second ones.
        """
        # Encoder and decoder see all frames at once, so batch norm has the statistics of all.
        maps = list(self.unet.encoder(x))
        state: tuple | list = self.no_state(len(x) // frames)
        deepest = []
        for frame in maps[-1].chunk(frames):
            changed, *state = self.memory(frame, *state)
            deepest.append(changed)
        maps[-1] = torch.cat(deepest)
        return self._decoded(maps)

    def no_state(self, batch: int = 1) -> State:
        """The state before the first image: zeros."""
        shape = (batch, self.spec.state_units, *self.bottleneck)
        return tuple(torch.zeros(shape) for _ in self.memory.state)


def _is_frozen(module: nn.Module) -> bool:
    return not any(p.requires_grad for p in module.parameters())


def _last_map(encoder: nn.Module, in_channels: int, size: tuple[int, int]) -> tuple[int, int]:
    """Height and width of an encoder's last map; sides that 32 does not divide may be rounded up.

    Found by a pass on torch's meta device, without data.
    """
    everything = chain(encoder.named_parameters(), encoder.named_buffers())
    shapes = {name: torch.empty_like(tensor, device="meta") for name, tensor in everything}
    encoder.eval()  # batch norm cannot train on one value per channel
    image = torch.empty(1, in_channels, *size, device="meta")
    last = functional_call(encoder, shapes, (image,))[-1]
    encoder.train()
    return tuple(last.shape[2:])
