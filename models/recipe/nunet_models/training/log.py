"""Logs of a run: CSV files and TensorBoard."""

import csv
from pathlib import Path

import numpy as np
from torch.utils.tensorboard import SummaryWriter

EVOLUTION = "evolution"
"""Folder of a run that holds one prediction per epoch."""


class RunLog:
    """Appends rows to `steps.csv` and `epochs.csv` in a run's folder, and the same to TensorBoard.

    Rows carry a step or an epoch; a resumed run appends, and its first rows may repeat steps that
    were lost with the process: the later row counts.
    """

    def __init__(self, folder: Path) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self.folder = folder
        self.board = SummaryWriter(str(folder / "tensorboard"))

    def step(self, step: int, values: dict[str, float]) -> None:
        """Log metrics of an optimizer's step."""
        self._row("steps.csv", {"step": step, **values})
        self._scalars("step", step, values)

    def epoch(self, epoch: int, values: dict[str, float]) -> None:
        """Log metrics of a finished epoch."""
        self._row("epochs.csv", {"epoch": epoch, **values})
        self._scalars("epoch", epoch, values)

    def prediction(self, epoch: int, image: np.ndarray) -> None:
        """Save the prediction for the image of `--show`, `[H, W]`, for reports.

        Every second pixel and half precision are enough for a figure.
        """
        folder = self.folder / EVOLUTION
        folder.mkdir(exist_ok=True)
        kind = np.float16 if image.dtype.kind == "f" else image.dtype
        np.save(folder / f"{epoch:04d}.npy", image[::2, ::2].astype(kind))

    def close(self) -> None:
        """Flush TensorBoard's file."""
        self.board.close()

    def _row(self, name: str, row: dict[str, float]) -> None:
        path = self.folder / name
        fresh = not path.exists()
        with path.open("a", newline="", encoding="utf-8") as file:
            writer = csv.DictWriter(file, fieldnames=list(row))
            if fresh:
                writer.writeheader()
            writer.writerow(row)

    def _scalars(self, kind: str, at: int, values: dict[str, float]) -> None:
        for name, value in values.items():
            self.board.add_scalar(f"{kind}/{name}", value, at)
