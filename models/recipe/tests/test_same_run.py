"""A run is resumed as what it is: other data, weights or graphs are refused by their options."""

import pytest
import torch
from conftest import write_dataset
from runs import train

from nunet_models.training.same_run import provenance_differences
from nunet_models.zoo.checkpoint import Checkpoint

STOP = ("--minutes", "1e-9")
UNET = ("--architecture", "unet")


@pytest.mark.parametrize(
    ("given", "word"),
    [
        (("--depth-scale", "0.002"), "`--depth-scale 0.001`, given `--depth-scale 0.002`; hint: "),
        (("--depth-offset", "1"), "`--depth-offset 0.0`, given `--depth-offset 1.0`; hint: "),
        (("--window", "2,2,90,90"), "no `--window`, given `--window 2,2,90,90`; hint: "),
    ],
)
def test_a_run_is_not_resumed_on_other_units_of_depth(dataset, tmp_path, capsys, given, word):
    assert train(dataset, tmp_path, *STOP, *UNET, component="depth") == 0
    assert train(dataset, tmp_path, "--resume", *given, *UNET, component="depth") == 1
    assert f"was started with {word}" in capsys.readouterr().err


def test_data_may_move_but_not_be_another_folder_s(dataset, tmp_path, capsys):
    run, moved = tmp_path / "run", tmp_path / "elsewhere" / dataset.name
    assert train(dataset, run, *STOP, *UNET, component="depth") == 0
    moved.parent.mkdir()
    dataset.rename(moved)
    assert train(moved, run, *STOP, "--resume", *UNET, component="depth") == 0
    other = moved.rename(tmp_path / "others")
    assert train(other, run, "--resume", *UNET, component="depth") == 1
    assert "with `--data rooms`, given `--data others`; hint: " in capsys.readouterr().err


def test_a_run_is_not_resumed_from_other_weights(dataset, tmp_path, capsys):
    first, second, run = (tmp_path / name for name in ("first", "second", "run"))
    for folder, seed in ((first, "0"), (second, "1")):
        assert train(dataset, folder, "--seed", seed, epochs=1) == 0
    start = ("--start", str(first / "best.pt"), "--like", "segmentation")
    assert train(dataset, run, *STOP, *start, component="depth") == 0
    again = ("--resume", "--start", str(second / "best.pt"))
    assert train(dataset, run, *again, component="depth") == 1
    stderr = capsys.readouterr().err
    assert "was started with `--start best.pt` (SHA-256 " in stderr
    assert "; `--like segmentation`, given no `--like`; hint: " in stderr
    (first / "best.pt").rename(first / "other-name.pt")
    start = ("--start", str(first / "other-name.pt"), "--like", "segmentation")
    assert train(dataset, run, "--resume", *start, component="depth") == 0


def test_every_origin_is_reported_by_its_option():
    file = {"file": "a.pt", "sha256": "ab" * 32}
    started = {"origin": {"plug": {"segmentation": file}, "imagenet": True, "begin_with": file}}
    assert provenance_differences(started, started) == []
    assert provenance_differences(
        started, {"origin": {"like": {"component": "depth1", **file}}}
    ) == [
        "`--begin-with a.pt` (SHA-256 abababababab...), given no `--begin-with`",
        "`--imagenet`, given no `--imagenet`",
        "`--plug segmentation=a.pt` (SHA-256 abababababab...), given no `--plug segmentation`",
        "no `--like`, given `--like depth1=a.pt` (SHA-256 abababababab...)",
    ]


def test_a_run_whose_provenance_is_of_an_earlier_version_is_resumed(dataset, tmp_path):
    options = ("--window", "2,2,90,90", *UNET)
    assert train(dataset, tmp_path, *STOP, *options, component="depth") == 0
    values = torch.load(tmp_path / "last.pt", weights_only=True)
    del values["provenance"]["depth"]["data"]["window"], values["provenance"]["depth"]["origin"]
    torch.save(values, tmp_path / "last.pt")
    assert train(dataset, tmp_path, "--resume", *UNET, component="depth", epochs=2) == 0
    assert "origin" not in Checkpoint.load(tmp_path / "last.pt").provenance["depth"]


@pytest.mark.parametrize(
    ("given", "word"),
    [
        (("--inner-size", "48", "64"), "`--inner-size 96 128`, given `--inner-size 48 64`; hint"),
        (
            ("--intrinsics", "60,60,64,48@128x96"),
            "`--intrinsics 518.858,519.47,cx,cy@640x480`, given `--intrinsics 60,60,cx,cy@128x96`;",
        ),
        (("--decoder", "paper"), "`--decoder lite`, given `--decoder paper`; hint: "),
        (("--decoder", "8,8,8,6,4"), "`--decoder lite`, given `--decoder 8,8,8,6,4`; hint: "),
        (("--dropout", "0.5"), "`--dropout 0.0`, given `--dropout 0.5`; hint: "),
        (
            ("--encoding", "minmax", "--lr", "0.5"),
            "`--encoding metric`, given `--encoding minmax`; `--lr 0.001`, given `--lr 0.5`; hint",
        ),
    ],
)
def test_an_option_that_makes_another_graph_is_named(dataset, tmp_path, capsys, given, word):
    assert train(dataset, tmp_path, *STOP, *UNET, component="depth") == 0
    assert train(dataset, tmp_path, "--resume", *UNET, *given, component="depth") == 1
    assert f"was started with {word}" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("given", "word"),
    [
        (
            ("--architecture", "wnet_c"),
            "`--architecture wnet`, given `--architecture wnet_c`; hint",
        ),
        (
            ("--backbone", "resnet18"),
            "`--backbone tiny,tiny`, given `--backbone resnet18,resnet18`;",
        ),
        (("--backbone", "tiny,tiny,tiny"), "tiny,tiny`, given `--backbone tiny,tiny,tiny`; hint"),
        (("--decoder", "paper"), "`--decoder lite`, given `--decoder paper`; hint: "),
        (("--inner-size", "48", "64"), "`--inner-size 96 128`, given `--inner-size 48 64`; hint: "),
        (("--encoding", "minmax"), "`--encoding metric`, given `--encoding minmax`; hint: "),
    ],
)
def test_an_option_that_asks_for_another_graph_than_start_s_is_refused(
    started, tmp_path, capsys, given, word
):
    dataset, best = started
    assert train(dataset, tmp_path, "--start", str(best), *given, component="depth") == 1
    stderr = capsys.readouterr().err
    assert f"`--start {best}` is a graph of " in stderr and word in stderr
    assert "leave such options out with `--start`" in stderr
    assert not (tmp_path / "last.pt").exists()


def test_options_that_ask_for_the_graph_that_start_has_are_taken(started, tmp_path):
    dataset, best = started
    for number, decoder in enumerate(("lite", "128,64,48,32,16")):
        same = ("--architecture", "wnet", "--decoder", decoder, "--encoding", "metric")
        run = tmp_path / str(number)
        assert train(dataset, run, "--start", str(best), *same, *STOP, component="depth") == 0


@pytest.fixture(scope="module")
def started(tmp_path_factory):
    folder = tmp_path_factory.mktemp("started")
    write_dataset(folder / "rooms")
    assert train(folder / "rooms", folder / "run", "--architecture", "wnet", epochs=1) == 0
    return folder / "rooms", folder / "run" / "best.pt"
