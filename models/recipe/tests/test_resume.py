"""Runs that were stopped: what resumes them, and what is refused."""

import json
from dataclasses import replace

import pytest
import torch
from runs import rows, train

from nunet_models.cli import main
from nunet_models.export.onnx_file import read_metadata
from nunet_models.zoo import SerialGraph
from nunet_models.zoo.checkpoint import Checkpoint

pytestmark = pytest.mark.usefixtures("every_step_logged")


def test_a_stopped_run_resumes_to_the_same_losses(dataset, tmp_path):
    whole, halved = tmp_path / "whole", tmp_path / "halved"
    noise = ("--dropout", "0.3", "--no-bf16")
    assert train(dataset, whole, *noise) == 0
    assert train(dataset, halved, "--minutes", "1e-9", *noise) == 0  # one step, then the budget
    while len(rows(halved, "steps.csv")) < 4:
        assert train(dataset, halved, "--minutes", "1e-9", "--resume", *noise) == 0
    losses = [[row["loss"] for row in rows(run, "steps.csv")] for run in (whole, halved)]
    assert losses[0] == losses[1]
    train(dataset, halved, "--resume", *noise)
    one, other = (Checkpoint.load(run / "last.pt").weights for run in (whole, halved))
    assert all(torch.equal(one[name], other[name]) for name in one)


@pytest.mark.parametrize(("every", "steps"), [(4, ["4"]), (3, ["3", "4"]), (20, ["4"])])
def test_rows_of_several_steps_are_the_same_after_any_stop(
    dataset, tmp_path, monkeypatch, every, steps
):
    monkeypatch.setattr("nunet_models.training.trainer.LOG_EVERY", every)
    whole, halved = tmp_path / "whole", tmp_path / "halved"
    how = ("--batch", "1", "--workers", "0", "--architecture", "wnet")
    assert train(dataset, whole, *how, epochs=1) == 0
    for _ in range(4):
        assert train(dataset, halved, "--minutes", "1e-9", "--resume", *how, epochs=1) == 0
    assert train(dataset, halved, "--resume", *how, epochs=1) == 0
    assert [row["step"] for row in rows(halved, "steps.csv")] == steps
    assert rows(halved, "steps.csv") == rows(whole, "steps.csv")


def test_the_license_may_be_stated_when_a_run_is_resumed(dataset, tmp_path):
    assert train(dataset, tmp_path, "--minutes", "1e-9") == 0
    for license, recorded in (("", None), ("CC0, ours", "CC0, ours"), ("", "CC0, ours")):
        more = ("--license", license) if license else ()
        assert train(dataset, tmp_path, "--minutes", "1e-9", "--resume", *more) == 0
        (known,) = Checkpoint.load(tmp_path / "last.pt").provenance.values()
        assert known.get("license") == recorded


def test_a_run_is_not_overwritten_without_resume(dataset, tmp_path, capsys):
    (tmp_path / "last.pt").touch()
    assert train(dataset, tmp_path) == 1
    assert "hint: `--resume`" in capsys.readouterr().err


def test_the_best_epoch_is_on_disk_before_the_run_goes_past_it(dataset, tmp_path, monkeypatch):
    saved = []

    def save(self, path, whole=Checkpoint.save):
        saved.append(path.name)
        whole(self, path)

    monkeypatch.setattr(Checkpoint, "save", save)
    assert train(dataset, tmp_path, epochs=1) == 0
    assert saved == ["best.pt", "last.pt"]


def test_a_run_that_had_a_drop_path_to_no_effect_is_resumed(dataset, tmp_path):
    assert train(dataset, tmp_path, "--minutes", "1e-9", epochs=1) == 0
    checkpoint = Checkpoint.load(tmp_path / "last.pt")
    first, second = checkpoint.spec.components
    had = (first.changed(drop_path=0.1), second)
    replace(checkpoint, spec=replace(checkpoint.spec, components=had)).save(tmp_path / "last.pt")
    assert train(dataset, tmp_path, "--resume", "--drop-path", "0.1", epochs=1) == 0


def test_a_damaged_checkpoint_is_refused_by_name(tmp_path, dataset, capsys):
    (tmp_path / "last.pt").write_bytes(b"no checkpoint")
    assert train(dataset, tmp_path, "--resume") == 1
    stderr = capsys.readouterr().err
    assert (
        "last.pt` is not a checkpoint of this package, or damaged; hint: `train` writes" in stderr
    )
    assert "weights_only" not in stderr and "torch" not in stderr


def test_a_run_of_another_graph_is_not_resumed(dataset, tmp_path, capsys):
    assert train(dataset, tmp_path, epochs=1) == 0
    assert train(dataset, tmp_path, "--resume", "--architecture", "wnet", epochs=2) == 1
    assert "trains another graph" in capsys.readouterr().err


