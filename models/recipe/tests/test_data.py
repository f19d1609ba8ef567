"""Reading pairs, and the errors of bad data."""

import argparse
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from nunet_models.classes import IGNORE, labels13_from_labels40
from nunet_models.data.options import add_data_options, open_pairs
from nunet_models.data.pairs import DepthUnits, FolderPairs, read_ids, read_rgb
from nunet_models.errors import ConfigError, DataError, OptionError


def opened(dataset, *options):
    parser = argparse.ArgumentParser()
    add_data_options(parser)
    ids = dataset / "train.txt"
    return open_pairs(parser.parse_args(["--data", str(dataset), *options]), ids)


def test_a_pair_is_meters_with_nan_where_there_is_none(dataset):
    path = dataset / "depth" / "0000.png"
    values = np.array(Image.open(path))
    values[0, 0] = 0
    Image.fromarray(values).save(path)
    pair = FolderPairs(dataset, ["0000"], units=DepthUnits())[0]
    assert np.isnan(pair.depth_m[0, 0])
    assert pair.depth_m[5, 5] == pytest.approx(values[5, 5] / 1000)
    assert pair.depth_m.dtype == np.float32


def test_eight_bit_depth_with_an_offset_has_no_holes():
    units = DepthUnits(scale_m=9.99547 / 255, offset=0.5, zero_is_none=False)
    assert units.meters(np.array([0, 255], np.uint8)) == pytest.approx([0.0196, 10.0151], abs=1e-4)


def test_65535_of_16_bit_images_is_no_measurement_whatever_the_offset():
    values = np.array([0, 1500, 65535], np.uint16)
    found = DepthUnits().meters(values)
    assert np.isnan(found[[0, 2]]).all() and found[1] == np.float32(1.5)
    found = DepthUnits(offset=500.0, zero_is_none=False).meters(values)
    assert found[:2].tolist() == [0.5, 2.0] and np.isnan(found[2])


def test_outside_of_the_window_there_is_no_truth(dataset):
    pair = FolderPairs(dataset, ["0000"], units=DepthUnits(), window=(2, 4, 90, 120))[0]
    assert np.isnan(pair.depth_m[1]).all() and np.isnan(pair.depth_m[:, 3]).all()
    assert np.isfinite(pair.depth_m[2:90, 4:120]).all()
    assert (pair.labels[1] == IGNORE).all()


@pytest.mark.parametrize("window", ["9,0,9,5", "0,9,5,4", "-4,0,5,5", "0,-1,5,5"])
def test_a_window_without_pixels_is_refused(dataset, window):
    with pytest.raises(ConfigError, match=rf"`--window {window}` leaves nothing"):
        opened(dataset, f"--window={window}")


def test_a_window_beside_the_image_is_refused_with_its_name(dataset):
    with pytest.raises(DataError, match=r"nothing of `.*0000\.png`, which has 96 rows and 128 col"):
        opened(dataset, "--window=96,0,200,128")[0]


def test_labels40_fold_to_13_and_the_rest_is_ignored():
    assert labels13_from_labels40(np.array([0, 1, 38, 39, 255], np.uint8)).tolist() == [
        11,
        4,
        5,
        IGNORE,
        IGNORE,
    ]


def test_the_clip_s_labels_are_its_own_classes():
    clip = Path(__file__).parents[2] / "clip"
    pair = FolderPairs(clip, ["study_00"], units=DepthUnits())[0]
    assert np.array_equal(pair.labels, np.array(Image.open(clip / "labels" / "study_00.png")))


@pytest.mark.parametrize(
    ("folder", "value", "expected", "hint"),
    [
        ("labels", 13, "0 to 12, or 255", "NYU's 40 classes belong in `label40/`"),
        ("labels", 39, "0 to 12, or 255", "NYU's 40 classes belong in `label40/`"),
        ("labels", 254, "0 to 12, or 255", "`255` means unknown"),
        ("label40", 40, "0 to 39, or 255", "`label40/` counts NYU's classes from 0"),
        ("label40", 300, "0 to 39, or 255", "`255` means unknown"),
    ],
)
def test_a_label_that_is_no_class_is_refused(dataset, folder, value, expected, hint):
    known = (12, 255) if folder == "labels" else (39, 255)
    labels = np.full((96, 128), known[0], np.uint16)
    labels[2] = known[1]
    path = dataset / folder / "0001.png"
    path.parent.mkdir(exist_ok=True)
    Image.fromarray(labels).save(path)
    found = FolderPairs(dataset, ["0001"], units=DepthUnits())[0].labels
    assert (found[2] == IGNORE).all()
    labels[4, 4] = value
    Image.fromarray(labels).save(path)
    with pytest.raises(DataError) as raised:
        FolderPairs(dataset, ["0001"], units=DepthUnits())[0]
    message = f"`{path}` has the label {value}; expected {expected} for unknown"
    assert str(raised.value) == message
    assert raised.value.hint.startswith(hint)


