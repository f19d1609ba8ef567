"""A running nunetd with a live view, and a browser."""

import os
import re
import shutil
import subprocess
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import PIL.Image
import pytest
from playwright.sync_api import Browser, Page, sync_playwright

ROOT = Path(__file__).parents[2]
TIMEOUT_S = 120.0
# `/tmp/iceoryx2` may belong to another user, who then alone can use it.
os.environ.setdefault("NUNET_IPC_ROOT", f"{tempfile.gettempdir()}/nunet-{os.getuid()}")
# Without a graphics card, Chromium renders WebGL on the processor.
CHROMIUM_ARGS = ["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]


FREE_PORT = "127.0.0.1:0"


@dataclass
class View:
    """A live view."""

    command: list[str]
    out: Path
    log: Path
    url: str = ""
    process: subprocess.Popen | None = None

    def start(self) -> None:
        """Starts nunetd: on a free port, and later on the same one."""
        address = self.url.removeprefix("http://").removesuffix("/") or FREE_PORT
        with self.log.open("w") as stderr:
            command = [*self.command, "--view", address]
            self.process = subprocess.Popen(command, stderr=stderr, stdin=subprocess.DEVNULL)
        self.url = wait_for_url(self.process, self.log)

    def stop(self) -> None:
        """Ends nunetd, which then writes the results of its last frame."""
        self.process.terminate()
        assert self.process.wait(TIMEOUT_S) == 0


def nunetd() -> str:
    """The program under test."""
    named = os.environ.get("NUNETD") or str(ROOT / "target/debug/nunetd")
    assert Path(named).is_file(), f"no nunetd at {named}; build it, or name it by NUNETD"
    return named


@pytest.fixture
def view(tmp_path: Path) -> Iterator[View]:
    """nunetd on one image of the bundled clip in a loop, so that every frame has the same depth."""
    intrinsics = os.environ.get("NUNET_VIEW_INTRINSICS", "518.86,519.47,325.58,253.74@640x480")
    yield from repeated_image(tmp_path, ROOT / "models/clip/rgb", ["--intrinsics", intrinsics])


@pytest.fixture
def robot_view(tmp_path: Path) -> Iterator[View]:
    """nunetd on one image from robot height, with the camera's place on the robot."""
    camera = ["--intrinsics", "262,262,160.3,119.2@320x240", "--mount", "0,0,0.25,0,-0.07,0"]
    yield from repeated_image(tmp_path, ROOT / "models/drive/rgb", camera)


@pytest.fixture
def confident_view(tmp_path: Path) -> Iterator[View]:
    """nunetd with a small untrained model that states its confidence."""
    arguments = ["--model", str(ROOT / "models/tiny/tiny_unet_confidence.onnx")]
    yield from repeated_image(tmp_path, ROOT / "models/clip/rgb", arguments)


@pytest.fixture
def wide_view(tmp_path: Path) -> Iterator[View]:
    """nunetd on an image that is wider than the network's:
    depth covers its middle, and the rest is magenta.
    """
    folder = tmp_path / "wide"
    folder.mkdir()
    image = PIL.Image.new("RGB", (960, 480), (255, 0, 255))
    image.paste(PIL.Image.open(min((ROOT / "models/clip/rgb").iterdir())), (160, 0))
    image.save(folder / "wide.png")
    yield from repeated_image(tmp_path, folder, ["--intrinsics", "518.86,519.47,485.58,253.74@960x480"])


def repeated_image(tmp_path: Path, folder: Path, arguments: list[str]) -> Iterator[View]:
    """nunetd on the first image of a folder, in a loop."""
    images = tmp_path / "images"
    images.mkdir()
    shutil.copy(min(folder.iterdir()), images)
    out, log = tmp_path / "out", tmp_path / "log"
    command = [
        nunetd(), "run", "--source", str(images), "--loop", "--rate", "10", "--camera", f"view{os.getpid()}",
        *arguments, "--out", str(out),
    ]  # fmt: skip
    view = View(command, out, log)
    try:
        view.start()
        yield view
    finally:
        if view.process is not None:
            view.process.kill()
            view.process.wait()


def wait_for_url(process: subprocess.Popen, log: Path) -> str:
    """The address that nunetd logs."""
    end = time.monotonic() + TIMEOUT_S
    while time.monotonic() < end:
        found = re.search(r"live view on (http://\S+/)", log.read_text())
        if found:
            return found[1]
        assert process.poll() is None, log.read_text()
        time.sleep(0.05)
    raise AssertionError(f"no live view after {TIMEOUT_S} s:\n{log.read_text()}")


@pytest.fixture(scope="session")
def browser() -> Iterator[Browser]:
    """The system's Chromium."""
    program = os.environ.get("CHROMIUM") or shutil.which("chromium") or shutil.which("google-chrome")
    assert program, "no Chromium; install it (Debian: apt-get install chromium), or name it by CHROMIUM"
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=program, args=CHROMIUM_ARGS)
        yield browser
        browser.close()


def wait_until(page: Page, expression: str, argument: object = None) -> None:
    """Waits until an expression of the page is true.

    Playwright's own function needs `eval`, which the page forbids.
    """
    end = time.monotonic() + TIMEOUT_S
    while time.monotonic() < end:
        if page.evaluate(expression, argument):
            return
        page.wait_for_timeout(50)
    raise AssertionError(
        f"still false after {TIMEOUT_S} s: {expression}; the page says {page.inner_text('#state')}"
    )


class Watched:
    """A page, with its errors and warnings."""

    def __init__(self, page: Page) -> None:
        """Listens before anything is loaded."""
        self.page = page
        self.problems: list[str] = []
        self.hosts: set[str] = set()
        page.on("console", self.note)
        page.on("pageerror", lambda error: self.problems.append(str(error)))
        page.on("request", lambda request: self.hosts.add(request.url.split("/")[2]))

    def note(self, message: object) -> None:
        """Keeps warnings and errors. Reading pixels back is slow, and only tests do it."""
        if message.type in ("error", "warning") and "ReadPixels" not in message.text:
            self.problems.append(message.text)

    def open(self, url: str) -> Page:
        """Loads the page and waits for its first frames."""
        self.page.goto(url)
        wait_until(self.page, "Number(document.getElementById('shown').textContent) >= 3")
        return self.page
