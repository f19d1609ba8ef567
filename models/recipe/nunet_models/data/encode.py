"""Meters to the encoding that a graph is trained to output."""

import torch

from nunet_models.zoo.spec import Encoding


def encoded_depth(depth_m: torch.Tensor, encoding: Encoding) -> torch.Tensor:
    """Depth `[B, 1, h, w]` in meters (NaN = none) to the graph's encoding, same shape.

    `minmax` stretches each image from its nearest (0) to its farthest point (1): the paper's
    target, which loses the scale. A flat image becomes 0.
    """
    if encoding == "metric":
        return depth_m
    flat = depth_m.flatten(1)
    nearest = flat.nan_to_num(nan=torch.inf).min(1).values[:, None, None, None]
    farthest = flat.nan_to_num(nan=-torch.inf).max(1).values[:, None, None, None]
    return (depth_m - nearest) / (farthest - nearest).clamp(min=1e-6)
