import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rooms import CAMERA, HEADER, write_list, write_set

from nunet_models.data.sets import masks
from nunet_models.data.sets.cameras import COLUMNS
from nunet_models.data.sets.entry import read_dataset_list
from nunet_models.data.sets.folder import CameraSet
from nunet_models.data.sets.mixture import Mixture, open_dataset_list
from nunet_models.errors import ConfigError, DataError
from nunet_models.export.onnx_file import read_metadata

ROOM = 'name = "a"\nroot = "a"\n'
RECIPE = Path(__file__).parents[1]


@pytest.fixture
def room(tmp_path):
    write_set(tmp_path / "a")
    return tmp_path


def only(folder, text):
    return read_dataset_list(write_list(folder / "list.toml", text))[0]


def test_a_list_gives_its_sets_with_paths_from_its_folder(room):
    first, second = read_dataset_list(
        write_list(room / "list.toml", ROOM + "weight = 3", 'name = "b"\nroot = "/x"\nuse = "val"')
    )
    assert (first.root, first.weight, first.use) == (room / "a", 3, "train")
    assert (str(second.root), second.use, second.line) == ("/x", "val", 6)


@pytest.mark.parametrize(
    ("text", "line", "what"),
    [
        (ROOM + "wieght = 3", 4, "unknown key `wieght`"),
        (ROOM + "weight = 0", 4, "`weight` is 0"),
        (ROOM + "weight = true", 4, "`weight` is True"),
        (ROOM + "depth_range = [4, 1]", 4, "`depth_range`"),
        (ROOM + "window = [8, 8, 4, 9]", 4, "`window`"),
        (ROOM + 'use = "test"', 4, "`use`"),
        ('name = "a"', 1, "no `root`"),
    ],
)
def test_a_bad_key_is_named_with_file_and_line(tmp_path, text, line, what):
    with pytest.raises(DataError) as error:
        only(tmp_path, text)
    assert f"list.toml:{line}: " in str(error.value)
    assert what in str(error.value)


def test_a_list_without_sets_and_one_that_is_not_toml_are_refused(tmp_path):
    for text in (b"", b"sets = 3", b"[[set]\n", b"\xff"):
        path = tmp_path / "list.toml"
        path.write_bytes(text)
        with pytest.raises(DataError, match=r"list\.toml"):
            read_dataset_list(path)


def test_a_list_may_begin_with_a_byte_order_mark(room):
    path = write_list(room / "list.toml", ROOM)
    path.write_text(path.read_text(), encoding="utf-8-sig")
    assert read_dataset_list(path)[0].line == 1


def test_two_sets_of_one_name_are_refused(tmp_path):
    with pytest.raises(DataError, match=r"list.toml:6: set `a`: another set of line 1"):
        read_dataset_list(write_list(tmp_path / "list.toml", ROOM, ROOM))


def edit(path, change):
    path.write_text(change(path.read_text()))


def test_an_image_without_intrinsics_is_named(room):
    edit(room / "a/intrinsics.csv", lambda text: text.replace("002,", "009,"))
    with pytest.raises(DataError, match=r"list.toml:1: set `a`: image `002` has no row in"):
        CameraSet(only(room, ROOM))


def test_an_id_without_intrinsics_is_named_with_the_line_of_the_list_of_ids(room):
    edit(room / "a/intrinsics.csv", lambda text: text.replace("002,", "009,"))
    (room / "ids.txt").write_text("000\n\n002\n")
    with pytest.raises(DataError, match=r"ids.txt:3: image `002` has no row"):
        CameraSet(only(room, ROOM + 'ids = "ids.txt"'))


