"""The package around the pipeline: command, stubs, documentation and examples."""

import ast
import inspect
import json
import os
import pathlib
import re
import runpy
import signal
import subprocess
import sys
import types

import numpy as np
import nunet_py as nunet
import pytest
from PIL import Image
from support import ROOM, ROOT, TINY

COMMAND = pathlib.Path(sys.executable).with_name("nunetd")
EXAMPLES = ROOT / "examples" / "python"


def test_the_command_is_nunetd():
    for command in ([COMMAND], [sys.executable, "-m", "nunet_py"]):
        done = subprocess.run([*command, "--version"], check=True, capture_output=True, text=True)
        lines = done.stdout.splitlines()
        assert lines[0].startswith(f"nunetd {nunet.__version__} (") and lines[1] == "contract 1"
        assert re.fullmatch(r"ONNX Runtime \d+\.\d+\.\d+ at /.*libonnxruntime\.so.* \(.+\)", lines[2]), lines
        bad = subprocess.run([*command, "--no-such-flag"], check=False, capture_output=True, text=True)
        assert bad.returncode == 2 and "--no-such-flag" in bad.stderr
        missing = subprocess.run(
            [*command, "inspect", "missing.onnx"], check=False, capture_output=True, text=True
        )
        assert missing.returncode == 2 and "missing.onnx" in missing.stderr


def started(tmp_path, *more):
    """A daemon through the console script, once it has published, and its statistics file."""
    stats, name = tmp_path / "stats.json", f"pytest-package-{os.getpid()}-{len(list(tmp_path.iterdir()))}"
    command = [
        COMMAND,
        "--model",
        TINY,
        "--source",
        "demo",
        "--camera",
        name,
        "--rate",
        "20",
        "--stats-json",
        stats,
    ]
    process = subprocess.Popen([*command, *more], stderr=subprocess.PIPE, text=True)
    watch = subprocess.run(
        [COMMAND, "watch", name, "--frames", "2", "--timeout", "60"], check=False, timeout=90
    )
    assert watch.returncode == 0
    return process, stats


def test_ctrl_c_finishes_the_current_frame_and_exits_with_0_like_the_binary(tmp_path):
    process, stats = started(tmp_path)
    process.send_signal(signal.SIGINT)
    _, stderr = process.communicate(timeout=60)
    assert process.returncode == 0, stderr
    assert stats.exists() and "KeyboardInterrupt" not in stderr and "Traceback" not in stderr


def test_a_new_model_is_checked_by_the_package_s_own_command(tmp_path):
    """In a folder with files that have the names of modules, and without any cache."""
    for name in ("json", "signal", "numpy", "nunet_py"):
        (tmp_path / f"{name}.py").write_text("raise SystemExit('the working directory is not searched')")
    script = tmp_path / "elsewhere" / "script.py"
    script.parent.mkdir()
    script.write_text(f"import nunet_py; print(nunet_py.Model({str(TINY)!r}).size)")
    environment = os.environ | {"XDG_CACHE_HOME": str(tmp_path / "cache")}
    done = subprocess.run(
        [sys.executable, script], check=False, capture_output=True, text=True, cwd=tmp_path, env=environment
    )
    assert (done.returncode, done.stdout) == (0, "(128, 96)\n"), done.stderr
    assert len(list((tmp_path / "cache/nunet/verdicts").iterdir())) == 1, "it was tested, in a child process"


def test_the_first_python_block_of_the_readme_runs_as_pasted(tmp_path, monkeypatch):
    _, _, rest = (ROOT / "README.md").read_text().partition("```python\n")
    lines, fence, _ = rest.partition("```\n")
    assert fence and "nunet.Model(" in lines
    Image.open(ROOM).convert("RGB").save(tmp_path / "photo.jpg")
    monkeypatch.chdir(tmp_path)
    names = {}
    exec(compile(lines, "README.md", "exec"), names)
    assert names["result"].depth.shape == (480, 640) and names["result"].scale_source == "focal_scaled"


