"""The paired bootstrap: what it finds, what it must not find, and bad input."""

import numpy as np
import pytest
from runs import evaluate_tiny as evaluate
from runs import train

from nunet_models.cli import main
from nunet_models.errors import DataError
from nunet_models.evaluation.differences import paired_difference, read_scores
from nunet_models.export.onnx_file import read_metadata


def by_image(values):
    return {f"{index:04d}": float(value) for index, value in enumerate(values)}


def write(path, rows, columns="id,abs_rel,delta1"):
    path.write_text("\n".join([columns, *rows]) + "\n")
    return path


def test_a_small_gain_on_every_image_is_certain_however_much_images_differ():
    random = np.random.default_rng(1)
    hard = random.uniform(0.1, 0.9, 200)
    better = hard - 0.01 + random.normal(0.0, 0.01, 200)
    found = paired_difference(by_image(hard), by_image(better))
    assert found.certain and found.images == 200
    assert found.low < found.second - found.first < found.high < 0.0
    assert found.first == pytest.approx(hard.mean())


def test_the_interval_is_that_of_the_normal_distribution():
    change = np.random.default_rng(2).normal(0.0, 1.0, 400)
    found = paired_difference(by_image(np.zeros(400)), by_image(change))
    half = 1.96 * change.std() / 20.0
    assert found.low == pytest.approx(change.mean() - half, abs=0.01)
    assert found.high == pytest.approx(change.mean() + half, abs=0.01)


def test_the_interval_of_equal_networks_holds_zero_nineteen_times_in_twenty():
    random = np.random.default_rng(3)
    nothing = by_image(np.zeros(100))
    certain = [
        paired_difference(nothing, by_image(random.normal(0.0, 1.0, 100)), resamples=400).certain
        for _ in range(200)
    ]
    assert 2 <= sum(certain) <= 22


def test_the_same_images_give_the_same_interval():
    scores = by_image([0.1, 0.4, 0.3, 0.2]), by_image([0.2, 0.4, 0.1, 0.5])
    assert paired_difference(*scores) == paired_difference(*scores)


def test_images_without_the_metric_do_not_count():
    first, second = {"a": 1.0, "b": 2.0, "c": None}, {"a": 2.0, "b": 3.0, "c": 9.0}
    found = paired_difference(first, second)
    assert (found.first, found.second, found.low, found.high, found.images) == (1.5, 2.5, 1, 1, 2)


@pytest.mark.parametrize(
    ("second", "word"),
    [
        ({"a": 1.0, "c": 1.0}, "2 images are in one list only: `b`, `c`"),
        ({"a": 1.0, "b": None}, "1 images have the metric; expected 2 or more"),
    ],
)
def test_networks_that_cannot_be_compared_are_refused(second, word):
    with pytest.raises(DataError, match=word):
        paired_difference({"a": 1.0, "b": 2.0}, second)


def test_seeds_are_averaged_per_image(tmp_path):
    one = write(tmp_path / "0.csv", ["a,0.1,1", "b,,"])
    other = write(tmp_path / "1.csv", ["b,0.5,0", "a,0.3,1"])
    assert read_scores([one, other], "abs_rel") == {"a": pytest.approx(0.2), "b": None}


@pytest.mark.parametrize(
    ("rows", "columns", "word"),
    [
        (["a,1"], "id,rmse", "has no columns `id` and `abs_rel`"),
        (["a,good,1"], "id,abs_rel,delta1", "line 2: `good` is not a number"),
        (["a,nan,1"], "id,abs_rel,delta1", "line 2: `nan` is not a number"),
        (["b,1,1"], "id,abs_rel,delta1", "is of other images than"),
    ],
)
def test_bad_rows_are_said_by_file(tmp_path, rows, columns, word):
    good = write(tmp_path / "good.csv", ["a,0.1,1"])
    with pytest.raises(DataError, match=word) as raised:
        read_scores([good, write(tmp_path / "bad.csv", rows, columns)], "abs_rel")
    assert "bad.csv" in str(raised.value)


COLUMNS = "id,rmse,abs_rel,delta1,minmax_mse"


