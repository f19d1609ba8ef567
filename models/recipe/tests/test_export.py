"""Model files: the self-test image to the byte, and files that compute the network."""

import hashlib
import json
import shutil
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from nunet_models.cli import main
from nunet_models.errors import ExportError
from nunet_models.export import measure
from nunet_models.export.collections import TINY_ARCHITECTURES, TINY_SEED, tiny_spec
from nunet_models.export.model_file import Provenance, export_fused, export_staged
from nunet_models.export.onnx_file import read_metadata, run, session
from nunet_models.export.selftest import grid_from_outputs, selftest_image
from nunet_models.export.split import split
from nunet_models.export.untrained import untrained_graph
from nunet_models.zoo.deploy import FusedModel

KEYS = {
    *("nunet.version", "nunet.architecture", "nunet.components", "nunet.depth.encoding"),
    *("nunet.depth.min_m", "nunet.depth.max_m", "nunet.classes", "nunet.camera"),
    *("nunet.inner_size", "nunet.trained", "nunet.training", "nunet.accuracy"),
    *("nunet.license", "nunet.targets", "nunet.selftest"),
}


def test_the_selftest_image_is_the_documented_one():
    image = selftest_image(640, 480)
    first = [150, 130, 100, 150, 130, 100, 150, 130, 100, 157, 137, 107, 157, 137, 107, 164]
    assert image.reshape(-1)[:16].tolist() == first
    digest = "f13ba5a29ec76e875ed3a4cebc8c294e8be9e184d3485a166b7446ac8cd72536"
    assert hashlib.sha256(image.tobytes()).hexdigest() == digest


def test_a_grid_is_lower_medians_and_lowest_majorities():
    depth = np.full((1, 1, 12, 16), np.nan, np.float32)
    depth[0, 0, :2, :2] = [[4, 1], [3, 2]]
    labels = np.zeros((1, 12, 16), np.uint8)
    labels[0, :2, :2] = [[7, 7], [5, 5]]
    answer = grid_from_outputs(depth, labels)
    assert answer.depth[0, 0] == 2.0
    assert np.isnan(answer.depth[0, 1])
    assert answer.labels[0, 0] == 5
    assert answer.to_json(precision="fp32", tolerance={})["depth"][0][1] is None


@pytest.fixture(scope="module")
def wnet_c(tmp_path_factory):
    folder = tmp_path_factory.mktemp("wnet_c")
    graph = untrained_graph(tiny_spec("wnet_c"), seed=3)
    export_fused(graph, folder / "fused.onnx", Provenance())
    export_staged(graph, folder / "staged.toml", Provenance(trained=True))
    return graph, folder


def test_a_fused_file_has_the_contract_s_tensors(wnet_c):
    opened = session(wnet_c[1] / "fused.onnx")
    tensors = [(t.name, t.type, t.shape) for t in (*opened.get_inputs(), *opened.get_outputs())]
    assert tensors == [
        ("rgb", "tensor(uint8)", [1, 96, 128, 3]),
        ("depth", "tensor(float)", [1, 1, 96, 128]),
        ("labels", "tensor(uint8)", [1, 96, 128]),
    ]


def test_a_fused_file_has_the_whole_metadata(wnet_c):
    values = read_metadata(wnet_c[1] / "fused.onnx")
    assert set(values) == KEYS
    assert (values["nunet.version"], values["nunet.trained"]) == ("1", "false")
    components = json.loads(values["nunet.components"])
    assert [c["connected"] for c in components] == [False, True]
    trained = [sum(p.numel() for p in c.parameters()) for c in wnet_c[0].components]
    assert [c["parameters"] for c in components] == trained
    assert all(c["gflop"] > 0 for c in components)


