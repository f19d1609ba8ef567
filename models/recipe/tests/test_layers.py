"""The packages of the recipe import each other in one direction."""

import ast
from pathlib import Path

import nunet_models

ROOT = Path(nunet_models.__file__).parent


def imports_by_package(sources):
    """Which packages each package imports; `sources` are module names, dotted, with their text."""
    found = {}
    for module, text in sources.items():
        package = module.split(".")[1]
        for node in ast.walk(ast.parse(text)):
            names = [node.module] if isinstance(node, ast.ImportFrom) and node.module else []
            names += [a.name for a in node.names] if isinstance(node, ast.Import) else []
            others = {n.split(".")[1] for n in names if n.startswith("nunet_models.")}
            found.setdefault(package, set()).update(others - {package})
    return found


def cycle(imports):
    """Packages in a circle of imports, and those that import them; empty where there is none."""
    left = dict(imports)
    while True:
        free = [name for name, others in left.items() if not others & set(left)]
        if not free:
            return sorted(left)
        for name in free:
            del left[name]


def test_no_packages_import_each_other_in_a_circle():
    sources = {
        ".".join(("nunet_models", *path.relative_to(ROOT).with_suffix("").parts)): path.read_text()
        for path in ROOT.rglob("*.py")
    }
    imports = imports_by_package(sources)
    assert {"zoo", "data", "export", "evaluation", "training"} <= set(imports)
    assert cycle(imports) == []


def test_a_circle_is_found():
    sources = {
        "nunet_models.a.x": "from nunet_models.b.y import z",
        "nunet_models.b.y": "import nunet_models.c",
        "nunet_models.c": "def f():\n    from nunet_models.a import x",
        "nunet_models.d": "from nunet_models.a.x import z",
    }
    assert cycle(imports_by_package(sources)) == ["a", "b", "c", "d"]
