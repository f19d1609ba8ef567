"""Training of tiny networks: it learns, stops in time, and resumes to the same losses."""

import hashlib
import json
import shutil
from dataclasses import replace

import numpy as np
import pytest
import torch
from PIL import Image
from runs import rows, train

from nunet_models.classes import IGNORE
from nunet_models.cli import main
from nunet_models.data.cache import Cached
from nunet_models.errors import ConfigError
from nunet_models.export.collections import tiny_spec
from nunet_models.export.onnx_file import read_metadata
from nunet_models.training.ema import Averaged
from nunet_models.training.schedule import learning_rate_factor
from nunet_models.training.trainer import Trainer
from nunet_models.training.validate import validate
from nunet_models.zoo import SerialGraph
from nunet_models.zoo.backbones import build_unet, check_drop_path
from nunet_models.zoo.checkpoint import Checkpoint
from nunet_models.zoo.spec import LITE_DECODER


@pytest.fixture(autouse=True)
def every_step_logged(monkeypatch):
    monkeypatch.setattr("nunet_models.training.trainer.LOG_EVERY", 1)


def test_a_run_leaves_logs_checkpoints_and_tensorboard(dataset, tmp_path):
    run = tmp_path / "run"
    assert train(dataset, run) == 0
    assert len(rows(run, "steps.csv")) == 4
    assert [row["epoch"] for row in rows(run, "epochs.csv")] == ["1", "2"]
    assert len(list((run / "evolution").iterdir())) == 2
    assert (run / "best.pt").is_file() and list((run / "tensorboard").iterdir())
    assert len(Checkpoint.load(run / "last.pt").history["segmentation"]) == 2