def test_a_fused_file_passes_its_own_selftest(wnet_c):
    graph, folder = wnet_c
    selftest = json.loads(read_metadata(folder / "fused.onnx")["nunet.selftest"])
    answer = measure.selftest_grid(
        run(folder / "fused.onnx", {"rgb": measure.image_of(graph.spec)}), graph.spec
    )
    assert np.abs(np.array(selftest["depth"]) - answer.depth).max() <= 1e-5
    assert selftest["labels"] == answer.labels.tolist()
    assert selftest["tolerance"]["fp32"]["depth"] < selftest["tolerance"]["bf16"]["depth"]


@pytest.mark.parametrize("change", ["mirrored", "bgr", "upside down"])
def test_the_selftest_catches_a_changed_image(wnet_c, change):
    graph, folder = wnet_c
    rgb = measure.image_of(graph.spec)
    changed = {"mirrored": rgb[:, :, ::-1], "bgr": rgb[..., ::-1], "upside down": rgb[:, ::-1]}
    selftest = json.loads(read_metadata(folder / "fused.onnx")["nunet.selftest"])
    outputs = run(folder / "fused.onnx", {"rgb": np.ascontiguousarray(changed[change])})
    gap = np.abs(
        np.array(selftest["depth"]) - measure.selftest_grid(outputs, graph.spec).depth
    ).max()
    assert gap > selftest["tolerance"]["fp32"]["depth"]


def test_stages_wired_by_the_toml_give_the_fused_outputs(wnet_c):
    graph, folder = wnet_c
    rgb = measure.image_of(graph.spec)
    staged = tomllib.loads((folder / "staged.toml").read_text())
    results = {"image": rgb}
    for stage in staged["stage"]:
        inputs = {name: results[source] for name, source in stage["inputs"].items()}
        for name, value in run(folder / stage["model"], inputs).items():
            results[f"{stage['name']}.{name}"] = value
    fused = run(folder / "fused.onnx", {"rgb": rgb})
    assert np.array_equal(results[staged["outputs"]["labels"]], fused["labels"])
    assert np.abs(results[staged["outputs"]["depth"]] - fused["depth"]).max() <= 1e-5


def test_the_depth_stage_carries_the_whole_graph_s_metadata(wnet_c):
    values = read_metadata(wnet_c[1] / "staged.depth.onnx")
    assert set(values) == KEYS
    assert values["nunet.trained"] == "true"
    assert len(json.loads(values["nunet.components"])) == 2


def test_a_smaller_inner_size_gives_outputs_of_the_input_s_size(tmp_path):
    spec = tiny_spec("wnet_c").with_sizes(input_size=(192, 256), inner_size=(96, 128))
    export_fused(untrained_graph(spec, seed=3), tmp_path / "m.onnx", Provenance())
    outputs = run(tmp_path / "m.onnx", {"rgb": measure.image_of(spec)})
    assert outputs["depth"].shape == (1, 1, 192, 256)
    labels = outputs["labels"][0]
    assert np.array_equal(labels[::2, ::2], labels[1::2, 1::2])
    assert outputs["depth"].std() > 0.1


def test_a_file_that_computes_something_else_is_refused(wnet_c):
    other = FusedModel(untrained_graph(tiny_spec("wnet_c"), seed=4))
    with pytest.raises(ExportError, match="differs from the network"):
        measure.check_against_torch(
            other, wnet_c[1] / "fused.onnx", measure.image_of(other.network.spec)
        )


def test_export_wants_an_ending_that_says_what_to_write(tmp_path, capsys):
    assert main(["export", "--untrained", "unet", "--out", str(tmp_path / "model.pt")]) == 1
    assert "`.onnx` or `.toml`" in capsys.readouterr().err


TINY = Path(__file__).parents[2] / "tiny"


@pytest.mark.parametrize("architecture", TINY_ARCHITECTURES)
def test_a_test_model_in_git_is_what_the_recipe_makes(architecture):
    model = FusedModel(untrained_graph(tiny_spec(architecture), seed=TINY_SEED).eval())
    path = TINY / f"tiny_{architecture}.onnx"
    rgb = measure.image_of(model.network.spec)
    measure.check_against_torch(model, path, rgb, bound=measure.UNTRAINED_BOUND)
    assert read_metadata(path)["nunet.architecture"] == architecture


