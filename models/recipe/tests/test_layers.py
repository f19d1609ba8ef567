"""Packages and modules of the recipe and of `nunet_py` import each other in one direction."""

import ast
from pathlib import Path

import pytest

import nunet_models

RECIPE = Path(nunet_models.__file__).parent
NUNET_PY = RECIPE.parents[2] / "crates/nunet-py/python/nunet_py"


def sources_of(root):
    """The modules below a folder, dotted names with their texts, and which of them are packages."""
    sources, packages = {}, set()
    for path in root.rglob("*.py"):
        parts = path.relative_to(root.parent).with_suffix("").parts
        if parts[-1] == "__init__":
            parts = parts[:-1]
            packages.add(".".join(parts))
        sources[".".join(parts)] = path.read_text()
    return sources, packages


def names_in(node, module, is_package):
    """What an import statement may name, dotted: modules, and what is within them."""
    if isinstance(node, ast.Import):
        return [alias.name for alias in node.names]
    if not isinstance(node, ast.ImportFrom):
        return []
    start = node.module or ""
    if node.level:
        here = module.split(".")
        ups = node.level - is_package
        start = ".".join(here[: len(here) - ups] + ([node.module] if node.module else []))
    return [f"{start}.{alias.name}" for alias in node.names]


def imports_by_module(sources, packages=()):
    """Which modules each module imports, wherever the statement is."""
    found = {}
    for module, text in sources.items():
        nodes = ast.walk(ast.parse(text))
        names = [name for node in nodes for name in names_in(node, module, module in packages)]
        # `from a.b import c` imports the module a.b.c, or a name of a.b.
        modules = {name if name in sources else name.rpartition(".")[0] for name in names}
        found[module] = modules & set(sources) - {module}
    return found


def by_package(imports):
    """The same between the packages directly below the root; a module there is one of them."""
    found = {}
    for module, others in imports.items():
        if "." in module:
            package = module.split(".")[1]
            names = {other.split(".")[1] for other in others if "." in other}
            found.setdefault(package, set()).update(names - {package})
    return found


def cycle(imports):
    """What is in a circle of imports or imports such a circle; empty where there is none."""
    left = dict(imports)
    while True:
        free = [name for name, others in left.items() if not others & set(left)]
        if not free:
            return sorted(left)
        for name in free:
            del left[name]


def test_no_packages_import_each_other_in_a_circle():
    imports = by_package(imports_by_module(*sources_of(RECIPE)))
    assert {"zoo", "data", "export", "evaluation", "training"} <= set(imports)
    assert cycle(imports) == []


@pytest.mark.parametrize(("root", "some"), [(RECIPE, "training"), (NUNET_PY, "_plot")])
def test_no_modules_import_each_other_in_a_circle(root, some):
    imports = imports_by_module(*sources_of(root))
    assert f"{root.name}.{some}" in imports
    assert any(imports.values()), "no import was understood"
    assert cycle(imports) == []


def test_a_circle_is_found():
    sources = {
        "nunet_models.a.x": "from nunet_models.b.y import z",
        "nunet_models.b.y": "import nunet_models.c",
        "nunet_models.c": "def f():\n    from nunet_models.a import x",
        "nunet_models.d": "from nunet_models.a.x import z",
        "nunet_models.e": "import os",
    }
    imports = imports_by_module(sources)
    assert cycle(imports) == [f"nunet_models.{name}" for name in ("a.x", "b.y", "c", "d")]
    assert cycle(by_package(imports)) == ["a", "b", "c", "d"]


def test_a_circle_within_one_package_is_found():
    sources = {
        "p": "from p.a import x",
        "p.a": "from . import b",
        "p.b": "from .c import y",
        "p.c": "import p.a",
        "p.s": "from .x import z\nfrom . import x",
        "p.s.x": "from ..b import y",
    }
    imports = imports_by_module(sources, packages={"p", "p.s"})
    assert imports["p.s"] == {"p.s.x"}
    assert imports["p.s.x"] == {"p.b"}
    assert cycle(imports) == ["p", "p.a", "p.b", "p.c", "p.s", "p.s.x"]
    assert cycle(by_package(imports)) == ["a", "b", "c", "s"]
    assert cycle(imports_by_module(sources | {"p.c": ""}, packages={"p", "p.s"})) == []
