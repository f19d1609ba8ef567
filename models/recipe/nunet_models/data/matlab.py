"""Reads numbers from MATLAB files of any version."""

from pathlib import Path

import h5py
import numpy as np

from nunet_models.errors import DataError


def read_whole_numbers(path: Path, name: str, *, of: str) -> np.ndarray:
    """The variable `name`, a row or a column of whole numbers, as int64 `[N]`.

    # Errors
    `DataError` naming a file that is missing, not a MATLAB file, or without such a variable; `of`
    describes the expected file.
    """
    if not path.is_file():
        raise DataError(f"`{path}` is missing; expected {of}")
    try:
        # MATLAB 7.3 writes HDF5, which h5py reads; scipy reads earlier versions.
        names, values = (_read_hdf5 if h5py.is_hdf5(path) else _read_older)(path, name)
    except ImportError:
        raise
    except Exception as error:  # of scipy, zlib and struct, without a common base class
        raise DataError(f"`{path}` is not a MATLAB file: {error}; expected {of}") from error
    if values is None:
        has = ", ".join(f"`{other}`" for other in sorted(names)) or "none at all"
        raise DataError(f"`{path}` has the variables {has}; expected `{name}` of {of}")
    if values.dtype.kind not in "iuf" or values.size != max(values.shape, default=0):
        raise DataError(
            f"`{name}` of `{path}` is {values.dtype} of {values.shape}; expected one row or "
            f"column of numbers, as in {of}"
        )
    flat = values.ravel()
    if not (np.isfinite(flat).all() and np.array_equal(flat, np.rint(flat))):
        raise DataError(f"`{name}` of `{path}` has fractions; expected whole numbers, as in {of}")
    return flat.astype(np.int64)


def _read_hdf5(path: Path, name: str) -> tuple[list[str], np.ndarray | None]:
    with h5py.File(path, "r") as file:
        names = [other for other, value in file.items() if isinstance(value, h5py.Dataset)]
        return names, np.asarray(file[name]) if name in names else None


def _read_older(path: Path, name: str) -> tuple[list[str], np.ndarray | None]:
    from scipy.io import loadmat, whosmat  # noqa: PLC0415 (half a second that few runs need)

    names = [other for other, _, _ in whosmat(path)]
    return names, loadmat(path, variable_names=[name])[name] if name in names else None
