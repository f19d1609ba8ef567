"""Shared fixtures: a small made dataset, so that no test needs real data or a network."""

import os
from pathlib import Path

os.environ.setdefault("CUDA_VISIBLE_DEVICES", "")

import numpy as np
import pytest
import torch
from PIL import Image

from nunet_models.data.pairs import DepthUnits, FolderPairs

COUNT = 6
SIZE = (96, 128)


@pytest.fixture(autouse=True)
def one_thread():
    torch.set_num_threads(1)


@pytest.fixture
def every_step_logged(monkeypatch):
    monkeypatch.setattr("nunet_models.training.trainer.LOG_EVERY", 1)


def write_dataset(root: Path, *, count: int = COUNT, size: tuple[int, int] = SIZE) -> list[str]:
    """Images whose brightness tells the depth: 16-bit millimeters, labels by thirds."""
    for name in ("rgb", "depth", "label40"):
        (root / name).mkdir(parents=True, exist_ok=True)
    random = np.random.default_rng(5)
    ids = [f"{i:04d}" for i in range(count)]
    height, width = size
    for identity in ids:
        ramp = np.linspace(0, 1, height)[:, None] * np.ones(width)
        depth = 1.0 + 3.0 * ramp + 0.3 * random.random()
        rgb = np.stack([60 * depth, 40 * depth, 200 - 30 * depth], axis=2)
        rgb += random.normal(0, 4, rgb.shape)
        labels = np.repeat([11, 0, 1], height // 3)[:, None] * np.ones(width)
        Image.fromarray(rgb.clip(0, 255).astype(np.uint8)).save(root / "rgb" / f"{identity}.png")
        Image.fromarray((depth * 1000).astype(np.uint16)).save(root / "depth" / f"{identity}.png")
        Image.fromarray(labels.astype(np.uint8)).save(root / "label40" / f"{identity}.png")
    (root / "train.txt").write_text("\n".join(ids[:4]))
    (root / "val.txt").write_text("\n".join(ids[4:]))
    return ids


@pytest.fixture
def dataset(tmp_path):
    root = tmp_path / "rooms"
    write_dataset(root)
    return root


@pytest.fixture
def pairs(dataset):
    ids = sorted(p.stem for p in (dataset / "rgb").iterdir())
    return FolderPairs(dataset, ids, units=DepthUnits())
