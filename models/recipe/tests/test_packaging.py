import tomllib
from pathlib import Path

from packaging.requirements import Requirement

RECIPE = Path(__file__).parents[1]
NUMPY_OF_BPY = "1.26.4"  # bpy 4.5 is built for numpy 1 and requires numpy<2


def test_the_render_extra_can_be_installed_beside_the_recipe():
    project = tomllib.loads((RECIPE / "pyproject.toml").read_text())["project"]
    extras = [Requirement(text) for text in project["optional-dependencies"]["render"]]
    assert [(extra.name, str(extra.specifier)) for extra in extras] == [("bpy", "==4.5.*")]
    needed = {one.name: one for one in map(Requirement, project["dependencies"])}
    assert needed["numpy"].specifier.contains(NUMPY_OF_BPY)
