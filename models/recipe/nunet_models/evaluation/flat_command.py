"""`evaluate --flat-images`: the relief that a network predicts on flat panes."""

import argparse
import json

from tqdm import tqdm

from nunet_models.errors import ConfigError, DataError
from nunet_models.evaluation.predict import Predictor
from nunet_models.evaluation.relief import METRICS, FlatImages, means_by_kind, pane_metrics
from nunet_models.files import check_output_file, write_table

COLUMNS = ("id", "kind", *METRICS)


def run_flat_images(options: argparse.Namespace) -> int:
    """Carry out `evaluate --flat-images`; prints JSON."""
    check_output_file("--csv", options.csv)
    predictor = Predictor(options.model, threads=options.threads)
    if not predictor.metric:
        raise ConfigError(
            f"`--flat-images` measures meters, but `{options.model}` outputs depth as "
            f"`{predictor.encoding}`"
        )
    images = FlatImages(options.flat_images)
    training = predictor.camera
    rows, hidden = [], 0
    for index in tqdm(range(len(images)), desc=predictor.path.name, unit="image", disable=None):
        image = images[index]
        found = pane_metrics(image, predictor, training)
        hidden += not found
        if found:
            rows.append({"id": image.id, "kind": image.kind, **found})
    if not rows:
        raise DataError(f"no pane of `{options.flat_images}` is visible")
    if options.csv:
        write_table(options.csv, COLUMNS, rows)
    kinds = means_by_kind(rows)
    print(json.dumps({"model": options.model.name, "hidden": hidden, "panes": kinds}, indent=1))
    return 0
