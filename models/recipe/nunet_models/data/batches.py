"""Batches of augmented samples, the same for the same seed, epoch and position."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch.utils.data import DataLoader, Dataset

from nunet_models.data.augment import Augmentation, Sample, augmented
from nunet_models.data.cache import Cached


@dataclass(frozen=True)
class Batch:
    """`rgb` uint8 `[B, 3, h, w]`, `depth_m` float32 `[B, 1, h, w]` (NaN = none), `labels` int64
    `[B, h, w]`."""  # noqa: D205, D209

    rgb: torch.Tensor
    depth_m: torch.Tensor
    labels: torch.Tensor


def loader_of(samples: Dataset, order: Sequence[int], *, batch: int, workers: int) -> DataLoader:
    """Loads the samples at the places `order`, `batch` at a time."""
    return DataLoader(
        samples,
        batch_size=batch,
        sampler=order,
        num_workers=workers,
        generator=torch.Generator(),  # otherwise the loader would consume the run's random numbers
    )


class _Epoch(Dataset):
    def __init__(
        self, data: Cached, how: Augmentation, size: tuple[int, int], seed: int, epoch: int
    ) -> None:
        self.data, self.how, self.size, self.key = data, how, size, (seed, epoch)

    def __len__(self) -> int:
        return len(self.data)

    def __getitem__(self, index: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        # Randomness hangs on the image's place alone, so a resumed or a differently
        # parallelized run draws the same.
        random = np.random.default_rng((*self.key, index))
        whole = Sample(self.data.rgb[index], self.data.depth_m(index), self.data.labels[index])
        return augmented(whole, self.how, size=self.size, random=random).planes()


def epoch_batches(  # noqa: PLR0913  (every one of them changes what is drawn)
    data: Cached,
    how: Augmentation,
    *,
    size: tuple[int, int],
    batch: int,
    seed: int,
    epoch: int,
    shuffle: bool = True,
    first: int = 0,
    workers: int = 1,
) -> Iterator[Batch]:
    """Batches of one epoch in its own order, from batch `first` on; a last odd one is dropped.

    Without `shuffle` all samples come in order and none is dropped.
    """
    order = np.arange(len(data))
    if shuffle:
        np.random.default_rng((seed, epoch)).shuffle(order)
        order = order[: len(order) // batch * batch][first * batch :]
    loader = loader_of(
        _Epoch(data, how, size, seed, epoch), order.tolist(), batch=batch, workers=workers
    )
    for rgb, depth_m, labels in loader:
        yield Batch(rgb, depth_m, labels)
