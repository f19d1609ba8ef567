"""NYU Depth V2's own files: images, classes and split."""

import json
import os

import h5py
import numpy as np
import pytest
from runs import evaluate_tiny, train
from scipy.io import savemat

from nunet_models.classes import IGNORE, labels13_from_labels40
from nunet_models.cli import main
from nunet_models.data.cache import build_cache
from nunet_models.data.nyu_mat import RAW_CLASSES, NyuMatPairs, read_class_map, read_splits
from nunet_models.errors import DataError
from nunet_models.zoo.checkpoint import Checkpoint

CLASSES = np.arange(RAW_CLASSES) % 40 + 1


def write_class_map(path, classes=CLASSES, **how):
    """As Gupta et al.'s file: a row of 8-bit numbers beside names in cells."""
    names = np.array([f"class {i}" for i in range(1, 41)], dtype=object)
    row = np.asarray(classes, np.uint8)[None]
    savemat(path, {"mapClass": row, "className": names[None]}, **how)
    return path


def write_nyu(path, count=2, size=(6, 8), labels=None):
    """`count` images of `size` rows and columns, axes turned as MATLAB's are."""
    height, width = size
    random = np.random.default_rng(2)
    with h5py.File(path, "w") as file:
        file["images"] = random.integers(0, 256, (count, 3, width, height), np.uint8)
        file["depths"] = random.uniform(1, 4, (count, width, height)).astype(np.float32)
        file["rawDepths"] = np.zeros((count, width, height), np.float32)
        if labels is not None:
            file["labels"] = np.asarray(labels, np.uint16)
    return path


@pytest.fixture
def class_map(tmp_path):
    return write_class_map(tmp_path / "classMapping40.mat")


def test_axes_are_turned(tmp_path):
    path = tmp_path / "nyu.mat"
    with h5py.File(path, "w") as file:
        file["images"] = np.arange(2 * 3 * 8 * 6, dtype=np.uint8).reshape(2, 3, 8, 6)
        file["depths"] = np.full((2, 8, 6), 2.5, np.float32)
    pairs = NyuMatPairs(path, ["1"])
    pair = pairs[0]
    assert pair.rgb.shape == (6, 8, 3) and pair.depth_m.shape == (6, 8)
    # column 2, row 5, green of image 1
    assert pair.rgb[5, 2, 1] == np.uint8((1 * 3 + 1) * 48 + 2 * 6 + 5)
    assert pair.labels is None and not pairs.has_labels