def test_the_readme_of_the_package_is_complete_as_pasted(tmp_path):
    _, _, rest = (ROOT / "crates/nunet-py/README.md").read_text().partition("```python\n")
    code, fence, _ = rest.partition("```\n")
    assert fence
    command = [sys.executable, "-W", "error", "-c", code]
    done = subprocess.run(command, check=False, capture_output=True, text=True, cwd=tmp_path, timeout=120)
    assert done.returncode == 0, done.stderr
    assert "(480, 640) float32" in done.stdout and "focal_scaled" in done.stdout
    assert (tmp_path / "room" / "cloud.ply").exists()


def test_the_reference_page_is_current(tmp_path):
    page = ROOT / "docs" / "book" / "python-api.md"
    command = [sys.executable, ROOT / "crates" / "nunet-py" / "tools" / "api_page.py", tmp_path / "page.md"]
    subprocess.run(command, check=True, timeout=60)
    assert page.read_text() == (tmp_path / "page.md").read_text(), (
        "run `cargo xtask package`, then crates/nunet-py/tools/api_page.py "
        "with the interpreter that it prints"
    )


def test_the_reference_page_has_everything_public():
    page = (ROOT / "docs" / "book" / "python-api.md").read_text()
    for name, _ in public():
        member = name.rpartition(".")[2]
        assert f"### {name}\n" in page or f"`{member}`" in page, name


def test_importing_the_package_imports_nothing_large():
    code = "import sys, nunet_py; print(sorted({'numpy', 'onnxruntime', 'matplotlib'} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    assert done.stdout == "[]\n"


def test_telemetry_is_off_after_the_import_unless_the_user_allows_it():
    code = "import os, nunet_py; print(os.environ['ORT_DISABLE_TELEMETRY'])"
    for given, expected in [("", "1"), ("yes", "1"), ("1", "1"), ("0", "0")]:
        environment = os.environ | {"ORT_DISABLE_TELEMETRY": given}
        done = subprocess.run(
            [sys.executable, "-c", code], check=True, capture_output=True, text=True, env=environment
        )
        assert done.stdout == f"{expected}\n", given


def checked(*command):
    environment = os.environ | {"MYPYPATH": ""}
    done = subprocess.run(
        [sys.executable, *command], check=False, capture_output=True, text=True, env=environment, cwd=EXAMPLES
    )
    assert done.returncode == 0, done.stdout + done.stderr


def test_the_stubs_match_the_package():
    checked("-m", "mypy.stubtest", "nunet_py._native", "--ignore-disjoint-bases")


def test_the_package_and_its_examples_are_strictly_typed():
    package = pathlib.Path(nunet.__file__).parent
    checked("-m", "mypy", "--strict", "--cache-dir", os.devnull, *EXAMPLES.glob("*.py"))
    checked("-m", "mypy", "--strict", "--cache-dir", os.devnull, "-p", "nunet_py")
    assert (package / "py.typed").exists()


def public():
    """Every public class, function, method and property."""
    for name in nunet.__all__:
        thing = getattr(nunet, name)
        if name != "__version__":
            yield name, thing
        if inspect.isclass(thing) and not issubclass(thing, Exception):
            members = vars(thing).items()
            yield from (
                (f"{name}.{member}", value) for member, value in members if not member.startswith("_")
            )


def test_everything_public_is_documented_with_its_arguments():
    # The text of a class describes its plain attributes.
    classes = (nunet.Result, nunet.Cloud, nunet.Obstacles, nunet.replay)
    attributes = "".join(map(inspect.getdoc, classes))
    for name, thing in public():
        assert inspect.getdoc(thing) or name.rpartition(".")[2] in attributes, name
        if callable(thing) and not inspect.isclass(thing):
            parameters = [word for word in inspect.signature(thing).parameters if word not in ("self", "cls")]
            text = inspect.getdoc(thing)
            assert all(
                f"{word} " in text or f"`{word}`" in text or f"{word}," in text for word in parameters
            ), name
    help_of_infer = inspect.getdoc(nunet.Model.infer)
    for words in (
        "uint8 (H, W, 3)",
        "float32 (H, W)",
        "meters",
        "NaN",
        "TypeError",
        "ValueError",
        "CameraError",
    ):
        assert words in help_of_infer


