"""Reports: tables from evaluations, figures from logs and images."""

import json
from pathlib import Path
from unittest.mock import ANY

import numpy as np
import pytest
from PIL import Image
from runs import TINY

from nunet_models.cli import main
from nunet_models.errors import DataError
from nunet_models.reporting.figures import NetworkDepth, comparable_panels, evolution
from nunet_models.reporting.table import metric_table, paper_table, read_evaluation
from nunet_models.training.log import RunLog

EVALUATION = {
    "model": "wnet_c.onnx",
    "architecture": "wnet_c",
    "epoch": 12,
    "pictures": 323,
    "metrics": {"rmse": 0.611, "abs_rel": 0.19, "delta1": 0.719},
    "image_mean": {"rmse": 0.59, "abs_rel": 0.18},
    "minmax": {"mse": 0.03, "rmse": 0.1732},
    "labels": {"accuracy": 0.7041},
    "baseline": {
        "metrics": {"rmse": 1.203},
        "image_mean": {"rmse": 1.115},
        "minmax": {"mse": 0.0527, "rmse": 0.23},
    },
}


def test_the_metric_table_ends_with_the_mean_image():
    lines = metric_table([EVALUATION]).splitlines()
    head, _, ours, mean = ([cell.strip() for cell in line.split("|")[1:-1]] for line in lines)
    errors = ["mse", "rmse", "rmse_log", "log10", "abs_rel", "sq_rel", "silog"]
    errors.insert(2, "rmse, mean of images")
    names = [*errors, "delta1", "delta2", "delta3", "mIoU", "accuracy"]
    assert head == ["model", "images", *names]
    known = {"rmse": "0.6110", "abs_rel": "0.1900", "delta1": "0.7190", "accuracy": "0.7041"}
    known["rmse, mean of images"] = "0.5900"
    assert ours == ["wnet_c.onnx", "323", *(known.get(name, "-") for name in names)]
    assert mean[:5] == ["mean image", "323", "-", "1.2030", "1.1150"]


def test_the_paper_s_figure_stands_beside_ours():
    lines = paper_table([EVALUATION]).splitlines()
    assert lines[2] == "| wnet_c.onnx | 12 | 0.0300 | 0.1732 | 0.0412 |"
    assert lines[3] == "| mean image | - | 0.0527 | 0.2300 | - |"


OF_NUNETD = {
    **{"contract": 1, "model": {"name": "wnet_c.onnx", "hash": "ab" * 32}},
    **{"architecture": "wnet_c", "dataset": "rooms", "protocol": "full", "units": "meters"},
    **{"pictures": 9, "skipped": 0, "metrics": {"rmse": 0.7}, "minmax": {}, "labels": {}},
    "baseline": None,
}
"""As `nunetd eval --json` writes it of a folder where nothing could be stretched."""


def test_a_result_of_nunetd_is_reported_and_what_was_not_measured_is_a_dash(tmp_path):
    path = tmp_path / "eval.json"
    path.write_text(json.dumps(OF_NUNETD))
    found = [read_evaluation(path)]
    assert metric_table(found).splitlines()[2:] == [
        "| wnet_c.onnx | 9 | - | 0.7000 |" + " - |" * 11,
    ]
    assert paper_table(found).splitlines()[2:] == ["| wnet_c.onnx | - | - | - | 0.0412 |"]


def test_a_result_may_begin_with_a_byte_order_mark(tmp_path):
    path = tmp_path / "eval.json"
    path.write_text(json.dumps(OF_NUNETD), encoding="utf-8-sig")
    assert read_evaluation(path)["model"] == "wnet_c.onnx"


@pytest.mark.parametrize("model", [3, {"name": 3}, {}, None])
def test_a_result_whose_model_has_no_name_is_refused(tmp_path, model):
    path = tmp_path / "eval.json"
    path.write_text(json.dumps(OF_NUNETD | {"model": model}))
    with pytest.raises(DataError, match="is not a result of `evaluate`: "):
        read_evaluation(path)


