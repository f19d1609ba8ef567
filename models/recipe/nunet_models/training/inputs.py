"""What the first component of a graph reads from a batch."""

import torch

from nunet_models.data.batches import Batch
from nunet_models.zoo import GraphSpec
from nunet_models.zoo.autoencoder import depth_planes, with_holes
from nunet_models.zoo.deploy import normalize


def network_input(spec: GraphSpec, batch: Batch, *, learning: bool) -> torch.Tensor:
    """The normalized image `[B, 3, h, w]`; for an autoencoder true depth, `[B, 2, h, w]`.

    An autoencoder that is learning sees a part of the depth only (`zoo.autoencoder.with_holes`).
    """
    if spec.reads_depth:
        depth_m = with_holes(batch.depth_m) if learning else batch.depth_m
        planes = depth_planes(depth_m)
    else:
        planes = normalize(batch.rgb)
    return planes.contiguous(memory_format=torch.channels_last)
