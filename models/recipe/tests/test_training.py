"""Training of tiny networks: it learns, and refuses what no training can use."""

import shutil

import numpy as np
import pytest
import torch
from PIL import Image
from runs import rows, train

from nunet_models.classes import IGNORE
from nunet_models.data.cache import Cached
from nunet_models.errors import ConfigError
from nunet_models.export.collections import tiny_spec
from nunet_models.training.ema import Averaged
from nunet_models.training.schedule import learning_rate_factor
from nunet_models.training.trainer import Trainer
from nunet_models.training.validate import validate
from nunet_models.zoo import SerialGraph
from nunet_models.zoo.backbones import build_unet, check_drop_path
from nunet_models.zoo.checkpoint import Checkpoint
from nunet_models.zoo.spec import LITE_DECODER

pytestmark = pytest.mark.usefixtures("every_step_logged")


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