def test_a_missing_file_is_named(dataset):
    (dataset / "depth" / "0002.png").unlink()
    with pytest.raises(DataError, match=r"depth/0002\.png` is missing"):
        FolderPairs(dataset, ["0001", "0002"], units=DepthUnits())


@pytest.mark.parametrize(
    ("was", "called"),
    [("rgb/0002.png", "rgb/0002.PNG"), ("depth/0002.png", "depth/0002.PNG")],
)
def test_an_ending_may_have_capitals(dataset, was, called):
    expected = FolderPairs(dataset, ["0002"], units=DepthUnits())[0]
    (dataset / was).rename(dataset / called)
    pair = FolderPairs(dataset, ["0002"], units=DepthUnits())[0]
    assert np.array_equal(pair.rgb, expected.rgb)
    assert np.array_equal(pair.depth_m, expected.depth_m, equal_nan=True)


def test_missing_files_are_counted_by_the_file(dataset):
    for folder in ("depth", "label40"):
        for name in ("0001", "0002"):
            (dataset / folder / f"{name}.png").unlink()
    with pytest.raises(DataError, match=r"missing, and 3 more of the 6 files of 2 pairs$"):
        FolderPairs(dataset, ["0001", "0002"], units=DepthUnits())


def test_gray_images_of_16_bits_keep_their_shades(tmp_path):
    path = tmp_path / "gray.png"
    Image.fromarray(np.array([[0, 128 * 257, 65535, 300]], np.uint16)).save(path)
    assert read_rgb(path).tolist() == [[[0] * 3, [128] * 3, [255] * 3, [1] * 3]]


@pytest.mark.parametrize(("orientation", "turns"), [(1, 0), (3, 2), (6, 3), (8, 1)])
@pytest.mark.parametrize("ending", ["jpg", "png"])
def test_a_image_is_turned_as_its_exif_orientation_says(tmp_path, ending, orientation, turns):
    upright = np.zeros((32, 48, 3), np.uint8)
    upright[:16, :24] = 250
    path, exif = tmp_path / f"turned.{ending}", Image.Exif()
    exif[0x0112] = orientation
    stored = Image.fromarray(np.rot90(upright, -turns))
    stored.save(path, exif=exif, **({"quality": 95} if ending == "jpg" else {}))
    found = read_rgb(path)
    assert found.shape == upright.shape
    assert np.abs(found.astype(int) - upright).max() < 30


def test_gray_images_of_16_bits_are_turned_as_well(tmp_path):
    exif = Image.Exif()
    exif[0x0112] = 3
    values = np.array([[0, 257], [514, 65535]], np.uint16)
    Image.fromarray(values).save(tmp_path / "gray.png", exif=exif)
    assert read_rgb(tmp_path / "gray.png")[..., 0].tolist() == [[255, 2], [1, 0]]


@pytest.mark.filterwarnings("ignore:Corrupt EXIF")
@pytest.mark.parametrize("exif", [b"Exif\0\0nothing", b"Exif\0\0MM\0*\0\0\0\x08\0\x09\x01"])
def test_a_damaged_orientation_is_none(tmp_path, exif):
    path = tmp_path / "image.jpg"
    Image.new("RGB", (8, 8), (9, 9, 9)).save(path)
    plain = path.read_bytes()
    block = b"\xff\xe1" + (len(exif) + 2).to_bytes(2, "big") + exif
    path.write_bytes(plain[:2] + block + plain[2:])
    assert read_rgb(path).shape == (8, 8, 3)


def test_a_corrupt_image_is_named(dataset):
    (dataset / "rgb" / "0001.png").write_bytes(b"\x89PNG no more")
    with pytest.raises(DataError, match=r"0001\.png` cannot be read"):
        FolderPairs(dataset, ["0001"], units=DepthUnits())[0]