def test_a_run_resumed_with_other_options_lists_each_of_them(dataset, tmp_path, capsys):
    assert train(dataset, tmp_path, "--minutes", "1e-9", "--lr", "0.002") == 0
    other = ("--lr", "0.001", "--no-bf16", "--loss", "mse", "--threads", "1", "--workers", "0")
    assert train(dataset, tmp_path, "--resume", *other, epochs=3) == 1
    stderr = capsys.readouterr().err
    assert "`--lr 0.002`, given `--lr 0.001`; `--loss l1_log=1,silog=0.5,gradient=0.5`, " in stderr
    assert "; `--bf16`, given `--no-bf16`; hint: " in stderr
    assert f"`--start {tmp_path / 'best.pt'}`" in stderr
    assert not any(word in stderr for word in ("workers", "epochs", "threads"))


def test_a_run_is_not_resumed_on_other_images(dataset, tmp_path, capsys):
    assert train(dataset, tmp_path, epochs=1) == 0
    (dataset / "val.txt").write_text("0005\n0004\n")
    assert train(dataset, tmp_path, "--resume", epochs=1) == 1
    stderr = capsys.readouterr().err
    assert "another list than that of `--val-ids`" in stderr and "train-ids" not in stderr


def test_a_run_may_be_resumed_for_more_epochs_and_validate_more_rarely(dataset, tmp_path):
    assert train(dataset, tmp_path, epochs=1) == 0
    assert train(dataset, tmp_path, "--resume", "--validate-every", "2", epochs=3) == 0
    assert [row["epoch"] for row in rows(tmp_path, "epochs.csv")] == ["1", "2", "3"]
    assert Checkpoint.load(tmp_path / "last.pt").settings["segmentation"]["epochs"] == 3


def test_a_checkpoint_of_an_earlier_version_is_resumed(dataset, tmp_path):
    assert train(dataset, tmp_path, "--minutes", "1e-9", epochs=1) == 0
    checkpoint = Checkpoint.load(tmp_path / "last.pt")
    for name in ("losses", "trains"):
        del checkpoint.progress[name]
    checkpoint.progress["ids"] = {"--train-ids": "ab" * 32, "--val-ids": "cd" * 32}
    for name in ("workers", "validate_every", "joint_noise"):
        del checkpoint.settings["segmentation"][name]
    checkpoint.save(tmp_path / "last.pt")
    assert train(dataset, tmp_path, "--resume", epochs=1) == 0
    assert len(rows(tmp_path, "epochs.csv")) == 1


def test_unfrozen_components_learn_along_and_resume_to_the_same_weights(dataset, tmp_path):
    whole, halved = tmp_path / "whole", tmp_path / "halved"
    options = ("--unfrozen", "--no-bf16")
    assert train(dataset, whole, *options, component="depth", epochs=1) == 0
    assert train(dataset, halved, "--minutes", "1e-9", *options, component="depth", epochs=1) == 0
    assert train(dataset, halved, "--resume", *options, component="depth", epochs=1) == 0
    one, other = (Checkpoint.load(run / "last.pt") for run in (whole, halved))
    assert all(torch.equal(one.weights[name], other.weights[name]) for name in one.weights)
    torch.manual_seed(0)
    start = SerialGraph(one.spec).state_dict()
    name = "components.0.unet.segmentation_head.0.weight"
    assert not torch.equal(start[name], one.weights[name])


def test_a_checkpoint_that_knows_no_provenance_still_loads_resumes_and_exports(dataset, tmp_path):
    run, model = tmp_path / "run", tmp_path / "model.onnx"
    unet = ("--architecture", "unet")
    assert train(dataset, run, *unet, component="depth", epochs=1) == 0
    for name in ("last.pt", "best.pt"):
        values = torch.load(run / name, weights_only=True)
        del values["provenance"]
        torch.save(values, run / name)
    assert main(["export", "--checkpoint", str(run / "best.pt"), "--out", str(model)]) == 0
    assert "data" not in json.loads(read_metadata(model)["nunet.training"])["depth"]
    assert train(dataset, run, *unet, "--resume", component="depth", epochs=2) == 0
    assert Checkpoint.load(run / "last.pt").provenance == {}


def test_weights_to_go_on_from_are_half_the_size_and_nearly_the_same(dataset, tmp_path):
    run, halved = tmp_path / "run", tmp_path / "weights.pt"
    assert train(dataset, run, "--architecture", "wnet_c", epochs=1) == 0
    best = run / "best.pt"
    assert main(["export", "--checkpoint", str(best), "--out", str(halved)]) == 0
    assert halved.stat().st_size < 0.6 * best.stat().st_size
    whole, small = Checkpoint.load(best).graph(), Checkpoint.load(halved).graph()
    for name, tensor in whole.state_dict().items():
        torch.testing.assert_close(small.state_dict()[name], tensor, rtol=1e-3, atol=1e-6)
    onward = ("--start", str(halved))
    assert train(dataset, tmp_path / "on", *onward, component="depth", epochs=1) == 0


def test_validation_may_be_rarer_and_the_last_epoch_is_always_validated(dataset, tmp_path):
    options = ("--architecture", "unet", "--validate-every", "2")
    assert train(dataset, tmp_path, *options, component="depth", epochs=3) == 0
    assert [row["epoch"] for row in rows(tmp_path, "epochs.csv")] == ["2", "3"]
