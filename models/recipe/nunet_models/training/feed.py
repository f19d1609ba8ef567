"""The data of a training: one folder (`--data`), or the cameras of a dataset list (`--sets`)."""

import argparse
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar, Protocol

import numpy as np

from nunet_models.data.batches import Batch, epoch_batches
from nunet_models.data.cache import Cached
from nunet_models.data.sequences import sequence_batches, window_starts
from nunet_models.data.sets.draw import Shapes
from nunet_models.data.sets.mixture import Mixture, mixed_batches
from nunet_models.errors import OptionError
from nunet_models.tasks.inner import INNER_TASKS
from nunet_models.training.provenance import folder_provenance, sets_provenance
from nunet_models.training.settings import AUGMENTATIONS, VIEWS, Settings
from nunet_models.training.validate import predictions, validate
from nunet_models.training.validate_inner import validate_inner, whole_images, whole_views
from nunet_models.training.validate_sets import validate_sets
from nunet_models.zoo import SerialGraph
from nunet_models.zoo.confidence import CONFIDENCE

VALIDATION_BATCH = 8


class Feed(Protocol):
    """Batches to train on and images to validate on."""

    depth_error: ClassVar[str]
    """The metric of depth that chooses the best checkpoint."""

    def images(self) -> int:
        """Images of an epoch."""
        ...

    def has(self, what: str) -> dict[str, bool]:
        """Whether the data for "training" and "validation" have "labels" or "depth"."""
        ...

    def epoch(self, graph: SerialGraph, settings: Settings, epoch: int, first: int) -> Iterator:
        """Batches of an epoch from batch `first` on."""
        ...

    def label_counts(self) -> np.ndarray:
        """How many pixels have each label 0..255, of some of the images."""
        ...

    def validate(self, graph: SerialGraph, component: int, settings: Settings) -> dict[str, float]:
        """Metrics of the graph."""
        ...

    def shown(self, graph: SerialGraph, component: int, settings: Settings) -> np.ndarray:
        """The prediction that each validation keeps."""
        ...

    def provenance(self, options: argparse.Namespace) -> dict[str, Any]:
        """What a checkpoint records of the data."""
        ...