@pytest.mark.parametrize(
    ("change", "where"),
    [
        (lambda t: t.replace("001,80.0", "001,far"), r"intrinsics.csv:3: `fx` is `far`"),
        (lambda t: t.replace("001,80.0", "001,nan"), r"intrinsics.csv:3: `fx` is `nan`"),
        (lambda t: t.replace(f",{CAMERA.width},", ",inf,"), r"intrinsics.csv:2: `width` is `inf`"),
        (lambda t: t.replace("001,80.0", "001,-1"), r"intrinsics.csv:3: fx, fy"),
        (lambda t: t.replace("001,", "000,"), r"intrinsics.csv:3: id `000` appears twice"),
        (lambda t: t.replace("fx,", "f,"), r"intrinsics.csv:1: no column `fx`"),
        (
            lambda t: t.replace("128,96", "640,480"),
            r"intrinsics.csv:2: image `000` of .* is 128x96",
        ),
    ],
)
def test_bad_intrinsics_are_named_with_file_and_line(room, change, where):
    edit(room / "a/intrinsics.csv", change)
    with pytest.raises(DataError, match=where):
        CameraSet(only(room, ROOM))


def test_a_unit_that_puts_the_median_beyond_20_m_is_refused(room):
    with pytest.raises(DataError, match=r"list.toml:1: set `a`: the median depth of `000` is 2"):
        CameraSet(only(room, ROOM + "depth_scale = 0.01"))


def test_a_missing_folder_and_a_missing_depth_image_are_named(room):
    with pytest.raises(DataError, match=r"list.toml:1: set `a`: .*missing.* is not a folder"):
        CameraSet(only(room, ROOM.replace('root = "a"', 'root = "missing"')))
    (room / "a/depth/001.png").unlink()
    with pytest.raises(DataError, match=r"list.toml:1: set `a`: .*001.png` is missing"):
        CameraSet(only(room, ROOM))


def test_a_growing_folder_skips_what_is_not_whole_yet(room):
    (room / "a/depth/001.png").unlink()
    edit(room / "a/intrinsics.csv", lambda text: text.rstrip("\n"))  # the row of 003
    mixture = Mixture([only(room, ROOM + "growing = true")])
    assert mixture.ids == ["a/000", "a/002"]
    edit(room / "a/intrinsics.csv", lambda text: text + "\n")
    mixture.refresh()
    assert mixture.ids == ["a/000", "a/002", "a/003"]


def test_scenes_select_images_and_an_unknown_scene_is_refused(room):
    assert CameraSet(only(room, ROOM + 'scenes = ["attic"]')).ids == ["002", "003"]
    assert CameraSet(only(room, ROOM + 'except_scenes = ["attic"]')).ids == ["000", "001"]
    with pytest.raises(DataError, match="no scene `cellar`; expected one of attic, hall"):
        CameraSet(only(room, ROOM + 'scenes = ["cellar"]'))


def test_a_room_is_drawn_as_often_as_its_weight_whatever_its_images(tmp_path):
    write_set(tmp_path / "a", scenes=("hall",) * 7 + ("attic",))
    write_set(tmp_path / "b", scenes=("", "", ""))
    path = write_list(tmp_path / "list.toml", ROOM, 'name = "b"\nroot = "b"\nweight = 2\nrooms = 3')
    mixture = Mixture(read_dataset_list(path))
    names = np.array([i.split("/")[0] for i in mixture.ids])
    rooms = np.array([mixture.sets[s].room(i) for s, i in mixture.index])
    share = {r: mixture.chances[(rooms == r) & (names == "a")].sum() for r in ("hall", "attic")}
    assert share["hall"] == pytest.approx(1 / 8)
    assert share["attic"] == pytest.approx(1 / 8)
    assert mixture.chances[names == "b"].sum() == pytest.approx(6 / 8)


def test_training_and_validation_share_no_scene_and_no_image(room):
    train = ROOM + 'scenes = ["attic"]'
    val = 'name = "v"\nroot = "a"\nuse = "val"\n'
    open_dataset_list(write_list(room / "list.toml", train, val + 'scenes = ["hall"]'))
    with pytest.raises(ConfigError, match="also in the training set `a`"):
        open_dataset_list(write_list(room / "list.toml", train, val))