def test_a_model_file_takes_and_returns_its_state():
    path = TINY / "tiny_wnet_c_lstm.onnx"
    (hidden, cell) = json.loads(read_metadata(path)["nunet.state"])
    zeros = {s["input"]: np.zeros(s["shape"], np.float32) for s in (hidden, cell)}
    rgb = selftest_image(128, 96)[None]
    outputs = run(path, {"rgb": rgb, **zeros})
    assert outputs[cell["output"]].shape == tuple(cell["shape"])
    assert np.abs(outputs[hidden["output"]]).max() > 0
    left = {s["input"]: outputs[s["output"]] for s in (hidden, cell)}
    again = run(path, {"rgb": rgb, **left})
    difference = np.abs(again["depth"] - outputs["depth"]).max()
    assert difference > 0.01, "a state without an effect on the output tests nothing"


def test_a_recurrent_graph_cannot_be_staged(tmp_path):
    graph = untrained_graph(tiny_spec("wnet_c_lstm"), seed=1)
    with pytest.raises(ExportError, match="cannot be staged"):
        export_staged(graph, tmp_path / "staged.toml", Provenance())


def test_a_file_without_labels_is_not_split(tmp_path):
    components = [c.changed(task="depth") for c in tiny_spec("wnet_c").components]
    spec = replace(tiny_spec("wnet_c"), components=tuple(components))
    export_fused(untrained_graph(spec, seed=1), tmp_path / "deep.onnx", Provenance())
    with pytest.raises(ExportError, match="has no labels"):
        split(tmp_path / "deep.onnx", tmp_path / "parts.toml")
    assert not (tmp_path / "parts.toml").exists()


def test_figures_of_nunetd_are_written_into_the_file_that_they_are_of(tmp_path, capsys):
    model, found = tmp_path / "model.onnx", tmp_path / "eval.json"
    shutil.copy(TINY / "tiny_unet.onnx", model)
    digest = hashlib.sha256(model.read_bytes()).hexdigest()
    note = ["annotate", "--model", str(model), "--accuracy", str(found)]

    def measured(name, digest, rmse=0.5):
        answer = {"model": {"name": name, "hash": digest}, "metrics": {"rmse": rmse}}
        found.write_text(json.dumps(answer))

    measured("model.onnx", "ab" * 32)
    before = model.read_bytes()
    assert main(note) == 1
    stderr = capsys.readouterr().err
    assert (
        "is of the model `model.onnx` with the SHA-256 `abab" in stderr and f"`{digest}`" in stderr
    )
    assert model.read_bytes() == before
    measured("before-it-was-renamed.onnx", digest)
    for _ in range(2):  # what is there already may be written again
        assert main(note) == 0
    accuracy = json.loads(read_metadata(model)["nunet.accuracy"])
    assert accuracy == {"model": "before-it-was-renamed.onnx", "metrics": {"rmse": 0.5}}
    measured("model.onnx", digest, rmse=0.6)
    assert main(note) == 1, "the file is another one since something was written into it"
    found.write_text('{"model": 3}')
    assert main(note) == 1
    assert "`model` is neither a name nor an object" in capsys.readouterr().err


def test_a_failed_export_leaves_the_file_that_was_there(tmp_path, monkeypatch):
    path = tmp_path / "model.onnx"
    path.write_text("the old one")
    monkeypatch.setattr("nunet_models.export.model_file.UNTRAINED_BOUND", -1.0)
    with pytest.raises(ExportError, match="more than -1"):
        export_fused(untrained_graph(tiny_spec("unet"), seed=1), path, Provenance())
    assert [p.name for p in tmp_path.iterdir()] == ["model.onnx"]
    assert path.read_text() == "the old one"
