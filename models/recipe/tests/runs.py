"""A small run of the verb `train`, and the logs that it leaves."""

import csv

from nunet_models.cli import main


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