@dataclass
class FolderFeed:
    """Decoded images of one camera; `show` holds the image whose prediction is kept.

    With `frames` above 1 the images are frames of videos, and an epoch has windows of so many.
    """

    depth_error: ClassVar[str] = "rmse"

    train: Cached
    val: Cached
    show: Cached | None = None
    frames: int = 1

    @cached_property
    def starts(self) -> list[int]:
        """Where the windows of an epoch begin: at every image, if they have one frame."""
        return window_starts(self.train.ids, self.frames)

    def images(self) -> int:
        """Images of an epoch, or windows of several frames."""
        return len(self.starts)

    def has(self, what: str) -> dict[str, bool]:
        """Whether the data have "labels" or "depth"."""
        named = {"training": self.train, "validation": self.val}
        if what == "depth":
            return {name: data.has_depth for name, data in named.items()}
        return {name: data.has_labels for name, data in named.items()}

    def epoch(
        self, graph: SerialGraph, settings: Settings, epoch: int, first: int
    ) -> Iterator[Batch]:
        """Batches of an epoch from batch `first` on."""
        if settings.patch != 1.0:
            raise OptionError(f"`--patch {settings.patch}` is for `--sets`")
        how = {
            "size": graph.spec.inner_size,
            "batch": settings.batch,
            "seed": settings.seed,
            "epoch": epoch,
            "first": first,
            "workers": settings.workers,
        }
        augmentation = AUGMENTATIONS[settings.augmentation]
        if self.frames > 1:
            return sequence_batches(self.train, augmentation, frames=self.frames, **how)
        return epoch_batches(self.train, augmentation, **how)

    def label_counts(self) -> np.ndarray:
        """How many pixels have each label, of some of the images."""
        return _label_counts(self.train.labels[:: max(1, len(self.train) // 200)])

    def validate(self, graph: SerialGraph, component: int, settings: Settings) -> dict[str, float]:
        """Metrics of the graph."""
        if graph.spec.components[component].task in INNER_TASKS:
            load = {"batch": VALIDATION_BATCH, "workers": settings.workers}
            images = whole_images(self.val, graph.spec, **load)
            return validate_inner(graph, images, component=component, bf16=settings.bf16)
        how = _how(component, settings)
        return validate(graph, self.val, batch=VALIDATION_BATCH, **how)

    def shown(self, graph: SerialGraph, component: int, settings: Settings) -> np.ndarray:
        """The prediction for the image of `show`, or the first one of validation."""
        return _shown(graph, self.show or self.val, component, settings)

    def provenance(self, options: argparse.Namespace) -> dict[str, Any]:
        """What a checkpoint records of the data."""
        return folder_provenance(options, train=self.train.ids, val=self.val.ids)


@dataclass
class SetsFeed:
    """The cameras of a dataset list; an epoch draws `epoch_images` of them."""

    depth_error: ClassVar[str] = "abs_rel"

    train: Mixture
    val: Mixture
    epoch_images: int
    show: Cached | None = None

    def images(self) -> int:
        """Images of an epoch."""
        return self.epoch_images

    def has(self, what: str) -> dict[str, bool]:
        """Whether any set has labels; every set has depth."""
        named = {"training": self.train, "validation": self.val}
        if what == "depth":
            return {name: len(mixture) > 0 for name, mixture in named.items()}
        return {name: any(s.has_labels for s in m.sets) for name, m in named.items()}

    def epoch(
        self, graph: SerialGraph, settings: Settings, epoch: int, first: int
    ) -> Iterator[Batch]:
        """Batches of an epoch from batch `first` on, after listing growing folders again."""
        self.train.refresh()
        return mixed_batches(
            self.train,
            VIEWS[settings.augmentation],
            how=Shapes.of_part(graph.spec.inner_size, settings.patch, graph.spec.camera),
            count=self.epoch_images,
            batch=settings.batch,
            seed=settings.seed,
            epoch=epoch,
            first=first,
            workers=settings.workers,
        )

    def label_counts(self) -> np.ndarray:
        """How many pixels have each label, of some of the images."""
        places = range(0, len(self.train), max(1, len(self.train) // 200))
        labels = (self.train[place].pair.labels for place in places)
        return _label_counts(found for found in labels if found is not None)

    def validate(self, graph: SerialGraph, component: int, settings: Settings) -> dict[str, float]:
        """Metrics of the graph, mean over sets and of each set."""
        how = {"component": component, "bf16": settings.bf16}
        if graph.spec.components[component].task in INNER_TASKS:
            return validate_inner(graph, whole_views(self.val, graph.spec), **how)
        return validate_sets(graph, self.val, **how)

    def shown(self, graph: SerialGraph, component: int, settings: Settings) -> np.ndarray:
        """The prediction for the image of `show`, or the first one of validation."""
        show = self.show or Cached.of_rgb(self.val[0].pair.id, self.val[0].pair.rgb)
        return _shown(graph, show, component, settings)

    def provenance(self, options: argparse.Namespace) -> dict[str, Any]:
        """What a checkpoint records of the data."""
        return sets_provenance(options, train=self.train, val=self.val)


def _shown(graph: SerialGraph, show: Cached, component: int, settings: Settings) -> np.ndarray:
    """The prediction for the first image of `show`: what the run trains."""
    found = next(predictions(graph, show, batch=1, **_how(component, settings)))
    return found[1] if settings.component == CONFIDENCE else found[0]


def _how(component: int, settings: Settings) -> dict:
    return {"component": component, "bf16": settings.bf16, "workers": settings.workers}


def _label_counts(images: Iterable[np.ndarray]) -> np.ndarray:
    counts = np.zeros(256)
    for labels in images:
        counts += np.bincount(labels[::4, ::4].ravel(), minlength=256)
    return counts
