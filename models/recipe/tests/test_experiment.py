"""The subcommand `experiment`: the networks of a plan are trained, measured and compared."""

from pathlib import Path

import pytest

from nunet_models.cli import main
from nunet_models.errors import DataError
from nunet_models.experiments.network import Network
from nunet_models.experiments.plan import read_plan
from nunet_models.export.onnx_file import read_metadata
from nunet_models.zoo.checkpoint import Checkpoint

LISTS = Path(__file__).parents[1] / "lists"
COMMON = """common = \"\"\"--component depth --backbone tiny --inner-size 96 128
    --decoder 8,8,8,6,4 --epochs 1 --batch 2\"\"\"
"""


def plan_file(tmp_path, text, common=COMMON):
    path = tmp_path / "plan.toml"
    path.write_text(common + text)
    return path


@pytest.fixture
def experiment(dataset, tmp_path):
    def run(text, *more):
        ids = [f"--{name}-ids={dataset / name}.txt" for name in ("train", "val")]
        data = ["--data", str(dataset), "--cache", str(tmp_path / "cache"), *ids]
        plan = plan_file(tmp_path, text)
        return main(
            ["experiment", "--plan", str(plan), "--out", str(tmp_path / "out"), *data, *more]
        )

    return run


def written(out):
    return {
        path.name: path.stat().st_mtime_ns
        for path in [*out.glob("*/*.pt"), *out.iterdir()]
        if path.is_file() and path.name != "report.md"
    }


CONTROLS = """
[pretrained]
seg = "--architecture wnet_c --component segmentation"
[networks]
unet = "--architecture unet"
random = "--architecture wnet_c"
frozen = "--architecture wnet_c --plug segmentation={seg}"
"""


def test_networks_are_trained_measured_and_compared_with_the_first(experiment, tmp_path, capsys):
    assert experiment(CONTROLS) == 0
    out, report = tmp_path / "out", capsys.readouterr().out
    assert report == (out / "report.md").read_text() + "\n"
    rows = [[cell.strip() for cell in line.split("|")[1:-1]] for line in report.splitlines()]
    in_meters = [row[0] for row in rows if len(row) > 10]
    assert in_meters[2:] == ["unet-0.onnx", "random-0.onnx", "frozen-0.onnx", "mean image"]
    compared = [tuple(row[:2]) for row in rows if len(row) == 7 and row[0] == "unet-0"]
    assert compared == [("unet-0", "random-0")] * 4 + [("unet-0", "frozen-0")] * 4

    trained = {n: read_metadata(out / f"{n}-0.onnx")["nunet.trained"] for n in ("random", "frozen")}
    assert trained == {"random": "false", "frozen": "true"}
    frozen, seg = (Checkpoint.load(out / name / "best.pt") for name in ("frozen-0", "seg"))
    mine, its = (of.component_weights("segmentation") for of in (frozen, seg))
    assert all(mine[name].equal(its[name]) for name in its)


def test_the_same_command_continues_where_it_was_interrupted(experiment, tmp_path, capsys):
    plan = 'seeds = [0, 1]\n[networks]\nmse = "--loss mse"\nberhu = "--loss berhu"\n'
    assert experiment(plan) == 0
    out, first = tmp_path / "out", capsys.readouterr().out
    assert "| mse-0, mse-1 | berhu-0, berhu-1 | rmse |" in first
    before = written(out)
    (out / "berhu-1.json").unlink()  # as if it was interrupted while it was measured
    assert experiment(plan) == 0
    assert capsys.readouterr().out == first
    changed = {name for name, time in written(out).items() if before[name] != time}
    assert changed == {"berhu-1.onnx", "berhu-1.csv", "berhu-1.json"}

    assert experiment(plan.replace("--loss mse", "--loss mse --lr 1e-4")) == 1
    assert "was started with `--lr 0.001`, given `--lr 0.0001`" in capsys.readouterr().err


SERIES = "--architecture nunet3_c --tasks segmentation,objectness,depth"
IN_SERIES = f"""
[pretrained]
seg = "--architecture wnet_c --component segmentation"
middle = "{SERIES} --component objectness2 --plug segmentation={{seg}}"
[networks]
wnet_c = "--architecture wnet_c --plug segmentation={{seg}}"
boxes = "{SERIES} --plug segmentation={{seg}} --plug objectness2={{middle}}"
"""


def test_a_pretrained_network_starts_from_one_above_it(experiment, tmp_path, capsys):
    assert experiment(IN_SERIES) == 0
    assert "| boxes-0.onnx |" in capsys.readouterr().out
    out = tmp_path / "out"
    seg, middle, boxes = (
        Checkpoint.load(out / n / "best.pt") for n in ("seg", "middle", "boxes-0")
    )
    for name, of in (("segmentation", seg), ("objectness2", middle)):
        mine, its = (found.component_weights(name) for found in (boxes, of))
        assert all(mine[key].equal(its[key]) for key in its), name
    assert read_metadata(out / "boxes-0.onnx")["nunet.trained"] == "true"


def test_a_network_that_fails_does_not_stop_the_others(experiment, tmp_path, capsys):
    camera = "--intrinsics 600,600,320,180@640x360"  # of another shape than the decoded images
    plan = f'[networks]\na = "{camera}"\nb = "--architecture unet"\n'
    assert experiment(plan, "--license", "CC0") == 1
    printed = capsys.readouterr()
    assert "nunet_models: a-0: `--intrinsics` is of images of 640x360" in printed.err
    assert "| b-0.onnx |" in printed.out and "Differences" not in printed.out


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ("--loss best", "`b-0`: no loss `best`"),
        ("--loos mse", "`b-0`: unrecognized arguments: --loos mse"),
        ("--lr -1", "`b-0`: `--lr -1.0`; expected more than 0"),
    ],
)
def test_options_are_checked_before_the_first_network_is_trained(
    options, message, experiment, tmp_path, capsys
):
    assert experiment(f'[networks]\na = ""\nb = "{options}"\n') == 2
    assert message in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