def test_the_image_to_show_is_kept_at_each_validation(dataset, tmp_path):
    image = next((dataset / "rgb").iterdir())
    assert train(dataset, tmp_path, "--show", str(image), epochs=1) == 0
    (kept,) = (tmp_path / "evolution").iterdir()
    height, width = Image.open(image).size[::-1]
    assert np.load(kept).shape == (height // 2, width // 2)


def test_a_image_to_show_that_is_none_is_named(dataset, tmp_path, capsys):
    assert train(dataset, tmp_path, "--show", str(dataset / "val.txt")) == 1
    assert f"`{dataset / 'val.txt'}` cannot be read as an image" in capsys.readouterr().err


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


def test_depth_trains_behind_a_frozen_segmentation(dataset, tmp_path):
    first, second = tmp_path / "first", tmp_path / "second"
    assert train(dataset, first, epochs=1) == 0
    start = ("--start", str(first / "best.pt"), "--like", "segmentation", "--joint-noise", "0.2")
    assert train(dataset, second, *start, component="depth", epochs=8) == 0
    before = Checkpoint.load(first / "best.pt").weights
    after = Checkpoint.load(second / "last.pt").weights
    for name in before:
        if name.startswith("components.0"):
            assert torch.equal(before[name], after[name]), name
    metrics = rows(second, "epochs.csv")
    assert float(metrics[-1]["rmse"]) < float(metrics[0]["rmse"])


def test_a_run_is_not_overwritten_without_resume(dataset, tmp_path, capsys):
    (tmp_path / "last.pt").touch()
    assert train(dataset, tmp_path) == 1
    assert "hint: `--resume`" in capsys.readouterr().err


def test_lists_that_share_ids_are_refused_with_some_of_them(dataset, tmp_path, capsys):
    (dataset / "val.txt").write_text("0005\n0003\n0001\n0000\n0002\n")
    assert train(dataset, tmp_path) == 1
    stderr = capsys.readouterr().err
    assert "val.txt` share 4 ids: `0000`, `0001`, `0002` ...; hint: " in stderr
    assert not (dataset / "cache").exists()


@pytest.mark.parametrize(
    "options",
    [
        ("--epochs 0", "at least 1"),
        ("--batch 0", "at least 1"),
        ("--validate-every 0", "at least 1"),
        ("--threads 0", "at least 1"),
        ("--workers -1", "0 or more"),
        ("--seed -1", "0 to 2^64 - 1"),
        ("--lr 0.0", "more than 0"),
        ("--lr inf", "more than 0"),
        ("--encoder-lr -1.0", "0 or more"),
        ("--weight-decay nan", "0 or more"),
        ("--warmup 1.0", "0 <= x < 1"),
        ("--ema 1.0", "0 <= x < 1"),
        ("--clip -1.0", "0 (none) or more"),
        ("--joint-noise 1.5", "0 <= x <= 1"),
        ("--dropout 1.0", "0 <= x < 1"),
        ("--drop-path -0.1", "0 <= x < 1"),
        ("--minutes 0.0", "more than 0; hint: no limit without it"),
        ("--minutes nan", "more than 0"),
    ],
)
def test_a_number_that_no_training_can_have_is_a_bad_argument(dataset, tmp_path, capsys, options):
    option, expected = options
    assert train(dataset, tmp_path, *option.split()) == 2
    assert f"`{option}`; expected {expected}" in capsys.readouterr().err
    assert not (dataset / "cache").exists() and not (tmp_path / "last.pt").exists()


def test_a_recurrent_network_is_not_trained_on_single_images(dataset, tmp_path, capsys):
    """Each would start from a zero state, and the weights that read it would never change."""
    lstm = ("--architecture", "wnet_c_lstm")
    assert train(dataset, tmp_path, *lstm, component="depth", epochs=1) == 2
    stderr = capsys.readouterr().err
    assert "`--component depth` of `wnet_c_lstm` is recurrent; single images leave" in stderr
    assert "`--architecture wnet_c` is the same network without a state" in stderr
    assert not (dataset / "cache").exists() and not (tmp_path / "last.pt").exists()
    assert train(dataset, tmp_path, *lstm, component="segmentation", epochs=1) == 0


def test_a_batch_that_no_epoch_fills_is_refused(dataset, tmp_path, capsys):
    assert train(dataset, tmp_path, "--batch", "5") == 1
    assert "names 4 images; expected at least `--batch 5`" in capsys.readouterr().err


def test_a_loss_is_refused_before_anything_is_decoded(dataset, tmp_path, capsys):
    assert train(dataset, tmp_path, "--loss", "mse=1,mse=2") == 2
    assert "`--loss mse=1,mse=2` names `mse` twice; hint: " in capsys.readouterr().err
    assert not (dataset / "cache").exists()


def test_a_component_does_not_start_as_it_is_itself(dataset, tmp_path, capsys):
    assert train(dataset, tmp_path, "--like", "depth", component="depth") == 1
    assert "`--like depth` names the component to train itself" in capsys.readouterr().err


def test_a_loss_that_is_no_number_stops_before_any_weight_is_lost(dataset, tmp_path, monkeypatch):
    before, after = [], []

    def broken(raw, labels, **_):
        return raw.sum() * float("nan")

    def trained(component):
        return [p.detach().clone() for p in component.parameters()]

    def step(self, batch, forward, whole=Trainer._step):
        before.extend(trained(self.component))
        try:
            return whole(self, batch, forward)
        finally:
            after.extend(trained(self.component))

    monkeypatch.setattr("nunet_models.training.objective.cross_entropy", broken)
    monkeypatch.setattr(Trainer, "_step", step)
    assert train(dataset, tmp_path, epochs=1) == 1
    assert before and all(torch.equal(*two) for two in zip(before, after, strict=True))


def test_a_missing_list_is_said_to_be_missing(dataset, tmp_path, capsys):
    absent = tmp_path / "nolist.txt"
    assert train(dataset, tmp_path / "run", "--train-ids", str(absent)) == 1
    stderr = capsys.readouterr().err
    assert stderr == f"nunet_models: `{absent}` is missing; expected a list of ids, one per line\n"


def test_a_file_that_the_system_refuses_is_reported_without_its_number(dataset, tmp_path, capsys):
    absent = tmp_path / "absent.pt"
    assert train(dataset, tmp_path / "run", "--begin-with", str(absent)) == 1
    stderr = capsys.readouterr().err
    assert str(absent) in stderr and "[Errno" not in stderr


def test_segmentation_without_labels_is_refused(dataset, tmp_path, capsys):
    shutil.rmtree(dataset / "label40")
    assert train(dataset, tmp_path / "run") == 1
    assert "no labels" in capsys.readouterr().err


def test_a_quiet_training_draws_no_bar(dataset, tmp_path, capsys):
    assert train(dataset, tmp_path, "--intrinsics", "60,60,64,48@128x96", epochs=1) == 0
    assert not capsys.readouterr().err


@pytest.mark.parametrize("component", ["segmentation", "depth"])
@pytest.mark.parametrize(("ids", "name"), [(range(4), "training"), (range(4, 6), "validation")])
def test_data_without_truth_is_refused_before_the_first_step(
    dataset, tmp_path, capsys, component, ids, name
):
    folder, blank = ("label40", 255) if component == "segmentation" else ("depth", 0)
    for index in ids:
        image = Image.fromarray(np.full((96, 128), blank, np.uint16))
        image.save(dataset / folder / f"{index:04d}.png")
    assert train(dataset, tmp_path / "run", component=component) == 1
    what = "labels" if component == "segmentation" else "depth"
    assert f"the {name} data has no {what}; hint: " in capsys.readouterr().err
    assert not (tmp_path / "run").exists()


def test_truth_that_no_crop_shows_is_said_to_be_so():
    depth = np.zeros((1, 480, 640), np.uint16)
    depth[0, :4, :4] = 10_000
    labels = np.full(depth.shape, IGNORE, np.uint8)
    data = Cached(("corner",), np.zeros((1, 480, 640, 3), np.uint8), depth, labels)
    graph = SerialGraph(tiny_spec("unet")).eval()
    with pytest.raises(ConfigError, match="no pixel of the validation images"):
        validate(graph, data, component=0, batch=1, bf16=False, workers=0)


def test_the_best_epoch_is_on_disk_before_the_run_goes_past_it(dataset, tmp_path, monkeypatch):
    saved = []

    def save(self, path, whole=Checkpoint.save):
        saved.append(path.name)
        whole(self, path)

    monkeypatch.setattr(Checkpoint, "save", save)
    assert train(dataset, tmp_path, epochs=1) == 0
    assert saved == ["best.pt", "last.pt"]


@pytest.mark.parametrize("backbone", ["tiny", "resnet18", "dla34"])
def test_drop_path_is_refused_where_it_would_do_nothing(dataset, tmp_path, capsys, backbone):
    options = ("--backbone", backbone, "--drop-path", "0.1", "--architecture", "unet", "--resume")
    assert train(dataset, tmp_path, *options, component="depth") == 1
    assert f"backbone `{backbone}` has no drop path" in capsys.readouterr().err


def test_drop_path_is_taken_where_a_backbone_knows_it():
    check_drop_path("efficientnet_lite0")
    unet = build_unet(
        "efficientnet_lite0",
        in_channels=3,
        out_channels=1,
        decoder_channels=LITE_DECODER,
        drop_path=0.1,
    )
    assert any(type(module).__name__ == "DropPath" for module in unet.modules())


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


def test_an_average_follows_its_module_slowly():
    module = torch.nn.Linear(1, 1, bias=False)
    torch.nn.init.zeros_(module.weight)
    averaged = Averaged(module, decay=0.9)
    torch.nn.init.ones_(module.weight)
    averaged.update(step=10**6)
    assert averaged.module.weight.item() == pytest.approx(0.1)


def test_an_average_without_decay_is_the_module_itself():
    module = torch.nn.Linear(1, 1, bias=False)
    averaged = Averaged(module, decay=0.0)
    torch.nn.init.ones_(module.weight)
    averaged.update(step=1)
    assert averaged.module.weight.item() == 1.0 and module.training


def test_a_lone_depth_network_starts_as_a_checkpoint_s_segmentation(dataset, tmp_path):
    seg, depth = tmp_path / "seg", tmp_path / "depth"
    assert train(dataset, seg, "--architecture", "wnet", epochs=1) == 0
    like = ("--architecture", "unet", "--like", f"segmentation={seg / 'best.pt'}")
    like = (*like, "--lr", "1e-30")  # which moves no weight
    assert train(dataset, depth, *like, component="depth", epochs=1) == 0
    theirs = Checkpoint.load(seg / "best.pt").component_weights("segmentation")
    ours = Checkpoint.load(depth / "best.pt").component_weights("depth")
    name = next(name for name, weights in ours.items() if weights.dim() == 4)
    assert torch.equal(ours[name], theirs[name])
    origin = Checkpoint.load(depth / "best.pt").provenance["depth"]["origin"]["like"]
    assert (origin["component"], origin["file"]) == ("segmentation", "best.pt")


def test_the_schedule_rises_falls_and_ends_at_its_final_share():
    def factor(step):
        return learning_rate_factor(step, steps=100, warmup=0.1, final=0.01, schedule="cosine")

    assert factor(0) == pytest.approx(0.1)
    assert factor(9) == pytest.approx(1.0)
    assert factor(55) == pytest.approx(0.505)
    assert factor(100) == pytest.approx(0.01)


def test_a_frozen_component_keeps_its_batch_norm_statistics():
    graph = SerialGraph(tiny_spec("wnet_c"))
    graph.components[0].freeze()
    before = {k: v.clone() for k, v in graph.components[0].state_dict().items()}
    graph.train()
    graph(torch.rand(2, 3, 96, 128))
    after = graph.components[0].state_dict()
    assert all(torch.equal(before[k], after[k]) for k in before)


def test_a_trained_run_becomes_a_file_that_says_how_it_was_trained(dataset, tmp_path, capsys):
    run, model = tmp_path / "run", tmp_path / "model.onnx"
    accuracy = tmp_path / "accuracy.json"
    accuracy.write_text('{"metrics": {"rmse": 0.6}}', encoding="utf-8-sig")
    assert train(dataset, run, "--architecture", "unet", component="depth", epochs=1) == 0
    export = ["export", "--checkpoint", str(run / "best.pt"), "--accuracy", str(accuracy)]
    whole = accuracy.read_text()
    for text, word in ((whole[:-1], "is not JSON: "), ("[]", "is not a JSON object")):
        accuracy.write_text(text)
        assert main([*export, "--out", str(model)]) == 1
        assert f"`{accuracy}` {word}" in capsys.readouterr().err and not model.exists()
    accuracy.write_text(whole)
    assert main([*export, "--out", str(model)]) == 0
    values = read_metadata(model)
    assert values["nunet.trained"] == "true"
    training = json.loads(values["nunet.training"])["depth"]
    assert training["epochs_done"] == 1
    ids = "0000\n0001\n0002\n0003\n"
    assert training["data"]["train"] == {
        "pictures": 4,
        "ids_sha256": hashlib.sha256(ids.encode()).hexdigest(),
    }
    assert (training["data"]["name"], training["data"]["depth_scale"]) == ("rooms", 0.001)
    assert (training["dropout"], training["origin"]) == (0.0, {})
    assert json.loads(values["nunet.accuracy"]) == {"metrics": {"rmse": 0.6}}


def test_a_graph_with_an_untrained_component_is_not_exported_as_trained(dataset, tmp_path, capsys):
    run, model = tmp_path / "run", tmp_path / "model.onnx"
    assert train(dataset, run, epochs=1) == 0
    assert main(["export", "--checkpoint", str(run / "best.pt"), "--out", str(model)]) == 1
    stderr = capsys.readouterr().err
    assert "component `depth` of" in stderr and "is untrained, its weights are random" in stderr
    assert f"hint: `train --component depth --start {run / 'best.pt'}`" in stderr
    assert not model.exists()


def test_a_run_without_a_validated_epoch_is_not_exported(dataset, tmp_path, capsys):
    run, model = tmp_path / "run", tmp_path / "model.onnx"
    unet = ("--architecture", "unet", "--minutes", "1e-9")
    assert train(dataset, run, *unet, component="depth") == 0
    assert main(["export", "--checkpoint", str(run / "last.pt"), "--out", str(model)]) == 1
    assert "component `depth` of" in (stderr := capsys.readouterr().err)
    assert "has no validated epoch yet; hint: continue with `--resume`" in stderr


def test_what_learned_along_with_a_later_component_counts_as_trained():
    spec = tiny_spec("wnet_c")
    history = {"depth": [{"epoch": 1}]}
    alone = Checkpoint(spec, {}, history=history, settings={"depth": {"unfrozen": False}})
    along = Checkpoint(spec, {}, history=history, settings={"depth": {"unfrozen": True}})
    assert alone.untrained_component() == "segmentation"
    assert along.untrained_component() is None


def test_the_paper_s_stretched_target_trains_and_is_measured_on_its_own_scale(dataset, tmp_path):
    paper = ("--encoding", "minmax", "--loss", "mse", "--ema", "0", "--schedule", "constant")
    options = ("--architecture", "unet", "--optimizer", "adam", *paper)
    assert train(dataset, tmp_path, *options, component="depth", epochs=1) == 0
    assert 0.0 < float(rows(tmp_path, "epochs.csv")[0]["rmse"]) < 1.0


def test_the_paper_s_own_w_net_trains_as_a_whole_and_is_exported(dataset, tmp_path, capsys):
    """One channel, its sigmoid kept, crosses the joint; the loss of the second U-Net alone."""
    run, model = tmp_path / "run", tmp_path / "model.onnx"
    paper = ("--tasks", "depth,depth", "--sigmoid-joint", "depth1", "--encoding", "minmax")
    options = ("--architecture", "wnet", *paper, "--loss", "mse", "--unfrozen")
    assert train(dataset, run, *options, component="depth", epochs=1) == 0
    spec = Checkpoint.load(run / "best.pt").spec
    assert [(c.name, c.task, c.sigmoid_joint) for c in spec.components] == [
        ("depth1", "depth", True),
        ("depth", "depth", False),
    ]
    assert main(["export", "--checkpoint", str(run / "best.pt"), "--out", str(model)]) == 0
    values = read_metadata(model)
    assert values["nunet.trained"] == "true" and "nunet.classes" not in values
    onward = ("--start", str(run / "best.pt"), "--sigmoid-joint", "depth1")
    assert train(dataset, tmp_path / "on", *onward, component="depth") == 1
    assert "`--start` takes tasks and sigmoids from its checkpoint" in capsys.readouterr().err


def test_a_trained_component_is_plugged_into_another_graph(dataset, tmp_path, capsys):
    seg, depth = tmp_path / "seg", tmp_path / "depth"
    assert train(dataset, seg, "--architecture", "wnet", epochs=1) == 0
    plug = ("--architecture", "wnet_c", "--plug", f"segmentation={seg / 'best.pt'}")
    assert train(dataset, depth, *plug, component="depth", epochs=1) == 0
    theirs, ours = (Checkpoint.load(run / "best.pt") for run in (seg, depth))
    one, other = (c.component_weights("segmentation") for c in (theirs, ours))
    assert all(torch.equal(one[name], other[name]) for name in one)
    assert ours.history["segmentation"] == theirs.history["segmentation"]
    assert ours.provenance["segmentation"] == theirs.provenance["segmentation"]
    plugged = ours.provenance["depth"]["origin"]["plug"]["segmentation"]
    digest = hashlib.sha256((seg / "best.pt").read_bytes()).hexdigest()
    assert plugged == {"file": "best.pt", "sha256": digest}
    wrong = ("--architecture", "wnet_c", "--plug", f"depth={seg / 'best.pt'}")
    assert train(dataset, tmp_path / "wrong", *wrong, component="depth", epochs=1) == 1
    assert "do not fit component `depth`" in capsys.readouterr().err


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


def test_labels_train_an_earlier_component_beside_depth(dataset, tmp_path, capsys):
    plain, labeled, still = (tmp_path / name for name in ("plain", "labeled", "still"))
    depth = {"component": "depth", "epochs": 1}
    options = ("--unfrozen", "--no-bf16", "--ema", "0")
    assert train(dataset, plain, *options, **depth) == 0
    assert train(dataset, labeled, *options, "--label-loss", "0.5", **depth) == 0
    loss = [float(rows(run, "steps.csv")[0]["loss"]) for run in (plain, labeled)]
    # 13 classes, random weights: the cross-entropy is about ln 13 = 2.56, of which half counts.
    assert 0.5 < loss[1] - loss[0] < 2.5
    capsys.readouterr()
    assert train(dataset, still, "--label-loss", "0.5", **depth) == 2
    assert "hint: add `--unfrozen`" in capsys.readouterr().err
    unet = ("--architecture", "unet", *options)
    assert train(dataset, still, *unet, "--label-loss", "0.5", **depth) == 1
    assert "no component before `depth` segments" in capsys.readouterr().err


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


def test_a_network_of_another_camera_says_so_and_whose_images_they_are(dataset, tmp_path, capsys):
    run, onward, model = tmp_path / "run", tmp_path / "onward", tmp_path / "model.onnx"
    camera = ("--intrinsics", "600,601.5,320,240@640x480")
    assert train(dataset, run, "--architecture", "unet", *camera, component="depth", epochs=1) == 0
    export = ["export", "--checkpoint", str(run / "best.pt"), "--out", str(model)]
    assert main(export) == 1
    assert "hint: `--license TEXT` names the license of the images" in capsys.readouterr().err
    assert main([*export, "--license", "CC0, our own images"]) == 0
    values = read_metadata(model)
    known = {"width": 640, "height": 480, "fx": 600.0, "fy": 601.5}
    assert json.loads(values["nunet.camera"]) == known
    assert values["nunet.license"] == "CC0, our own images"
    best = str(run / "best.pt")
    for more, fx in (((), 600.0), (("--intrinsics", "300,300,160,120@320x240"), 300.0)):
        shutil.rmtree(onward, ignore_errors=True)
        assert train(dataset, onward, "--start", best, *more, component="depth", epochs=1) == 0
        assert Checkpoint.load(onward / "best.pt").spec.camera.fx == fx


def test_defaults_of_camera_and_license_are_printed(dataset, tmp_path, capsys):
    run, model = tmp_path / "run", tmp_path / "model.onnx"
    unet = ("--architecture", "unet")
    camera = "assumed NYU Depth V2's camera, fx 518.858 pixels at 640x480"
    assert train(dataset, run, *unet, component="depth", epochs=1) == 0
    assert capsys.readouterr().err.count(camera) == 1
    known = (
        (run, ("--resume", *unet)),
        (tmp_path / "on", ("--start", str(run / "best.pt"))),
        (tmp_path / "own", ("--intrinsics", "60,60,64,48@128x96", *unet)),
        (tmp_path / "paper", ("--encoding", "minmax", "--loss", "mse", *unet)),
    )
    for folder, options in known:
        assert train(dataset, folder, *options, component="depth", epochs=1) == 0
        assert "camera" not in capsys.readouterr().err
    export = ["export", "--checkpoint", str(run / "best.pt"), "--out", str(model)]
    assert main(export) == 0
    license = read_metadata(model)["nunet.license"]
    assert f"the license is `{license}`; hint: `--license TEXT`" in capsys.readouterr().err
    assert main([*export, "--license", "CC0"]) == 0
    assert "license" not in capsys.readouterr().err


@pytest.mark.parametrize(
    ("text", "code", "word"),
    [
        ("600,600,320,240", 2, "expected fx,fy,cx,cy@WxH in pixels; hint: NYU's are"),
        ("0,600,320,240@640x480", 2, "expected fx,fy,cx,cy@WxH in pixels"),
        ("600,600,320,180@640x360", 1, "of 640x360; the training images are 128x96; hint:"),
    ],
)
def test_intrinsics_that_cannot_be_are_refused(dataset, tmp_path, capsys, text, code, word):
    assert train(dataset, tmp_path, "--intrinsics", text, epochs=1) == code
    assert word in capsys.readouterr().err
    assert not (tmp_path / "last.pt").exists()


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