@pytest.mark.parametrize("path", sorted(EXAMPLES.glob("*.py")), ids=lambda path: path.name)
def test_an_example_fits_on_a_screen(path):
    assert len(path.read_text().splitlines()) < 60
    assert ast.get_docstring(ast.parse(path.read_text()))


@pytest.mark.parametrize("path", sorted(EXAMPLES.glob("*.py")), ids=lambda path: path.name)
def test_an_example_without_arguments_prints_its_usage(path, tmp_path):
    (tmp_path / "cv2.py").write_text("")
    environment = os.environ | {"PYTHONPATH": str(tmp_path)}
    command = [sys.executable, path]
    done = subprocess.run(command, check=False, capture_output=True, text=True, timeout=120, env=environment)
    assert done.returncode == 2 and done.stderr.startswith(f"usage: {path.name} "), done.stderr


def run_example(name, *arguments):
    command = [sys.executable, EXAMPLES / name, *map(str, arguments)]
    done = subprocess.run(command, check=False, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_the_example_numpy_depth_writes_depth_and_an_image(tmp_path):
    printed = run_example("numpy_depth.py", ROOT / "models/clip/rgb/bedroom_00.jpg", tmp_path)
    assert "metre" in printed and (tmp_path / "depth.npy").exists() and (tmp_path / "depth.png").exists()


def test_the_example_nearest_obstacle_prints_distance_and_class():
    printed = run_example("nearest_obstacle.py", ROOT / "models/clip/rgb/bedroom_00.jpg")
    assert " m ahead" in printed


def test_the_example_nearest_obstacle_does_not_call_unseen_space_free():
    describe = runpy.run_path(str(EXAMPLES / "nearest_obstacle.py"))["describe"]
    camera = nunet.Camera(fx=50, fy=50, cx=31.5, cy=23.5, size=(64, 48))
    row, column = np.indices((48, 64))
    ray = np.stack([(column - 31.5) / 50, (row - 23.5) / 50, np.ones((48, 64))], -1).astype(np.float32)

    def answer(depth, label):
        cloud = types.SimpleNamespace(
            points=ray * depth[..., None], labels=np.full((48, 64), label, np.uint8)
        )
        return describe(cloud, ("floor", "wall"), camera)

    floor, wall = 0, 1
    wall_at_2_m = np.full((48, 64), 2, np.float32)
    assert answer(wall_at_2_m, wall) == "wall, 2.00 m ahead"
    assert answer(wall_at_2_m, floor) == "nothing in the way"
    assert answer(wall_at_2_m * np.nan, wall).startswith("unknown: ")
    assert answer(wall_at_2_m * np.nan, floor).startswith("unknown: ")
    half = wall_at_2_m.copy()
    half[:, 32:] = np.nan
    assert answer(half, wall).startswith("unknown: "), "the other half may be nearer"
    aside = wall_at_2_m.copy()
    aside[:, :16] = np.nan
    aside[24, 32] = np.nan
    assert answer(aside, floor) == "nothing in the way", "one pixel, and what is beside the way"


def test_the_notebook_runs_from_its_first_cell_to_its_last(tmp_path, monkeypatch):
    import nbformat
    from nbclient import NotebookClient

    notebook = nbformat.read(EXAMPLES / "depth_of_a_room.ipynb", as_version=4)
    assert all(not cell.get("outputs") for cell in notebook.cells), "outputs are not committed"
    # The kernel of this interpreter, whatever is registered on this machine.
    kernel = tmp_path / "share/jupyter/kernels/python3"
    kernel.mkdir(parents=True)
    argv = [sys.executable, "-m", "ipykernel_launcher", "-f", "{connection_file}"]
    (kernel / "kernel.json").write_text(
        json.dumps({"argv": argv, "language": "python", "display_name": "python3"})
    )
    monkeypatch.setenv("JUPYTER_PATH", str(tmp_path / "share/jupyter"))
    NotebookClient(
        notebook, kernel_name="python3", timeout=120, resources={"metadata": {"path": EXAMPLES}}
    ).execute()
    images = [
        out
        for cell in notebook.cells
        for out in cell.get("outputs", [])
        if "image/png" in out.get("data", {})
    ]
    assert len(images) == 2
