"""N components in series: the network that trains, without the model file's byte tensors."""

from collections.abc import Callable, Iterable, Sequence

import torch
from torch import nn

from nunet_models.zoo.autoencoder import DEPTH_PLANES
from nunet_models.zoo.component import Component, State, build_component
from nunet_models.zoo.confidence import CONFIDENCE, ConfidenceHead
from nunet_models.zoo.spec import GraphSpec


class SerialGraph(nn.Module):
    """Components in series; each later one reads the raw numbers of the one before it.

    A *connected* component reads the image as well, image channels first. Raw numbers cross the
    joint (a sigmoid only where the spec keeps the paper's): softmax would hide the confidence of
    the earlier component, and costs time.
    """

    def __init__(self, spec: GraphSpec) -> None:
        super().__init__()
        self.spec = spec
        self.components = nn.ModuleList()
        before = 0
        for index, component in enumerate(spec.components):
            sees_image = component.connected or index == 0
            planes = DEPTH_PLANES if component.reads == "depth" else 3
            out_channels = spec.outputs_of(component)
            self.components.append(
                build_component(
                    component,
                    in_channels=before + (planes if sees_image else 0),
                    out_channels=out_channels,
                    size=spec.inner_size,
                )
            )
            before = out_channels
        last = spec.components[-1]
        self.confidence = ConfidenceHead(last.decoder_channels) if spec.confidence else None

    def component(self, name: str) -> Component | ConfidenceHead:
        """The component called `name`, or the head called `confidence` if there is one."""
        if name == CONFIDENCE and self.confidence is not None:
            return self.confidence
        return self.components[self.spec.components.index(self.spec.component(name))]

    def forward(self, image: torch.Tensor) -> list[torch.Tensor]:
        """Image `[B, 3, h, w]`, normalized, to the raw numbers of every component in order."""
        return self.run(image, self.components)

    def run(
        self,
        image: torch.Tensor,
        calls: Iterable[Callable[[torch.Tensor], torch.Tensor]],
        *,
        before: Sequence[torch.Tensor] = (),
    ) -> list[torch.Tensor]:
        """Raw numbers of the components in order: those of `before`, then the results of `calls`.

        A call takes what its component reads and returns raw numbers. It is the component itself,
        or a function that calls it.
        """
        outputs = list(before)
        for call in calls:
            outputs.append(call(self.joint(image, outputs)))
        return outputs

    def with_maps(self, image: torch.Tensor) -> tuple[list[torch.Tensor], list[torch.Tensor]]:
        """As `forward`, and the maps of the last component's decoder, the deepest first."""
        outputs = self.run(image, self.components[:-1])
        raw, maps = self.components[-1].with_maps(self.joint(image, outputs))
        return [*outputs, raw], maps

    def with_confidence(self, image: torch.Tensor) -> tuple[list[torch.Tensor], torch.Tensor]:
        """As `forward`, and the logarithm of depth's expected relative error (`zoo.confidence`)."""
        outputs, maps = self.with_maps(image)
        return outputs, self.confidence(maps)

    def with_state(self, image: torch.Tensor, state: State) -> tuple[list[torch.Tensor], State]:
        """As `forward`, for the next image of a stream; the last component carries the state."""
        outputs = self.run(image, self.components[:-1])
        raw, state = self.components[-1].with_state(self.joint(image, outputs), state)
        return [*outputs, raw], state

    def joint(self, image: torch.Tensor, outputs: list[torch.Tensor]) -> torch.Tensor:
        """What the next component reads, given the outputs so far."""
        if not outputs:
            return image
        features = outputs[-1]
        if self.spec.components[len(outputs) - 1].sigmoid_joint:
            features = features.sigmoid()
        if self.spec.components[len(outputs)].connected:
            return torch.cat([image, features], dim=1)
        return features
