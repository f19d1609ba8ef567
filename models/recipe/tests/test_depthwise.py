"""Gradients of our own against PyTorch's in single precision."""

import pytest
import torch
from timm.layers.conv2d_same import Conv2dSame
from torch import nn

from nunet_models.training.depthwise import use_fast_kernels

ROUNDING = 0.01  # bfloat16 has 8 bits; PyTorch's own bfloat16 gradients are off by 0.004


def layers(kind, kernel, stride, channels):
    torch.manual_seed(0)
    padding = kernel // 2 if kind is nn.Conv2d else 0
    made = [
        kind(channels, channels, kernel, stride, padding, groups=channels, bias=False)
        for _ in range(2)
    ]
    made[1].load_state_dict(made[0].state_dict())
    use_fast_kernels(made[0])
    return made


def answer(layer, x, *, bf16):
    x = x.clone().requires_grad_()
    with torch.autocast("cpu", torch.bfloat16, enabled=bf16):
        y = layer(x)
    y.float().mul(torch.linspace(-1, 1, y.numel()).reshape(y.shape)).sum().backward()
    return y.detach().float(), x.grad, layer.weight.grad


@pytest.mark.parametrize(
    ("kind", "kernel", "stride", "size"),
    [
        (nn.Conv2d, 5, 1, (8, 10)),
        (nn.Conv2d, 3, 2, (15, 20)),
        (Conv2dSame, 3, 2, (15, 20)),
        (Conv2dSame, 5, 2, (16, 21)),
    ],
)
def test_gradients_are_those_of_pytorch(kind, kernel, stride, size):
    ours, theirs = layers(kind, kernel, stride, channels=48)
    assert type(ours) is not type(theirs), "the layer was not taken"
    x = torch.randn(2, 48, *size).contiguous(memory_format=torch.channels_last)
    expected = answer(theirs, x, bf16=False)
    for found, wanted in zip(answer(ours, x, bf16=True), expected, strict=True):
        assert (found - wanted).abs().max() < ROUNDING * wanted.abs().max()


def test_evaluation_and_single_precision_stay_as_they_were():
    ours, theirs = layers(Conv2dSame, 3, 2, channels=16)
    x = torch.randn(1, 16, 9, 9)
    assert torch.equal(ours(x), theirs(x))
    with torch.autocast("cpu", torch.bfloat16):
        assert torch.equal(ours.eval()(x), theirs.eval()(x))


@pytest.mark.parametrize(
    "layer",
    [
        nn.Conv2d(16, 16, 3, 1, 1, groups=16, bias=False),  # oneDNN is quick at it
        nn.Conv2d(16, 16, 5, 1, 2, bias=False),
        nn.Conv2d(24, 24, 5, 1, 2, groups=24, bias=False),  # no multiple of 16
        nn.Conv2d(16, 16, 7, 1, 3, groups=16, bias=False),
    ],
)
def test_other_layers_are_left_alone(layer):
    before = type(layer)
    use_fast_kernels(layer)
    assert type(layer) is before
