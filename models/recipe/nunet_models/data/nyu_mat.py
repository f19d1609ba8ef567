"""NYU Depth V2's `nyu_depth_v2_labeled.mat`, and the files of classes and split for it."""

from collections.abc import Sequence
from pathlib import Path

import h5py
import numpy as np

from nunet_models.classes import labels13_from_labels40
from nunet_models.data.matlab import read_whole_numbers
from nunet_models.data.pairs import Pair, blank_outside, file_state
from nunet_models.errors import DataError

MAT_SUFFIX = ".mat"
MAT_FILE = "NYU Depth V2's `nyu_depth_v2_labeled.mat`"
MAT_LABELS = "its 894 raw classes need the map to NYU's 40"
MAT_LABELS_HINT = "`--class-map classMapping40.mat`"
"""Why such a file alone gives no labels."""

RAW_CLASSES = 894  # of the file's own labels, counted from 1: 0 is a pixel without one
CLASSES_40 = 40
SPLITS = {"train": "trainNdxs", "test": "testNdxs"}
"""Variables of the official split, by the names of the lists that they become."""


class NyuMatPairs:
    """Pairs of the .mat file (HDF5; arrays are transposed, as MATLAB writes them).

    Ids are the numbers of the images from 0. Depth is the file's dense depth in meters. The
    file's own labels are 894 raw classes, which `class_map` (see `read_class_map`) maps to labels;
    without it such pairs have no labels.
    """

    def __init__(
        self,
        path: Path,
        ids: Sequence[str],
        *,
        class_map: Path | None = None,
        window: tuple[int, int, int, int] | None = None,
    ) -> None:
        self.path, self.ids, self.window = path, ids, window
        self.description = f"{path.name}, {len(ids)} images"
        self.labels13 = None if class_map is None else read_class_map(class_map)
        self.has_labels = self.labels13 is not None
        arrays = ["images", "depths", *(["labels"] if self.has_labels else [])]
        if not path.is_file():
            raise DataError(f"`{path}` is missing; expected {MAT_FILE}")
        try:
            table = self.labels13.tobytes().hex() if self.has_labels else None
            self.identity = f"{path.resolve()} {window} {table} {file_state([path])}"
            self.file = h5py.File(path, "r")
            count = min(len(self.file[name]) for name in arrays)
        except (OSError, KeyError) as error:
            raise DataError(f"`{path}` is not NYU Depth V2's labeled .mat file: {error}") from error
        wrong = [i for i in ids if not i.isdecimal() or int(i) >= count]
        if wrong:
            raise DataError(f"`{path}` holds images 0 to {count - 1}; there is no `{wrong[0]}`")

    def __len__(self) -> int:
        """How many pairs."""
        return len(self.ids)

    def __getitem__(self, index: int) -> Pair:
        """Read one pair: colors `[3, W, H]`, depth and labels `[W, H]` in the file."""
        number = int(self.ids[index])
        rgb = np.ascontiguousarray(self.file["images"][number].transpose(2, 1, 0))
        depth_m = np.ascontiguousarray(self.file["depths"][number].T.astype(np.float32))
        depth_m[depth_m <= 0] = np.nan
        name = f"{self.path}, image {number}"
        labels = self._labels(number, name) if self.has_labels else None
        return Pair(self.ids[index], rgb, *blank_outside(depth_m, labels, self.window, of=name))

    def _labels(self, number: int, name: str) -> np.ndarray:
        raw = self.file["labels"][number].T
        if raw.max() > RAW_CLASSES:
            raise DataError(
                f"`{name}` has the label {raw.max()}; expected 0, which is none, to {RAW_CLASSES}"
            )
        return np.ascontiguousarray(self.labels13[raw])


def read_class_map(path: Path) -> np.ndarray:
    """Labels of the 13 classes by raw class, uint8 `[895]`, from `classMapping40.mat`.

    The file of Gupta et al., "Perceptual Organization and Recognition of Indoor Scenes from RGB-D
    Images", 2013; its `mapClass` has one of NYU's 40 classes, counted from 1, for each raw class.

    # Errors
    `DataError` naming another file, such as those of 4 or 13 classes, which have such a variable.
    """
    of = "Gupta et al.'s `classMapping40.mat`"
    classes = read_whole_numbers(path, "mapClass", of=of)
    if len(classes) != RAW_CLASSES or classes.min() < 0 or classes.max() != CLASSES_40:
        raise DataError(
            f"`mapClass` of `{path}` has {len(classes)} numbers from {min(classes, default=0)} to "
            f"{max(classes, default=0)}; expected {RAW_CLASSES} from 1 to {CLASSES_40}, as in {of}"
        )
    # Raw label 0 (none) becomes 255 in uint8, which is `IGNORE`.
    labels40 = np.concatenate([[0], classes]).astype(np.uint8) - np.uint8(1)
    return labels13_from_labels40(labels40)


def read_splits(path: Path) -> dict[str, list[str]]:
    """Ids of the official split, `train` and `test`, from `splits.mat`, which counts from 1.

    # Errors
    `DataError` naming a file that is not such a split.
    """
    of = "NYU Depth V2's `splits.mat`"
    numbers = {name: read_whole_numbers(path, SPLITS[name], of=of) for name in SPLITS}
    both = np.concatenate(list(numbers.values()))
    if not all(part.size for part in numbers.values()) or both.min() < 1:
        raise DataError(f"`{path}` has a list that is empty or not counted from 1; expected {of}")
    if len(np.unique(both)) != len(both):
        raise DataError(f"`{path}` names an image twice; expected {of}, with disjoint lists")
    return {name: [str(number - 1) for number in part] for name, part in numbers.items()}