@pytest.mark.parametrize(
    "content",
    [
        json.dumps(OF_NUNETD).encode("utf-16"),
        json.dumps(OF_NUNETD | {"minmax": [1]}).encode(),
        json.dumps(OF_NUNETD | {"metrics": 0.7}).encode(),
    ],
)
def test_a_result_in_another_form_is_refused(tmp_path, content):
    path = tmp_path / "eval.json"
    path.write_bytes(content)
    with pytest.raises(DataError, match="is not a result of `evaluate`: "):
        read_evaluation(path)


@pytest.mark.parametrize(
    ("steps", "words"),
    [
        (b"step,loss\n1,much\n", "steps.csv`, line 2: could not convert"),
        (b"step,loss\n1\n", "steps.csv`, line 2: "),
        (b"step,rmse\n1,2\n", "steps.csv` has no columns `step` and `loss`"),
        ("step,loss\n".encode("utf-16"), "steps.csv` is not a log in UTF-8"),
    ],
)
def test_a_log_that_is_none_is_named(tmp_path, capsys, steps, words):
    (tmp_path / "steps.csv").write_bytes(steps)
    (tmp_path / "epochs.csv").write_text("epoch,rmse\n1,0.9\n")
    assert main(["report", "--out", str(tmp_path / "out"), "--run", str(tmp_path)]) == 1
    assert words in capsys.readouterr().err


def test_a_report_holds_tables_curves_and_images(dataset, tmp_path, capsys):
    run, out = tmp_path / "run", tmp_path / "out"
    run.mkdir()
    (run / "steps.csv").write_text("step,loss\n1,2.0\n2,1.0\n2,0.9\n")
    (run / "epochs.csv").write_text("epoch,rmse\n1,0.9\n2,0.8\n")
    log = RunLog(run)
    for epoch in range(1, 9):
        log.prediction(epoch, np.full((48, 64), epoch, np.float32))
    log.close()
    (tmp_path / "e.json").write_text(json.dumps(EVALUATION))
    code = main(
        [
            *("report", "--out", str(out), "--run", str(run)),
            *("--evaluation", str(tmp_path / "e.json"), "--model", str(TINY)),
            *("--data", str(dataset), "--ids", str(dataset / "val.txt")),
        ]
    )
    assert code == 0
    assert [caption for caption, _ in evolution(run)] == [f"run {k}" for k in (1, 2, 4, 5, 7, 8)]
    assert capsys.readouterr().out.strip() == str(out / "report.md")
    assert "| mean image |" in (out / "report.md").read_text()
    for name in ("losses.png", "evolution.png", "images.png"):
        assert min(Image.open(out / name).size) > 200


def test_networks_with_and_without_meters_are_shown_in_one_unit():
    """Else the colors of the truth's meters would show a depth of 0..1 as one near wall."""
    truth_m = np.array([[1.0, 3.0], [5.0, np.nan]], np.float32)
    relative = NetworkDepth(
        "relative", np.array([[0.0, 0.5], [1.0, 1.0]], np.float32), metric=False
    )
    metric = NetworkDepth("metric", np.array([[2.0, 4.0], [6.0, 60.0]], np.float32), metric=True)

    def shown(*answers):
        return {caption: depth.tolist() for caption, depth in comparable_panels(truth_m, answers)}

    assert shown(metric) == {"truth": ANY, "metric": metric.depth.tolist()}
    of_both = shown(relative, metric)
    assert list(of_both) == ["truth, 0..1", "relative", "metric"]
    for caption, depth in of_both.items():
        assert depth[0] == [0.0, 0.5], caption
        assert depth[1][0] == 1.0, caption


@pytest.mark.parametrize(
    ("options", "word"),
    [
        ([], "nothing to report"),
        (["--run", "absent"], "no log `absent/steps.csv`"),
        (["--evaluation", "README.md"], "is not a result of `evaluate`"),
        (["--model", str(TINY)], "which images"),
    ],
)
def test_what_cannot_be_reported_is_said(options, word, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(Path(__file__).parents[1])
    assert main(["report", "--out", str(tmp_path), *options]) == 1
    assert word in capsys.readouterr().err
