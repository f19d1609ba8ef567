"""Small runs of the subparsers `train` and `evaluate`, and the logs that the first one leaves."""

import csv
from pathlib import Path

from nunet_models.cli import main

TINY = Path(__file__).parents[2] / "tiny" / "tiny_wnet_c.onnx"


def evaluate_tiny(dataset, *more, model=TINY, data=None):
    """On the images of `val.txt` of a folder, or on those of `data`."""
    ids = ("--ids", str(dataset / "val.txt"))
    return main(["evaluate", "--model", str(model), "--data", str(data or dataset), *ids, *more])


def train(dataset, run, *more, component="segmentation", epochs=2):
    return main(
        [
            "train",
            *("--run", str(run), "--data", str(dataset), "--cache", str(dataset / "cache")),
            *("--train-ids", str(dataset / "train.txt"), "--val-ids", str(dataset / "val.txt")),
            *("--backbone", "tiny", "--inner-size", "96", "128", "--component", component),
            *("--epochs", str(epochs), "--batch", "2", "--threads", "1", "--quiet", *more),
        ]
    )


def rows(run, name):
    with (run / name).open() as file:
        return list(csv.DictReader(file))
