"""`nunetd eval` gives the numbers of the recipe's own evaluation, with which it shares no code."""

import json
import pathlib
import subprocess
import sys

import numpy as np
import onnxruntime
import pytest
from conftest import MODEL
from PIL import Image

sys.path.insert(0, str(pathlib.Path(__file__).parents[2] / "models" / "recipe"))

from nunet_models.data.pairs import DepthUnits, FolderPairs
from nunet_models.evaluation.compare import (
    Prediction,
    compare,
    mean_image,
    mean_stretched_image,
)
from nunet_models.evaluation.protocol import FULL

IMAGES = 5


@pytest.fixture(scope="module")
def session():
    return onnxruntime.InferenceSession(str(MODEL), providers=["CPUExecutionProvider"])


@pytest.fixture(scope="module")
def dataset(session, tmp_path_factory):
    """Images of the model's size with depth from 0.5 to 12 m, holes in it, and NYU's 40 labels with holes."""
    _, height, width, _ = session.get_inputs()[0].shape
    root = tmp_path_factory.mktemp("dataset")
    random = np.random.default_rng(3)
    for name in ("rgb", "depth", "label40"):
        (root / name).mkdir()
    for index in range(IMAGES):
        rgb = random.integers(0, 256, (height, width, 3), np.uint8)
        depth = random.integers(500, 12000, (height, width)).astype(np.uint16)
        depth[random.random((height, width)) < 0.1] = 0
        depth[random.random((height, width)) < 0.1] = 65535
        labels = random.integers(0, 40, (height, width), np.uint8)
        labels[random.random((height, width)) < 0.1] = 255
        Image.fromarray(rgb).save(root / "rgb" / f"{index}.png")
        Image.fromarray(depth).save(root / "depth" / f"{index}.png")
        Image.fromarray(labels).save(root / "label40" / f"{index}.png")
    return FolderPairs(root, [str(index) for index in range(IMAGES)], units=DepthUnits())


@pytest.fixture(scope="module")
def found(nunetd, dataset, tmp_path_factory):
    """The output of nunetd, and the folder of its files."""
    out = tmp_path_factory.mktemp("out")
    command = [nunetd, "-q", "eval", str(dataset.root), "--model", str(MODEL), "--focal", "off", "--json"]
    command += ["--provider", "cpu", "--out", str(out)]
    return json.loads(subprocess.run(command, check=True, capture_output=True).stdout), out


@pytest.fixture(scope="module")
def expected(session, dataset):
    values = session.get_modelmeta().custom_metadata_map
    least, most = (np.float32(values[f"nunet.depth.{name}"]) for name in ("min_m", "max_m"))

    def predict(rgb):
        depth, labels = session.run(["depth", "labels"], {"rgb": rgb[None]})
        valid = (depth >= least) & (depth <= most)
        return Prediction(np.where(valid, depth, np.float32(np.nan))[0, 0], labels[0])

    pairs = [dataset[index] for index in range(IMAGES)]
    return compare(pairs, predict, protocol=FULL, metric=True, classes=13)


def test_figures_of_depth_and_labels_agree(found, expected):
    ours, theirs = found[0], expected.values()
    for group in ("metrics", "image_mean", "minmax", "labels"):
        assert ours[group].keys() == theirs[group].keys()
        assert ours[group] == pytest.approx(theirs[group], rel=1e-6), group
    for count in ("pixels", "pixels_without_prediction", "pixels_beyond"):
        assert ours[count] == theirs[count], count
    assert theirs["pixels_beyond"] > 0
    assert (ours["pictures"], ours["skipped"]) == (IMAGES, 0)


def test_the_mean_image_agrees(found, dataset):
    pairs = [dataset[index] for index in range(IMAGES)]
    ours = found[0]["baseline"]
    mean = Prediction(mean_image(dataset), None)
    theirs = compare(pairs, lambda _: mean, protocol=FULL, metric=True, classes=0).values()
    for group in ("metrics", "image_mean"):
        assert ours[group] == pytest.approx(theirs[group], rel=1e-6), group
    stretched = Prediction(mean_stretched_image(dataset), None)
    theirs = compare(pairs, lambda _: stretched, protocol=FULL, metric=False, classes=0).values()["minmax"]
    assert ours["minmax"] == pytest.approx(theirs, rel=1e-6)


def test_the_table_has_a_row_an_image(found, expected):
    lines = (found[1] / "images.csv").read_text().splitlines()
    names = lines[0].split(",")
    assert len(lines) == 1 + IMAGES
    for line, theirs in zip(lines[1:], expected.per_image, strict=True):
        row = dict(zip(names, line.split(","), strict=True))
        assert row["id"] == theirs["id"]
        metrics = {name: float(row[name]) for name in theirs if name != "id"}
        assert metrics == pytest.approx({n: v for n, v in theirs.items() if n != "id"}, rel=1e-6)
    assert json.loads((found[1] / "eval.json").read_text()) == found[0]
    assert Image.open(found[1] / "contact_sheet.png").width > 4 * 320
