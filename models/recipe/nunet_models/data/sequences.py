"""Batches of consecutive frames of videos, for components that carry a state."""

import re
from collections.abc import Iterator, Sequence

import numpy as np
from torch.utils.data import Dataset

from nunet_models.data.augment import Augmentation, Sample, augmented
from nunet_models.data.batches import Batch, loader_of
from nunet_models.data.cache import Cached

_NUMBER = re.compile(r"\d+$")


def video_of(identity: str) -> str:
    """The video that a frame belongs to: its id without the number at the end."""
    return _NUMBER.sub("", identity)


def window_starts(ids: Sequence[str], frames: int) -> list[int]:
    """Places in `ids` where `frames` consecutive ids of one video begin."""
    videos = [video_of(identity) for identity in ids]
    last = len(ids) - frames
    return [s for s in range(last + 1) if len(set(videos[s : s + frames])) == 1]


class _Windows(Dataset):
    def __init__(
        self,
        data: Cached,
        how: Augmentation,
        *,
        size: tuple[int, int],
        frames: int,
        key: tuple[int, int],
    ) -> None:
        self.data, self.how, self.size, self.frames, self.key = data, how, size, frames, key

    def __getitem__(self, start: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        samples = [self._sample(start, start + offset).planes() for offset in range(self.frames)]
        rgb, depth_m, labels = (np.stack(planes) for planes in zip(*samples, strict=True))
        return rgb, depth_m, labels

    def _sample(self, start: int, index: int) -> Sample:
        # The same numbers for all frames of a window: the camera must not change between them.
        random = np.random.default_rng((*self.key, start))
        whole = Sample(self.data.rgb[index], self.data.depth_m(index), self.data.labels[index])
        return augmented(whole, self.how, size=self.size, random=random)


def sequence_batches(  # noqa: PLR0913  (every one of them changes what is drawn)
    data: Cached,
    how: Augmentation,
    *,
    size: tuple[int, int],
    frames: int,
    batch: int,
    seed: int,
    epoch: int,
    first: int = 0,
    workers: int = 1,
) -> Iterator[Batch]:
    """Batches of one epoch, in which each window of `frames` frames occurs once.

    A batch has `frames * batch` images: the first frame of every window, then the second ones. A
    last odd batch is dropped. Augmentation is the same for all frames of a window.
    """
    starts = np.array(window_starts(data.ids, frames))
    np.random.default_rng((seed, epoch)).shuffle(starts)
    starts = starts[: len(starts) // batch * batch][first * batch :]
    loader = loader_of(
        _Windows(data, how, size=size, frames=frames, key=(seed, epoch)),
        starts.tolist(),
        batch=batch,
        workers=workers,
    )
    for parts in loader:
        yield Batch(*(part.transpose(0, 1).flatten(0, 1) for part in parts))