def test_raw_classes_become_labels_by_the_class_map(tmp_path, class_map):
    raw = np.arange(2 * 8 * 6).reshape(2, 8, 6)
    raw[1, 2, 5] = 894
    path = write_nyu(tmp_path / "nyu.mat", labels=raw)
    pairs = NyuMatPairs(path, ["0", "1"], class_map=class_map)
    assert pairs.has_labels
    found = pairs[0].labels
    assert found.shape == (6, 8) and found.dtype == np.uint8
    assert found[0, 0] == IGNORE, "0 is no label"
    # raw class 1 is class 1 of 40 here, a wall; 4 a bed; 40 otherprop
    assert found[1, 0] == 11 and found[4, 0] == 0 and found[40 % 6, 40 // 6] == IGNORE
    labels40 = np.uint8(CLASSES[893] - 1)
    assert pairs[1].labels[5, 2] == labels13_from_labels40(labels40)
    pair = NyuMatPairs(path, ["0"], class_map=class_map, window=(1, 0, 6, 8))[0]
    assert (pair.labels[0] == IGNORE).all() and pair.labels[1, 0] == 11


@pytest.mark.parametrize("how", ["compressed", "as doubles", "7.3"])
def test_a_class_map_of_any_version_of_matlab_is_read(tmp_path, class_map, how):
    path = tmp_path / "other.mat"
    if how == "compressed":
        write_class_map(path, do_compression=True)
    elif how == "as doubles":
        savemat(path, {"mapClass": CLASSES[:, None].astype(float)})
    else:
        with h5py.File(path, "w", userblock_size=512) as file:
            file["mapClass"] = CLASSES[:, None].astype(float)
    assert np.array_equal(read_class_map(path), read_class_map(class_map))


@pytest.mark.parametrize(
    ("write", "message"),
    [
        (lambda p: None, "is missing; expected Gupta et al.'s `classMapping40.mat`"),
        (lambda p: p.write_bytes(b"<html>404"), "is not a MATLAB file: "),
        (lambda p: p.write_bytes(b""), "is not a MATLAB file: "),
        (lambda p: savemat(p, {"names": [1], "other": [2]}), "the variables `names`, `other`; exp"),
        (lambda p: write_class_map(p, CLASSES % 13 + 1), "894 numbers from 1 to 13; expected 894 "),
        (lambda p: write_class_map(p, CLASSES[:800]), "has 800 numbers from 1 to 40; expected 894"),
        (lambda p: savemat(p, {"mapClass": [[1.5, 2]]}), "has fractions; expected whole numbers"),
        (lambda p: savemat(p, {"mapClass": "wall"}), "expected one row or column of numbers"),
        (lambda p: savemat(p, {"mapClass": np.ones((2, 447))}), "expected one row or column"),
    ],
)
def test_a_file_that_is_no_class_map_is_named(tmp_path, write, message):
    path = tmp_path / "classMapping.mat"
    write(path)
    with pytest.raises(DataError) as raised:
        read_class_map(path)
    assert str(path) in str(raised.value) and message in str(raised.value)


def test_a_cut_class_map_is_no_matlab_file(class_map):
    class_map.write_bytes(class_map.read_bytes()[:700])
    with pytest.raises(DataError, match="is not a MATLAB file"):
        read_class_map(class_map)


def test_a_label_that_is_no_raw_class_is_refused(tmp_path, class_map):
    path = write_nyu(tmp_path / "nyu.mat", labels=np.full((2, 8, 6), 895))
    with pytest.raises(DataError, match=r"image 1` has the label 895; expected 0.* to 894"):
        NyuMatPairs(path, ["1"], class_map=class_map)[0]


@pytest.mark.parametrize(
    ("name", "message"), [("other.mat", "is not NYU"), ("absent.mat", "is missing; expected NYU")]
)
def test_a_file_that_is_not_nyu_s_is_refused_by_name(tmp_path, name, message):
    (tmp_path / "other.mat").write_bytes(b"MATLAB 5.0")
    with pytest.raises(DataError) as raised:
        NyuMatPairs(tmp_path / name, ["0"])
    assert f"`{tmp_path / name}` {message}" in str(raised.value)


def test_a_file_without_labels_fails_with_a_hint_where_labels_are_needed(tmp_path, class_map):
    path = write_nyu(tmp_path / "nyu.mat")
    with pytest.raises(DataError, match=r"nyu\.mat` is not NYU.*labels"):
        NyuMatPairs(path, ["0"], class_map=class_map)


def test_a_replaced_file_or_class_map_is_not_served_from_the_cache(tmp_path, class_map):
    path = tmp_path / "nyu.mat"

    def depth_of(meters, time_ns):
        with h5py.File(path, "w") as file:
            file["images"] = np.zeros((1, 3, 8, 6), np.uint8)
            file["depths"] = np.full((1, 8, 6), meters, np.float32)
        os.utime(path, ns=(time_ns, time_ns))
        return build_cache(NyuMatPairs(path, ["0"]), tmp_path / "cache").depth_m(0)[3, 3]

    assert depth_of(2.0, 10**18) == pytest.approx(2.0)
    assert depth_of(3.0, 10**18 - 5) == pytest.approx(3.0)
    assert depth_of(2.0, 10**18) == pytest.approx(2.0)

    write_nyu(path, labels=np.ones((2, 8, 6)))

    def label(classes):
        write_class_map(class_map, classes)
        pairs = NyuMatPairs(path, ["0"], class_map=class_map)
        return build_cache(pairs, tmp_path / "cache").labels[0, 0, 0]

    assert (label(CLASSES), label(np.roll(CLASSES, -1))) == (11, 4)


def rooms(tmp_path):
    """A made .mat of the tiny model's size, lists of two halves, and options that name both."""
    labels = np.random.default_rng(4).integers(0, 895, (4, 128, 96))
    path = write_nyu(tmp_path / "nyu.mat", count=4, size=(96, 128), labels=labels)
    (tmp_path / "train.txt").write_text("0\n1\n")
    (tmp_path / "val.txt").write_text("2\n3\n")
    return path


def test_segmentation_is_trained_from_nyu_s_own_files(tmp_path, class_map, capsys):
    data = ("--data", str(rooms(tmp_path)))
    assert train(tmp_path, tmp_path / "run", *data) == 1
    stderr = capsys.readouterr().err
    assert (
        "nyu.mat` has no labels of its own to train `segmentation` on: its 894 raw classes"
        in stderr
    )
    assert stderr.endswith("hint: `--class-map classMapping40.mat`\n")
    data = (*data, "--class-map", str(class_map))
    assert train(tmp_path, tmp_path / "run", *data, epochs=1) == 0
    kept = Checkpoint.load(tmp_path / "run" / "best.pt").provenance["segmentation"]["data"]
    assert kept["class_map"]["file"] == "classMapping40.mat"
    write_class_map(class_map, np.roll(CLASSES, 1))
    assert train(tmp_path, tmp_path / "run", *data, "--resume", epochs=1) == 1
    assert "`--class-map classMapping40.mat` (SHA-256 " in capsys.readouterr().err


def test_labels_are_measured_by_nyu_s_own_files(tmp_path, class_map, capsys):
    path = rooms(tmp_path)
    assert evaluate_tiny(tmp_path, data=path) == 0
    printed = capsys.readouterr()
    assert json.loads(printed.out)["labels"] == {}
    assert "has no labels of its own: its 894 raw classes" in printed.err
    assert evaluate_tiny(tmp_path, "--class-map", str(class_map), data=path) == 0
    printed = capsys.readouterr()
    assert json.loads(printed.out)["labels"]["pixels"] > 20_000
    assert "no label" not in printed.err


def test_a_class_map_of_a_folder_is_a_bad_argument(dataset, class_map, capsys):
    assert evaluate_tiny(dataset, "--class-map", str(class_map)) == 2
    assert "is for the labels of NYU's .mat; " in capsys.readouterr().err


@pytest.fixture
def splits(tmp_path):
    path = tmp_path / "splits.mat"
    savemat(path, {"trainNdxs": np.array([[3], [4]]), "testNdxs": np.array([[1], [2], [1449]])})
    return path


def test_the_official_split_becomes_lists_that_count_from_0(tmp_path, splits, capsys):
    out = tmp_path / "lists"
    subcommand = ["nyu-lists", "--splits", str(splits), "--out", str(out)]
    for _ in range(2):
        assert main(subcommand) == 0
        assert f"{out / 'train.txt'}: 2 images\n" in capsys.readouterr().out
    assert (out / "train.txt").read_text() == "2\n3\n"
    assert (out / "test.txt").read_text() == "0\n1\n1448\n"
    (out / "test.txt").write_text("mine\n")
    assert main(subcommand) == 1
    assert "test.txt` exists and is another list; hint: " in capsys.readouterr().err
    assert (out / "test.txt").read_text() == "mine\n"


@pytest.mark.parametrize(
    ("train_ids", "test_ids", "message"),
    [([1, 2], [2], "twice"), ([0, 1], [2], "counted from 1"), ([], [1], "empty")],
)
def test_a_split_that_cannot_be_is_refused(tmp_path, train_ids, test_ids, message):
    path = tmp_path / "splits.mat"
    savemat(path, {"trainNdxs": train_ids, "testNdxs": test_ids})
    with pytest.raises(DataError, match=rf"splits\.mat` .*{message}"):
        read_splits(path)
