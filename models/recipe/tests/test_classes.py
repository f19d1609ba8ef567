"""The 13 classes: one list of names wherever one is kept, and one fold of NYU's 40 into them."""

import importlib
import re
import subprocess
import sys
from pathlib import Path
from unittest.mock import MagicMock

import numpy as np

from nunet_models.classes import CLASSES_13, IGNORE, labels13_from_labels40

RECIPE = Path(__file__).parents[1]
CRATES = RECIPE.parents[1] / "crates"


def rust_list(path: Path, name: str) -> str:
    """What stands between the brackets of a Rust constant."""
    found = re.search(rf"const {name}: \[[^\]]*\] = \[(.*?)\];", path.read_text(), re.DOTALL)
    assert found, f"no list `{name}` in {path}"
    return found[1]


def test_the_rust_crates_have_the_same_names_in_the_same_order():
    names = rust_list(CRATES / "nunet-types/src/classes.rs", "NYU13_CLASSES")
    names = re.findall(r'"(.*?)"', names)
    assert tuple(names) == CLASSES_13


def test_nunetd_folds_nyu_s_40_classes_in_the_same_way():
    numbers = rust_list(CRATES / "nunet-eval/src/dataset/labels.rs", "NYU13_OF_NYU40")
    folded = [int(number) for number in re.findall(r"\d+", numbers)]
    folded += [IGNORE] * (256 - len(folded))
    assert labels13_from_labels40(np.arange(256, dtype=np.uint8)).tolist() == folded


def test_rendered_rooms_are_labeled_by_the_same_names(monkeypatch):
    """Blender is stood in for: the shapes' labels need nothing of it."""
    for name in ("bpy", "mathutils"):
        monkeypatch.setitem(sys.modules, name, MagicMock())
    module = "nunet_models.rendering.shapes"
    monkeypatch.delitem(sys.modules, module, raising=False)
    shapes = importlib.import_module(module)
    monkeypatch.delitem(sys.modules, module)  # it holds the stand-ins
    assert shapes.CLASSES is CLASSES_13


def test_the_names_can_be_had_without_torch():
    """Blender's Python has none, and renders by them."""
    program = "import sys, nunet_models.classes; assert 'torch' not in sys.modules"
    subprocess.run([sys.executable, "-c", program], cwd=RECIPE, check=True, timeout=120)
