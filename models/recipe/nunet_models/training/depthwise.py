"""Depth-wise convolutions that train quickly on a CPU.

oneDNN 3.x has no fast kernel for the gradients of 5x5 and of strided depth-wise layers: of a step
of an EfficientNet-Lite0 U-Net (bfloat16, batch 8, two cores with AMX) they take 0.6 of 1.2 s.
`depthwise.cpp` takes a tenth of that. Everything else is computed by PyTorch.
"""

import functools
import os
from pathlib import Path
from types import ModuleType
from typing import Any

import ninja
import torch
import torch.nn.functional as F
from timm.layers.conv2d_same import Conv2dSame
from timm.layers.padding import pad_same
from torch import nn
from torch.utils import cpp_extension

_LANES = 16


@functools.cache
def _kernels() -> ModuleType:
    # PyTorch looks for ninja on the path, where an environment that was not activated has none.
    os.environ["PATH"] = os.pathsep.join([ninja.BIN_DIR, os.environ.get("PATH", os.defpath)])
    return cpp_extension.load(
        "nunet_depthwise",
        [str(Path(__file__).with_name("depthwise.cpp"))],
        extra_cflags=["-O3", "-march=native", "-ffast-math"],
    )


@torch.library.custom_op("nunet::depthwise", mutates_args=())
def _depthwise(x: torch.Tensor, weight: torch.Tensor, stride: int, padding: int) -> torch.Tensor:
    return F.conv2d(x, weight, None, stride, padding, 1, x.shape[1])


@_depthwise.register_fake
def _(x: torch.Tensor, weight: torch.Tensor, stride: int, padding: int) -> torch.Tensor:
    return F.conv2d(x, weight, None, stride, padding, 1, x.shape[1])


@torch.library.custom_op("nunet::depthwise_gradients", mutates_args=())
def _gradients(
    g: torch.Tensor, x: torch.Tensor, weight: torch.Tensor, stride: int, padding: int
) -> tuple[torch.Tensor, torch.Tensor]:
    channels, k = x.shape[1], weight.shape[-1]
    g = g.contiguous(memory_format=torch.channels_last)
    padded = F.pad(x, (padding,) * 4) if padding else x
    padded = padded.contiguous(memory_format=torch.channels_last)
    sums = _kernels().weight_gradient(padded, g, k, stride)
    of_weight = sums.transpose(1, 2).reshape(channels, 1, k, k).to(weight.dtype)
    if stride == 1 or padding:
        of_x = torch.nn.grad.conv2d_input(x.shape, weight, g, stride, padding, 1, channels)
        return of_x.contiguous(memory_format=torch.channels_last), of_weight
    taps = weight.float().reshape(channels // _LANES, _LANES, k * k).transpose(1, 2).contiguous()
    of_x = torch.empty_like(x, memory_format=torch.channels_last)
    _kernels().input_gradient(taps, g, k, stride, of_x)
    return of_x, of_weight


@_gradients.register_fake
def _(
    g: torch.Tensor, x: torch.Tensor, weight: torch.Tensor, stride: int, padding: int
) -> tuple[torch.Tensor, torch.Tensor]:
    del g, stride, padding
    return torch.empty_like(x, memory_format=torch.channels_last), torch.empty(
        weight.shape, dtype=weight.dtype, device=weight.device
    )


def _save_inputs(ctx: Any, inputs: tuple, output: torch.Tensor) -> None:  # noqa: ANN401
    del output
    x, weight, ctx.stride, ctx.padding = inputs
    ctx.save_for_backward(x, weight)


def _backward(ctx: Any, g: torch.Tensor) -> tuple:  # noqa: ANN401
    of_x, of_weight = _gradients(g, *ctx.saved_tensors, ctx.stride, ctx.padding)
    return of_x, of_weight, None, None


_depthwise.register_autograd(_backward, setup_context=_save_inputs)


def _quick(conv: nn.Conv2d, x: torch.Tensor) -> torch.Tensor:
    x, weight = x.to(torch.bfloat16), conv.weight.to(torch.bfloat16)
    return _depthwise(x, weight, conv.stride[0], conv.padding[0])


class _Plain(nn.Conv2d):
    def forward(self, x: torch.Tensor) -> torch.Tensor:
        applies = self.training and torch.is_autocast_enabled("cpu")
        return _quick(self, x) if applies else super().forward(x)


class _Same(Conv2dSame):
    def forward(self, x: torch.Tensor) -> torch.Tensor:
        applies = self.training and torch.is_autocast_enabled("cpu")
        if not applies:
            return super().forward(x)
        return _quick(self, pad_same(x, self.weight.shape[-2:], self.stride, self.dilation))


_QUICK = {nn.Conv2d: _Plain, Conv2dSame: _Same}


def use_fast_kernels(module: nn.Module) -> None:
    """Train the slow depth-wise layers of `module` with `depthwise.cpp`, in bfloat16.

    Weights keep their names, and evaluation stays as it was.
    """
    for layer in module.modules():
        if type(layer) in _QUICK and _slow(layer):
            layer.__class__ = _QUICK[type(layer)]


def _slow(conv: nn.Conv2d) -> bool:
    """Whether oneDNN is slow for it and `depthwise.cpp` supports it."""
    depthwise = conv.groups == conv.in_channels == conv.out_channels
    square = conv.kernel_size[0] == conv.kernel_size[1] and conv.stride[0] == conv.stride[1]
    known = conv.kernel_size[0] in {3, 5} and conv.in_channels % _LANES == 0
    slow = conv.kernel_size[0] == 5 or conv.stride[0] > 1
    return depthwise and square and known and slow and conv.bias is None and conv.dilation == (1, 1)