def test_depth_out_of_the_sensors_range_has_no_truth(room):
    depth = CameraSet(only(room, ROOM + "depth_range = [1.5, 2.5]"))[0].pair.depth_m
    whole = CameraSet(only(room, ROOM))[0].pair.depth_m
    inside = (whole >= 1.5) & (whole <= 2.5)
    assert 0 < inside.sum() < inside.size
    assert np.array_equal(np.isfinite(depth), inside)


def test_edges_of_depth_are_eroded_and_slopes_are_not():
    depth = np.full((9, 20), 1.0, np.float32) + np.linspace(0, 0.2, 20, dtype=np.float32)
    assert np.isfinite(masks.without_edges(depth, 3)).all()
    depth[:, 10:] += 1.0
    found = np.isfinite(masks.without_edges(depth, 3))
    assert found[:, :7].all()
    assert found[:, 13:].all()
    assert not found[:, 7:13].any()


def test_sparse_depth_counts_for_its_neighbors_the_nearer_one_first():
    depth = np.full((5, 7), np.nan, np.float32)
    depth[2, 2], depth[2, 4] = 3.0, 2.0
    found = masks.spread_sparse(depth)
    assert np.isfinite(found).sum() == 15
    assert (found[2, 2], found[2, 3], found[1, 1]) == (3.0, 2.0, 3.0)


def test_a_set_of_one_camera_needs_no_csv(room):
    (room / "a/intrinsics.csv").unlink()
    images = CameraSet(only(room, ROOM + 'intrinsics = "80,80,63.5,47.5@128x96"'))
    assert images[1].camera == CAMERA
    with pytest.raises(DataError, match="`intrinsics` is `80,80`"):
        CameraSet(only(room, ROOM + 'intrinsics = "80,80"'))
    with pytest.raises(DataError, match="is 128x96, but its intrinsics are for 64x48"):
        CameraSet(only(room, ROOM + 'intrinsics = "80,80,63.5,47.5@64x48"'))
    with pytest.raises(DataError, match=r"intrinsics.csv`: no such file"):
        CameraSet(only(room, ROOM))


def test_the_csv_of_the_documentation_is_the_one_that_is_read():
    assert ",".join(COLUMNS) == HEADER


def shipped_list(name):
    return read_dataset_list(RECIPE / "lists" / name)


def test_the_list_of_the_shipped_model_names_the_sets_in_its_metadata():
    entries = shipped_list("near_sets.toml")
    training = json.loads(read_metadata(RECIPE.parent / "wnet_c.onnx")["nunet.training"])
    trained = {entry["set"] for entry in training["depth"]["data"]["train_sets"]}
    assert {entry.name for entry in entries if entry.use == "train"} == trained
    assert len(trained) == 11


def test_the_list_of_the_shipped_labels_has_the_sets_of_the_other_one_that_have_labels():
    every = {(e.use, e.name): e for e in shipped_list("wnet_c_sets.toml")}
    entries = shipped_list("labels.toml")
    for entry in entries:
        other = every[entry.use, entry.name]
        same = {"file": other.file, "line": other.line, "weight": other.weight}
        assert replace(entry, **same) == other
    trained = {entry.name: entry.weight for entry in entries if entry.use == "train"}
    assert trained == {"nyu": 2, "rendered1": 0.9}


@pytest.mark.parametrize("name", ["wnet_c_sets.toml", "near_sets.toml", "labels.toml"])
def test_a_shipped_list_can_be_copied_to_its_data(name, tmp_path):
    entries = read_dataset_list(Path(shutil.copy(RECIPE / "lists" / name, tmp_path)))
    for path in [entry.root for entry in entries] + [e.ids for e in entries if e.ids]:
        assert path.is_relative_to(tmp_path) and ".." not in path.parts
