import os
import subprocess
import sys
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


def test_telemetry_is_off_after_the_import_unless_the_user_allows_it():
    code = "import os, nunet_models; print(os.environ['ORT_DISABLE_TELEMETRY'])"
    for given, expected in [("", "1"), ("yes", "1"), ("1", "1"), ("0", "0")]:
        done = subprocess.run(
            [sys.executable, "-c", code],
            cwd=RECIPE,
            env={**os.environ, "ORT_DISABLE_TELEMETRY": given},
            capture_output=True,
            text=True,
            check=True,
            timeout=120,
        )
        assert done.stdout == f"{expected}\n", given
