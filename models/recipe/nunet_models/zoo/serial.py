"""N components in series: the network that trains, without the model file's byte tensors."""

import torch
from torch import nn

from nunet_models.zoo.backbones import build_unet
from nunet_models.zoo.spec import ComponentSpec, GraphSpec


class Component(nn.Module):
    """One U-Net of a serial graph: `[B, in, h, w]` to raw numbers `[B, out, h, w]`.

    Raw numbers are logits (segmentation) or the head's linear output (depth).
    """

    def __init__(self, spec: ComponentSpec, *, in_channels: int, out_channels: int) -> None:
        super().__init__()
        self.spec = spec
        self.unet = build_unet(
            spec.backbone,
            in_channels=in_channels,
            out_channels=out_channels,
            decoder_channels=spec.decoder_channels,
            drop_path=spec.drop_path,
        )
        self.dropout = nn.Dropout2d(spec.dropout) if spec.dropout else nn.Identity()

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """Encoder, decoder, dropout of whole channels, linear head."""
        decoded = self.unet.decoder(self.unet.encoder(x))
        return self.unet.segmentation_head(self.dropout(decoded))

    def freeze(self) -> None:
        """Stop all learning here, batch-norm statistics included (see `train`)."""
        self.requires_grad_(False)
        self.eval()

    @property
    def frozen(self) -> bool:
        """Whether no parameter of this component learns."""
        return not any(p.requires_grad for p in self.parameters())

    def train(self, mode: bool = True) -> "Component":
        """Enter or leave training; a frozen component stays as it is evaluated."""
        return super().train(mode and not self.frozen)


class SerialGraph(nn.Module):
    """Components in series; each later one reads the raw numbers of the one before it.

    A *connected* component reads the image as well, image channels first. Raw numbers cross the
    joint (a sigmoid only where the spec keeps the paper's): softmax would hide how sure the
    earlier component is, and costs time.
    """

    def __init__(self, spec: GraphSpec) -> None:
        super().__init__()
        self.spec = spec
        self.components = nn.ModuleList()
        before = 0
        for index, component in enumerate(spec.components):
            sees_image = component.connected or index == 0
            out_channels = spec.outputs_of(component)
            self.components.append(
                Component(
                    component,
                    in_channels=before + (3 if sees_image else 0),
                    out_channels=out_channels,
                )
            )
            before = out_channels

    def forward(self, image: torch.Tensor) -> list[torch.Tensor]:
        """Image `[B, 3, h, w]`, normalised, to the raw numbers of every component in order."""
        outputs: list[torch.Tensor] = []
        for component in self.components:
            outputs.append(component(self.joint(image, outputs)))
        return outputs

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
