"""Several sets as one collection to train on, each room drawn as often as its weight says."""

import hashlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from torch.utils.data import Dataset

from nunet_models.data.batches import Batch, loader_of
from nunet_models.data.sets.draw import Shapes, ViewRanges, sample
from nunet_models.data.sets.entry import SetEntry, read_dataset_list
from nunet_models.data.sets.folder import CameraImage, CameraSet
from nunet_models.errors import ConfigError


@dataclass
class Mixture:
    """The sets of one use ("train" or "val") of a dataset list."""

    entries: Sequence[SetEntry]
    sets: list[CameraSet] = field(init=False)
    index: list[tuple[int, int]] = field(init=False)
    """Set and place in it, by place in the mixture."""
    chances: np.ndarray = field(init=False)

    def __post_init__(self) -> None:
        self.sets = [CameraSet(entry) for entry in self.entries]
        self._count()

    def refresh(self) -> None:
        """Read the folders again that are still growing."""
        for place, entry in enumerate(self.entries):
            if entry.growing:
                self.sets[place] = CameraSet(entry)
        self._count()

    def _count(self) -> None:
        self.index = [(s, i) for s, of in enumerate(self.sets) for i in range(len(of))]
        weights = [of.room_weights() for of in self.sets]
        total = np.concatenate(weights) if weights else np.empty(0)
        self.chances = total / total.sum() if len(total) else total

    def __len__(self) -> int:
        """How many images there are now."""
        return len(self.index)

    def __getitem__(self, place: int) -> CameraImage:
        """Read an image."""
        s, i = self.index[place]
        return self.sets[s][i]

    @property
    def ids(self) -> list[str]:
        """`SET/ID` of every image."""
        return [f"{self.sets[s].entry.name}/{self.sets[s].ids[i]}" for s, i in self.index]

    def drawn(self, count: int, *, seed: int, epoch: int) -> np.ndarray:
        """Places of the images of one epoch, drawn with replacement."""
        random = np.random.default_rng((seed, epoch, 1))
        return random.choice(len(self), size=count, p=self.chances)


def open_dataset_list(path: Path) -> tuple[Mixture, Mixture]:
    """Training and validation sets of a dataset list.

    # Errors
    `DataError` of `read_dataset_list` and `CameraSet`; `ConfigError` where both would share an
    image or a scene.
    """
    entries = read_dataset_list(path)
    both = [Mixture([e for e in entries if e.use == use]) for use in ("train", "val")]
    for mixture, use in zip(both, ("train", "val"), strict=True):
        if not mixture.entries:
            raise ConfigError(f'{path}: no set with `use = "{use}"`')
    _check_apart(*both)
    return both[0], both[1]


def _check_apart(train: Mixture, val: Mixture) -> None:
    """Refuse images or scenes that are in both training and validation sets."""
    known: dict[tuple[Path, str], str] = {}
    for of in train.sets:
        for place, identity in enumerate(of.ids):
            for key in _keys(of, place, identity):
                known[key] = of.entry.name
    for of in val.sets:
        for place, identity in enumerate(of.ids):
            for key in _keys(of, place, identity):
                if key in known:
                    raise ConfigError(
                        f"{of.entry.where}: `{key[1]}` is also in the training set `{known[key]}`"
                    )


def _keys(of: CameraSet, place: int, identity: str) -> list[tuple[Path, str]]:
    root = of.entry.root.resolve()
    room = of.room(place)
    return [(root, f"image {identity}"), *([(root, f"scene {room}")] if room else [])]


class _Views(Dataset):
    def __init__(
        self, mixture: Mixture, places: np.ndarray, ranges: ViewRanges, how: Shapes, key: tuple
    ) -> None:
        self.mixture, self.places, self.ranges = mixture, places, ranges
        self.how, self.key = how, key

    def __len__(self) -> int:
        return len(self.places)

    def __getitem__(self, step: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        # Randomness depends on the place in the epoch alone: a resumed run draws the same.
        random = np.random.default_rng((*self.key, step))
        image = self.mixture[int(self.places[step])]
        return sample(image, self.ranges, how=self.how, random=random).planes()


def mixed_batches(  # noqa: PLR0913  (every one of them changes what is drawn)
    mixture: Mixture,
    ranges: ViewRanges,
    *,
    how: Shapes,
    count: int,
    batch: int,
    seed: int,
    epoch: int,
    first: int = 0,
    workers: int = 1,
) -> Iterator[Batch]:
    """Batches of an epoch of `count` images, from batch `first` on; a last odd one is dropped."""
    places = mixture.drawn(count, seed=seed, epoch=epoch)
    views = _Views(mixture, places, ranges, how, (seed, epoch))
    loader = loader_of(
        views, range(first * batch, count // batch * batch), batch=batch, workers=workers
    )
    for rgb, depth_m, labels in loader:
        yield Batch(rgb, depth_m, labels)


def mixture_summary(mixture: Mixture) -> list[dict[str, object]]:
    """What a checkpoint records of each set: its name, images and the SHA-256 of their ids."""
    found = []
    for of in mixture.sets:
        text = "".join(f"{identity}\n" for identity in of.ids)
        digest = hashlib.sha256(text.encode()).hexdigest()
        rooms = len({of.room(i) for i in range(len(of))})
        found.append(
            {
                "set": of.entry.name,
                "images": len(of),
                "rooms": rooms,
                "ids_sha256": digest,
                "growing": of.entry.growing,
            }
        )
    return found