def test_depth_of_another_size_is_named_with_both_sizes(dataset):
    Image.new("I;16", (64, 48)).save(dataset / "depth" / "0001.png")
    with pytest.raises(DataError, match=r"\(48, 64\).*\(96, 128\)"):
        FolderPairs(dataset, ["0001"], units=DepthUnits())[0]


def test_depth_with_color_channels_is_refused(dataset):
    Image.new("RGB", (128, 96)).save(dataset / "depth" / "0001.png")
    with pytest.raises(DataError, match="3 channels"):
        FolderPairs(dataset, ["0001"], units=DepthUnits())[0]


def test_depth_of_8_bits_needs_a_unit(dataset):
    Image.new("L", (128, 96), 100).save(dataset / "depth" / "0001.png")
    with pytest.raises(DataError, match=r"0001\.png` has 8 bits, ") as raised:
        FolderPairs(dataset, ["0001"], units=DepthUnits())[0]
    assert raised.value.hint.startswith("`--depth-scale")
    pair = FolderPairs(dataset, ["0001"], units=DepthUnits(0.04))[0]
    assert pair.depth_m[3, 3] == pytest.approx(4.0)


@pytest.mark.parametrize("folder", ["depth", "label40"])
def test_one_bit_a_pixel_is_neither_depth_nor_label(dataset, folder):
    Image.new("1", (128, 96), 1).save(dataset / folder / "0001.png")
    with pytest.raises(DataError, match=rf"{folder}/0001\.png` has 1 bit per pixel; expected"):
        FolderPairs(dataset, ["0001"], units=DepthUnits())[0]


@pytest.mark.parametrize(
    "option", ["--depth-scale=-1", "--depth-scale=0", "--depth-scale=nan", "--depth-offset=inf"]
)
def test_units_that_give_no_depth_are_refused(dataset, option):
    with pytest.raises(ConfigError, match=rf"`{option.replace('=', ' ')}.*; expected"):
        opened(dataset, option)


@pytest.mark.parametrize(("text", "word"), [("", "no ids"), ("a\nb\na", "twice")])
def test_a_bad_id_list_is_refused(tmp_path, text, word):
    path = tmp_path / "ids.txt"
    path.write_text(text)
    with pytest.raises(DataError, match=word):
        read_ids(path)


def test_a_list_that_is_missing_or_no_file_is_named(tmp_path):
    absent = tmp_path / "nolist.txt"
    with pytest.raises(DataError) as raised:
        read_ids(absent)
    assert str(raised.value) == f"`{absent}` is missing; expected a list of ids, one per line"
    with pytest.raises(DataError) as raised:
        read_ids(tmp_path)
    assert str(raised.value) == f"`{tmp_path}` is not a file; expected a list of ids, one per line"


def test_a_folder_of_data_that_is_missing_is_named(tmp_path):
    with pytest.raises(DataError) as raised:
        FolderPairs(tmp_path / "rooms", ["0001"], units=DepthUnits())
    message = f"`{tmp_path / 'rooms'}` is not a folder; expected one with `rgb/` and `depth/`, or "
    assert str(raised.value).startswith(message)


def test_two_files_of_one_image_are_named(dataset):
    image = dataset / "rgb" / "0003.png"
    Image.open(image).save(image.with_suffix(".jpg"))
    with pytest.raises(DataError) as raised:
        FolderPairs(dataset, ["0003"], units=DepthUnits())
    other = image.with_suffix(".jpg")
    assert str(raised.value).startswith(f"`{other}` and `{image}` are two files")


def test_a_list_may_have_a_mark_of_its_order_and_ids_with_spaces(tmp_path):
    path = tmp_path / "ids.txt"
    path.write_bytes("\ufeffliving room 1\r\n\r\n küche\n".encode())
    assert read_ids(path) == ["living room 1", "küche"]


def test_a_list_that_is_no_text_is_named(tmp_path):
    path = tmp_path / "ids.txt"
    path.write_text("0001\n", encoding="utf-16")
    with pytest.raises(DataError, match=r"ids\.txt` is not a list of ids in UTF-8"):
        read_ids(path)


@pytest.mark.parametrize("option", ["--depth-scale=0.001", "--depth-offset=0.5"])
def test_units_are_refused_where_depth_is_meters(dataset, option):
    name = option.partition("=")[0]
    with pytest.raises(OptionError, match=rf"`{name} .*`.*nyu\.mat` contains meters") as raised:
        opened(dataset / "nyu.mat", option)
    assert raised.value.hint.startswith("omit")
