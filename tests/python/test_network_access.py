"""nunet opens no connection and asks no name server, as seen in its own network namespace.

ONNX Runtime's wheel tries to reach its vendor about ten seconds after its library is loaded, so the programs
run for thirty seconds.
"""

import importlib.util
import json
import os
import pathlib
import subprocess
import sys

import pytest
from conftest import MODEL, unavailable

SECONDS = 30
WITNESS = pathlib.Path(__file__).with_name("network_witness.py")
# A network namespace needs root, or a kernel that allows user namespaces.
NAMESPACE = ["unshare", "--net", "--mount", *([] if os.geteuid() == 0 else ["--user", "--map-root-user"])]
PROGRAM = f"""
import os, time
import numpy as np, nunet_py
result = nunet_py.Model({str(MODEL)!r}).infer(np.zeros((48, 64, 3), np.uint8))
assert os.environ["ORT_DISABLE_TELEMETRY"] == "1"
time.sleep({10 * SECONDS})
"""


def need_namespace():
    """Skips where no network namespace can be made, and says why. CI runs as root and must not skip."""
    probe = subprocess.run(
        [*NAMESPACE, "ip", "link", "set", "lo", "up"], check=False, capture_output=True, text=True, timeout=60
    )
    if probe.returncode != 0:
        unavailable(
            f"no network namespace (needs root, unshare and ip): {probe.stderr.strip()}", needs_root=True
        )


@pytest.fixture
def environment(tmp_path):
    """The environment of a new user, without settings and cache, so that the model check runs too."""
    library = importlib.util.find_spec("onnxruntime").submodule_search_locations[0]
    (file,) = pathlib.Path(library, "capi").glob("libonnxruntime.so.*")
    kept = {name: value for name, value in os.environ.items() if name != "ORT_DISABLE_TELEMETRY"}
    return {
        **kept,
        "HOME": str(tmp_path),
        "XDG_CACHE_HOME": str(tmp_path / "cache"),
        "ORT_DYLIB_PATH": str(file),
    }


def watched(commands, environment):
    """The packets that were sent while the commands ran."""
    command = [*NAMESPACE, sys.executable, str(WITNESS), str(SECONDS), json.dumps(commands)]
    done = subprocess.run(
        command, check=False, capture_output=True, text=True, env=environment, timeout=10 * SECONDS
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


def test_nunetd_and_a_python_model_send_no_packet(nunetd, environment, tmp_path):
    need_namespace()
    source = ["--source", "demo", "--rate", "5", "--camera", f"pytest-network-{os.getpid()}"]
    commands = [
        [nunetd, "-q", "--model", str(MODEL), *source],
        [sys.executable, "-W", "ignore", "-c", PROGRAM],
    ]
    report = watched(commands, environment)
    control = " ".join(report["control"])
    assert "127.0.0.1:53 for" in control and "192.0.2.7:443" in control, f"the witness is blind: {control}"
    assert report["early"] == [None, None], f"a program ended by itself: {report}"
    assert report["codes"][0] == 0, report
    assert report["seen"] == []
    # If ONNX Runtime sent events, it would keep a queue of them here.
    assert [path.name for path in (tmp_path / "cache").iterdir()] == ["nunet"]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["cache"]