def report(tmp_path, first, second):
    out = tmp_path / "out"
    code = main(["report", "--out", str(out), "--difference", first, second])
    return code, (out / "report.md").read_text() if code == 0 else ""


def test_the_report_has_a_row_per_metric_of_each_pair(tmp_path):
    for name, more in (("unet-0", 0.0), ("unet-1", 0.0), ("wnet-0", 0.1), ("wnet-1", 0.3)):
        rows = [f"{i},{0.5 + more},{0.2 + more},{0.8 - more},0.04" for i in range(9)]
        write(tmp_path / f"{name}.csv", rows, COLUMNS)
    first, second = (f"{tmp_path}/{n}-0.csv,{tmp_path}/{n}-1.csv" for n in ("unet", "wnet"))
    code, text = report(tmp_path, first, second)
    assert code == 0
    start = "| unet-0, unet-1 | wnet-0, wnet-1 | "
    lines = [line.removeprefix(start) for line in text.splitlines() if line.startswith(start)]
    assert lines == [
        "rmse | 0.5000 | 0.7000 | +0.2000 | +0.2000 to +0.2000 |",
        "abs_rel | 0.2000 | 0.4000 | +0.2000 | +0.2000 to +0.2000 |",
        "delta1 | 0.8000 | 0.6000 | -0.2000 | -0.2000 to -0.2000 |",
        "minmax_mse | 0.0400 | 0.0400 | +0.0000 | +0.0000 to +0.0000 |",
    ]


def test_networks_without_meters_are_compared_by_the_paper_s_error_alone(tmp_path):
    for name in "ab":
        write(tmp_path / f"{name}.csv", ["0,,,,0.04", "1,,,,0.05"], COLUMNS)
    code, text = report(tmp_path, f"{tmp_path}/a.csv", f"{tmp_path}/b.csv")
    assert code == 0
    assert [line.split("|")[3] for line in text.splitlines() if line.startswith("| a |")] == [
        " minmax_mse "
    ]


def test_a_file_that_is_not_in_utf_8_is_named(tmp_path, capsys):
    write(tmp_path / "a.csv", ["0,0.1,0.1,0.9,0.04"], COLUMNS)
    (tmp_path / "b.csv").write_bytes("id,rmse\n".encode("utf-16"))
    assert report(tmp_path, f"{tmp_path}/a.csv", f"{tmp_path}/b.csv")[0] == 1
    assert "b.csv` is not a table in UTF-8" in capsys.readouterr().err


def test_a_missing_file_is_named(tmp_path, capsys):
    write(tmp_path / "a.csv", ["0,0.1,0.1,0.9,0.04"], COLUMNS)
    assert report(tmp_path, f"{tmp_path}/a.csv", f"{tmp_path}/absent.csv")[0] == 1
    assert "absent.csv`: no such file or directory" in capsys.readouterr().err


def test_a_network_behind_a_random_one_is_compared_with_one_alone(dataset, tmp_path, capsys):
    for name, architecture in (("unet", "unet"), ("random", "wnet_c")):
        run, model = tmp_path / name, tmp_path / f"{name}.onnx"
        options = ("--architecture", architecture, "--decoder", "8,8,8,6,4")
        assert train(dataset, run, *options, component="depth", epochs=1) == 0
        export = ["export", "--checkpoint", str(run / "best.pt"), "--out", str(model)]
        if name == "random":
            assert main(export) == 1
            assert "`segmentation` of" in capsys.readouterr().err
            assert main([*export, "--random", "depth"]) == 1
            assert "`--random depth`: component `depth` of" in capsys.readouterr().err
            export += ["--random", "segmentation"]
        assert main(export) == 0
        assert evaluate(dataset, "--csv", str(tmp_path / f"{name}.csv"), model=model) == 0
    assert read_metadata(tmp_path / "unet.onnx")["nunet.trained"] == "true"
    assert read_metadata(tmp_path / "random.onnx")["nunet.trained"] == "false"
    code, text = report(tmp_path, f"{tmp_path}/unet.csv", f"{tmp_path}/random.csv")
    assert code == 0
    assert len([line for line in text.splitlines() if line.startswith("| unet | random |")]) == 4
