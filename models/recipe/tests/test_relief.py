"""Relief on flat panes: planes have none, whatever their angle; a bump has its height."""

import json

import numpy as np
import pytest
from PIL import Image
from runs import TINY

from nunet_models.cli import main
from nunet_models.data.sets.cameras import Pinhole
from nunet_models.errors import DataError
from nunet_models.evaluation.compare import Prediction
from nunet_models.evaluation.relief import (
    FlatImage,
    FlatImages,
    means_by_kind,
    pane_metrics,
    relief,
)
from nunet_models.zoo.spec import Camera

SHAPE = (60, 80)
PANE = np.zeros(SHAPE, bool)
PANE[10:50, 15:65] = True
CAMERA = Pinhole(fx=80.0, fy=80.0, cx=39.5, cy=29.5, width=80, height=60)
TRAINING = Camera(width=80, height=60, fx=80.0, fy=80.0)


def plane(slope=0.0, distance=2.0):
    """Depth of a plane that recedes to the right."""
    columns = np.arange(SHAPE[1]) - 39.5
    return np.tile(distance / (1 - slope * columns / 80.0), (SHAPE[0], 1)).astype(np.float32)


@pytest.mark.parametrize(("slope", "distance"), [(0.0, 2.0), (0.8, 2.0), (-0.5, 9.0)])
def test_a_plane_has_no_relief_at_any_angle_and_distance(slope, distance):
    assert relief(plane(slope, distance), PANE) == pytest.approx(0.0, abs=1e-4)


def test_a_bump_on_a_slanted_plane_has_nearly_its_height():
    depth = plane(0.3)
    depth[20:32, 30:50] -= 0.25
    assert relief(depth, PANE) == pytest.approx(0.25, abs=0.06)


def test_what_is_outside_of_the_pane_does_not_count():
    depth = plane(0.3)
    depth[~PANE] = 9.0
    assert relief(depth, PANE) == pytest.approx(0.0, abs=1e-4)


def flat_image():
    rgb, plain = np.full((*SHAPE, 3), 200, np.uint8), np.full((*SHAPE, 3), 100, np.uint8)
    return FlatImage("a", "mural", CAMERA, rgb, plain, PANE)


def with_ghost(rgb):
    """A network that sees a chair in the image, and none in the gray pane."""
    depth = plane(0.3)
    if rgb[0, 0, 0] == 200:
        depth[20:32, 30:50] -= 0.25
    return Prediction(depth, None)


def test_the_relief_of_the_image_is_compared_with_that_of_the_gray_pane():
    found = pane_metrics(flat_image(), with_ghost, TRAINING)
    assert found["plain_relief_m"] == pytest.approx(0.0, abs=1e-4)
    assert found["added_m"] == pytest.approx(found["relief_m"], abs=1e-4)
    bump, inside = 12 * 20, 34 * 44  # the pane without its edge of 3 pixels
    assert found["change_m"] == pytest.approx(0.25 * bump / inside, abs=1e-4)


def test_meters_follow_the_focal_length_of_the_image():
    twice = Camera(width=80, height=60, fx=40.0, fy=40.0)
    one, two = (pane_metrics(flat_image(), with_ghost, training) for training in (TRAINING, twice))
    assert two["relief_m"] == pytest.approx(2 * one["relief_m"])


def test_a_pane_that_is_hardly_visible_is_not_measured():
    image = flat_image()
    hidden = FlatImage(image.id, image.kind, CAMERA, image.rgb, image.plain, np.zeros(SHAPE, bool))
    assert pane_metrics(hidden, with_ghost, TRAINING) == {}


def test_means_are_by_kind_and_of_all():
    rows = [
        {"kind": kind, "relief_m": value, "plain_relief_m": 0.0, "added_m": value, "change_m": 0.0}
        for kind, value in (("mirror", 0.2), ("mirror", 0.4), ("poster", 0.0))
    ]
    means = means_by_kind(rows)
    assert (means["mirror"]["panes"], means["all"]["panes"]) == (2, 3)
    assert means["mirror"]["relief_m"] == pytest.approx(0.3)
    assert means["all"]["relief_m"] == pytest.approx(0.2)


def write_folder(root, *, kinds=("mural", "mirror")):
    for name in ("rgb", "plain", "panes"):
        (root / name).mkdir(parents=True)
    rows, views = ["id,fx,fy,cx,cy,width,height,sensor,scene"], ["id,kind,height_m"]
    for kind in kinds:
        rgb = np.random.default_rng(0).integers(0, 255, (*SHAPE, 3)).astype(np.uint8)
        Image.fromarray(rgb).save(root / f"rgb/{kind}.jpg")
        Image.fromarray(rgb // 2).save(root / f"plain/{kind}.jpg")
        Image.fromarray(PANE.astype(np.uint8) * 255).save(root / f"panes/{kind}.png")
        rows.append(f"{kind},80,80,39.5,29.5,80,60,rendered,{kind}")
        views.append(f"{kind},{kind},1.0")
    (root / "intrinsics.csv").write_text("\n".join(rows) + "\n")
    (root / "views.csv").write_text("\n".join(views) + "\n")
    return root


def test_the_command_prints_means_by_kind_and_writes_a_row_per_pane(tmp_path, capsys):
    folder, table = write_folder(tmp_path / "flat"), tmp_path / "tiny.csv"
    arguments = ["--model", str(TINY), "--flat-images", str(folder), "--csv", str(table)]
    assert main(["evaluate", *arguments]) == 0
    found = json.loads(capsys.readouterr().out)
    assert set(found["panes"]) == {"mural", "mirror", "all"}
    assert found["hidden"] == 0
    lines = table.read_text().splitlines()
    assert lines[0] == "id,kind,relief_m,plain_relief_m,added_m,change_m"
    assert [line.split(",")[0] for line in lines[1:]] == ["mirror", "mural"]
    out = str(tmp_path / "out")
    pair = ["--difference", str(table), str(table), "--metric", "added_m"]
    assert main(["report", "--out", out, *pair]) == 0
    text = (tmp_path / "out/report.md").read_text()
    assert "| tiny | tiny | added_m | " in text and "rmse" not in text


def test_a_folder_without_views_or_with_a_mask_of_another_size_is_an_error(tmp_path):
    folder = write_folder(tmp_path / "flat")
    Image.new("L", (10, 10)).save(folder / "panes/mirror.png")
    with pytest.raises(DataError, match=r"image `mirror` is \(60, 80\).*\(10, 10\)"):
        FlatImages(folder)[0]
    (folder / "views.csv").unlink()
    with pytest.raises(DataError, match=r"views\.csv`: no such file"):
        FlatImages(folder)