SEG = "--architecture wnet_c --component segmentation"
AUTO = "--architecture autoencoder"
FROM_AUTO = "--architecture wnet_c_auto --plug-decoder {auto}"


@pytest.mark.parametrize(
    ("options", "status", "message"),
    [
        ("--decoder best", 2, "`b-0`: `--decoder best`; expected lite or paper"),
        ("--tasks depth,normals,depth", 1, "`b-0`: tasks `depth,normals,depth` do not fit"),
        ("--architecture wnet_d", 1, "`b-0`: no architecture `wnet_d`"),
        ("--backbone resnet19", 1, "`b-0`: no backbone `resnet19`"),
        ("--component normals2", 1, "`b-0`: components are segmentation, depth"),
        ("--imagenet", 1, "`b-0`: no ImageNet weights for backbone `tiny`"),
        ("--plug segmentation=absent.pt", 1, "`b-0`: no checkpoint `absent.pt`"),
        ("--plug depth={seg} --architecture unet", 1, "`b-0`: the weights do not fit component"),
        ("--plug coarse1={seg}", 1, "`b-0`: no component `coarse1` in `wnet_c`"),
        ("--start {seg} --inner-size 48 64", 1, "given `--inner-size 48 64`"),
        (f"{FROM_AUTO} --decoder 8,8,8,8,8", 1, "has a decoder `8,8,8,6,4` of 64 latent channels"),
        (
            "--architecture unet --unfrozen --label-loss 1",
            1,
            "no component before `depth` segments",
        ),
        ("--patch 0.5", 2, "`b-0`: `--patch 0.5` is for `--sets`"),
        ("--batch 5", 1, "`--batch 5` of them"),
        ("--frames 2", 2, "`b-0`: `--frames 2`: `--component depth` of `wnet_c` has no state"),
        (AUTO, 1, "`b-0`: `autoencoder` reads depth, and a model file reads an image"),
        ("--intrinsics 60,60,64,48@128x96", 1, "hint: `--license TEXT` names the license"),
    ],
)
def test_graphs_of_a_plan_are_checked_before_the_first_network_is_trained(
    options, status, message, experiment, tmp_path, capsys
):
    pretrained = f'[pretrained]\nseg = "{SEG}"\nauto = "{AUTO}"\n'
    assert experiment(f'{pretrained}[networks]\na = ""\nb = "{options}"\n') == status
    assert message in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", r"expected a table `\[networks\]`"),
        ("[networks]", r"expected a table `\[networks\]`"),
        ("networks = 3", r"expected a table `\[networks\]`"),
        ('[networks]\na = ["--loss", "mse"]', "expected options of `train` as text"),
        ('[networks]\na = "--loss \'mse"', "No closing quotation"),
        ('[networks]\n"a,b" = ""', "`a,b` in `\\[networks\\]`; expected letters"),
        ('seeds = []\n[networks]\na = ""', r"`seeds` is \[\]"),
        ('seeds = [1, 1]\n[networks]\na = ""', r"`seeds` is \[1, 1\]"),
        ('seeds = [true]\n[networks]\na = ""', r"`seeds` is \[True\]"),
        ('seed = 1\n[networks]\na = ""', "unknown key `seed`; expected one of common, networks"),
        ('[networks]\na = "--plug {seg}"', "`a` uses `{seg}`, which is not pretrained"),
        ('[pretrained]\na = "{b}"\nb = ""\n[networks]\nc = ""', "`a` uses `{b}`, which is not"),
        ('[pretrained]\na = "{a}"\n[networks]\nc = ""', "`a` uses `{a}`, which is not pretrained"),
        ('[pretrained]\na = "{z}"\n[networks]\nc = ""', "`a` uses `{z}`, which is not pretrained"),
        ('[pretrained]\na = ""\n[networks]\na = ""', "`a` is in `\\[pretrained\\]` and in"),
        ("[networks", "is not a TOML file"),
    ],
)
def test_a_plan_that_cannot_be_is_an_error_with_its_file(text, message, tmp_path):
    with pytest.raises(DataError, match=message) as raised:
        read_plan(plan_file(tmp_path, text))
    assert "plan.toml" in str(raised.value)


def test_a_checkpoint_in_the_options_of_every_network_is_refused(tmp_path):
    text = '[pretrained]\nseg = ""\n[networks]\na = "--architecture wnet_c"\n'
    common = 'common = "--component depth --plug segmentation={seg}"\n'
    with pytest.raises(DataError, match=r"`common` uses `{seg}`, but `common` is") as found:
        read_plan(plan_file(tmp_path, text, common))
    assert found.value.hint == "write `{seg}` into the options of the networks that start from it"


@pytest.mark.parametrize("name", ["autoencoder", "losses", "nunets", "recurrent", "size"])
def test_the_options_of_a_shipped_plan_are_those_of_train(name, tmp_path):
    plan = read_plan(LISTS / f"{name}.toml")
    for network, options in {**plan.pretrained, **plan.networks}.items():
        Network(tmp_path, network, (*plan.common, *options)).check()
