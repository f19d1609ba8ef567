"""Figures of a graph on a validation set while it trains."""

import torch
import torch.nn.functional as F

from nunet_models.data.augment import NO_AUGMENTATION
from nunet_models.data.batches import epoch_batches
from nunet_models.data.cache import Cached
from nunet_models.evaluation.protocol import EIGEN, FULL
from nunet_models.export.deploy import decode_depth, normalise
from nunet_models.metrics import DepthMetrics, LabelMetrics
from nunet_models.zoo import SerialGraph


@torch.no_grad()
def validate(
    graph: SerialGraph, data: Cached, *, component: int, batch: int, bf16: bool
) -> dict[str, float]:
    """Depth or label figures of component `component` over `data`, at the pictures' own size.

    Depth is resized bilinearly and cropped as `EIGEN` where the size fits; labels are compared
    over the whole picture.
    """
    spec = graph.spec
    depth, labels = DepthMetrics(), LabelMetrics(len(spec.classes))
    size = data.depth.shape[1:]
    protocol = EIGEN if tuple(size) == EIGEN.size else FULL
    segments = spec.components[component].task == "segmentation"
    start = 0
    for samples in epoch_batches(
        data, NO_AUGMENTATION, size=spec.inner_size, batch=batch, seed=0, epoch=0, shuffle=False
    ):
        image = normalise(samples.rgb).contiguous(memory_format=torch.channels_last)
        with torch.autocast("cpu", torch.bfloat16, enabled=bf16):
            outputs: list[torch.Tensor] = []
            for module in graph.components[: component + 1]:
                outputs.append(module(graph.joint(image, outputs)))
        raw = outputs[-1].float()
        if segments:
            found = raw.argmax(1, keepdim=True).to(torch.uint8)
            found = F.interpolate(found, size=size, mode="nearest")[:, 0].numpy()
        else:
            found = F.interpolate(decode_depth(raw, spec), size=size, mode="bilinear")[:, 0].numpy()
        for offset, picture in enumerate(found):
            if segments:
                labels.add(picture, data.labels[start + offset])
            else:
                truth = data.depth_m(start + offset)
                depth.add(protocol.depth(picture), protocol.depth(truth))
        start += len(found)
    return labels.figures() if segments else depth.figures()
