"""NYU Depth V2's own file, `nyu_depth_v2_labeled.mat`, read with h5py."""

from collections.abc import Sequence
from pathlib import Path

import h5py
import numpy as np

from nunet_models.data.pairs import Pair, blank_outside, file_state
from nunet_models.errors import DataError

MAT_SUFFIX = ".mat"
MAT_LABELS = (
    "its 894 raw classes are mapped to NYU40 in another file of the authors; hint: a folder with "
    "`label40`"
)
"""Why such a file gives no labels."""


class NyuMatPairs:
    """Pairs of the .mat file (HDF5; arrays lie transposed, as MATLAB writes them).

    Ids are the numbers of the pictures from 0. Depth is the file's dense depth in metres. The
    file's own labels are 894 raw classes without the map to NYU40, which lies in another file of
    the authors: such pairs have no labels.
    """

    has_labels = False

    def __init__(
        self,
        path: Path,
        ids: Sequence[str],
        *,
        window: tuple[int, int, int, int] | None = None,
    ) -> None:
        self.path, self.ids, self.window = path, ids, window
        self.description = f"{path.name}, {len(ids)} pictures"
        try:
            self.identity = f"{path.resolve()} {window} {file_state([path])}"
            self.file = h5py.File(path, "r")
            count = min(len(self.file["images"]), len(self.file["depths"]))
        except (OSError, KeyError) as error:
            raise DataError(
                f"`{path}` is not NYU Depth V2's labelled .mat file: {error}"
            ) from error
        wrong = [i for i in ids if not i.isdecimal() or int(i) >= count]
        if wrong:
            raise DataError(f"`{path}` holds pictures 0 to {count - 1}; there is no `{wrong[0]}`")

    def __len__(self) -> int:
        """How many pairs."""
        return len(self.ids)

    def __getitem__(self, index: int) -> Pair:
        """Read one pair: colours `[3, W, H]` and depth `[W, H]` in the file."""
        number = int(self.ids[index])
        rgb = np.ascontiguousarray(self.file["images"][number].transpose(2, 1, 0))
        depth_m = np.ascontiguousarray(self.file["depths"][number].T.astype(np.float32))
        depth_m[depth_m <= 0] = np.nan
        name = f"{self.path}, picture {number}"
        return Pair(self.ids[index], rgb, *blank_outside(depth_m, None, self.window, of=name))
