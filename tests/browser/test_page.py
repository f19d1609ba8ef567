"""The page in a real browser. Screenshots are written to target/browser/."""

import io
import json
import time
import urllib.request

import numpy as np
import pytest
from conftest import ROOT, TIMEOUT_S, View, Watched, wait_until
from PIL import Image
from playwright.sync_api import Browser, Page

SHOTS = ROOT / "target/browser"
# Notes the size of each frame, and when the page asked for the first one.
COUNT_BYTES = """
window.frameBytes = [];
window.WebSocket = class extends WebSocket {
  constructor(...address) {
    super(...address);
    this.addEventListener(
      "message", ({ data }) => data.byteLength && window.frameBytes.push(data.byteLength));
  }
  send(request) {
    window.asked ??= performance.now();
    super.send(request);
  }
};
"""
# A server whose cameras are not running yet.
WITHOUT_CAMERAS = """
window.WebSocket = class {
  static OPEN = 1;
  constructor() {
    const hello = { type: "hello", protocol: 1, cameras: [], palette: Array(768).fill(0) };
    setTimeout(() => this.onmessage({ data: JSON.stringify(hello) }));
  }
};
"""
# How a connection ends on which a text was sent, or which the page closes.
CLOSE = """
text => new Promise((resolve) => {
  const socket = new WebSocket(`ws://${location.host}/ws`);
  socket.onopen = () => text ? socket.send(text) : socket.close(1000);
  socket.onclose = ({ code, wasClean }) => resolve([code, wasClean]);
})
"""


def shot(page: Page, name: str) -> None:
    """Keeps a screenshot of the whole page."""
    SHOTS.mkdir(parents=True, exist_ok=True)
    page.screenshot(path=str(SHOTS / f"{name}.png"), full_page=True)


def canvas(page: Page, name: str) -> np.ndarray:
    """A canvas as the screen shows it, RGB."""
    png = page.locator(f"#{name}").screenshot()
    return np.asarray(Image.open(io.BytesIO(png)).convert("RGB"))


def colors(pixels: np.ndarray) -> int:
    """How many different colors there are."""
    return len(np.unique(pixels.reshape(-1, 3), axis=0))


@pytest.mark.parametrize(
    ("name", "width", "height", "scheme"),
    [("light", 1280, 900, "light"), ("dark", 1280, 900, "dark"), ("phone", 390, 844, "light")],
)
def test_everything_is_shown_without_errors(
    browser: Browser, view: View, name: str, width: int, height: int, scheme: str
) -> None:
    """Every pane has content, nothing is wider than the screen, no other host is asked."""
    page = browser.new_page(viewport={"width": width, "height": height}, color_scheme=scheme)
    watched = Watched(page)
    watched.open(view.url)
    page.wait_for_timeout(1500)
    shot(page, name)
    for pane in ["image", "depth", "labels"]:
        assert colors(canvas(page, pane)) > 5, pane
    cloud = canvas(page, "cloud")
    background = np.array([10, 13, 18])
    covered = (np.abs(cloud.astype(int) - background).sum(axis=2) > 30).mean()
    assert covered > 0.15, f"the cloud covers {covered:.0%} of its canvas"
    assert colors(cloud) > 100
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    light = page.evaluate("getComputedStyle(document.body).backgroundColor") == "rgb(246, 247, 249)"
    assert light == (scheme == "light")
    assert "live" in page.inner_text("#state")
    assert watched.problems == []
    assert watched.hosts == {view.url.split("/")[2]}
    page.close()


def test_the_readout_is_the_depth_of_depth_npy(browser: Browser, view: View) -> None:
    """At some pixels, the number under the pointer is the value in the file;
    also by keyboard, and while paused.
    """
    page = browser.new_page(viewport={"width": 1280, "height": 900})
    watched = Watched(page)
    watched.open(view.url)
    found = []
    box = page.locator("#depth").bounding_box()
    for u, v in [(0.1, 0.1), (0.5, 0.5), (0.83, 0.4), (0.3, 0.9)]:
        page.mouse.move(box["x"] + u * box["width"], box["y"] + v * box["height"])
        expected_x = int(u * 640)
        wait_until(
            page, "x => Math.abs(Number(document.getElementById('readout').dataset.x) - x) < 3", expected_x
        )
        found.append(page.evaluate("({...document.getElementById('readout').dataset})"))
    page.click("#pause")
    page.focus("#image")
    before = found[-1]
    page.keyboard.press("ArrowRight")
    wait_until(page, "x => document.getElementById('readout').dataset.x === x", str(int(before["x"]) + 1))
    found.append(page.evaluate("({...document.getElementById('readout').dataset})"))
    assert page.inner_text("#announcement") == page.inner_text("#readout")
    assert page.inner_text("#state") == "paused"
    page.close()
    view.stop()
    depth = np.load(view.out / "depth.npy")
    for point in found:
        truth = depth[int(point["y"]), int(point["x"])]
        shown = float(point["depth"]) if point["depth"] else float("nan")
        assert shown == truth or (np.isnan(shown) and np.isnan(truth)), (point, truth)
    assert watched.problems == []


def test_the_readout_and_the_cloud_know_the_part_of_the_image_that_depth_covers(
    browser: Browser, wide_view: View
) -> None:
    """A point of the image reads the depth behind it,
    and no point of the cloud has a color from beside it.
    """
    page = browser.new_page(viewport={"width": 1280, "height": 900})
    watched = Watched(page)
    watched.open(wide_view.url)
    box = page.locator("#image").bounding_box()
    for x, y in [(100, 80), (320, 240), (600, 400)]:
        mouse = box["x"] + (160.5 + x) / 960 * box["width"], box["y"] + (y + 0.5) / 480 * box["height"]
        page.mouse.move(*mouse)
        near = "x => Math.abs(Number(document.getElementById('readout').dataset.x) - x) < 4"
        wait_until(page, near, x)
        assert abs(int(page.get_attribute("#readout", "data-y")) - y) < 4
        marker = page.locator("#marker").bounding_box()
        center = marker["x"] + marker["width"] / 2, marker["y"] + marker["height"] / 2
        assert np.abs(np.subtract(center, mouse)).max() < 6
    page.mouse.move(box["x"] + 5, box["y"] + 5)
    wait_until(page, "document.getElementById('readout').dataset.x === '0'")
    page.mouse.move(0, 0)
    cloud = canvas(page, "cloud").astype(int)
    is_magenta = (cloud[..., 0] > 180) & (cloud[..., 1] < 70) & (cloud[..., 2] > 180)
    assert colors(cloud) > 100
    assert is_magenta.mean() < 0.01
    shot(page, "wide")
    assert watched.problems == []
    page.close()


def test_confidence_is_shown_on_request(browser: Browser, confident_view: View) -> None:
    """Its pane, the readout, and the blended view; nothing of it is computed before."""
    context = browser.new_context(viewport={"width": 1280, "height": 900})
    watched = Watched(context.new_page())
    page = watched.open(confident_view.url)
    assert not page.is_visible("#confidence")
    page.focus("#show-confidence")
    page.keyboard.press("Space")
    page.wait_for_selector("#confidence", state="visible")
    page.focus("#confidence")
    page.keyboard.press("ArrowRight")
    wait_until(page, "document.getElementById('readout').dataset.confidence")
    shot(page, "confidence")
    shown = canvas(page, "confidence")
    assert colors(shown) > 5
    assert (np.ptp(shown.astype(int), axis=2) == 0).mean() > 0.9, "it is gray"
    point = page.evaluate("({...document.getElementById('readout').dataset})")
    readout = page.inner_text("#announcement")
    assert readout.endswith(f", confidence {round(100 * int(point['confidence']) / 255)} %"), readout
    page.select_option("#layout", "blend")
    page.wait_for_selector("#blend", state="visible")
    before = canvas(page, "blend").astype(int)
    page.fill("#confidence-share", "1")
    page.wait_for_timeout(300)
    assert canvas(page, "blend").astype(int).sum() < before.sum(), "uncertain pixels are darker"
    shot(page, "confidence-blended")
    page.uncheck("#show-confidence")
    page.select_option("#layout", "side")
    assert not page.is_visible("#confidence")
    assert watched.problems == []
    context.close()
    confident_view.stop()
    confidence = np.asarray(Image.open(confident_view.out / "confidence.png"))
    assert confidence[int(point["y"]), int(point["x"])] == int(point["confidence"])


def test_obstacles_are_shown_from_above(browser: Browser, robot_view: View) -> None:
    """With a mount there is a pane with free and occupied directions, also described in words."""
    page = browser.new_page(viewport={"width": 1280, "height": 900})
    watched = Watched(page)
    watched.open(robot_view.url)
    page.wait_for_selector("#obstacles", state="visible")
    page.wait_for_timeout(500)
    shot(page, "obstacles")
    pixels = canvas(page, "obstacles").reshape(-1, 3).astype(int)
    sectors = np.array([[0x78, 0xC8, 0x78], [0x96, 0x96, 0x96], [0xC8, 0x1E, 0x1E], [0xF0, 0x96, 0x1E]])
    shown = (np.abs(pixels[:, None] - sectors).sum(axis=2) < 12).mean(axis=0)
    assert shown.sum() > 0.25, f"sectors cover {shown.sum():.0%} of the pane"
    text = page.inner_text("#obstacle-text")
    assert text == "none seen" or " m, " in text
    assert page.get_attribute("#obstacles", "aria-label").endswith(text)
    assert watched.problems == []
    page.close()


def test_without_a_mount_there_is_no_pane_for_obstacles(browser: Browser, view: View) -> None:
    """Obstacles need the camera's place on the robot."""
    page = browser.new_page()
    Watched(page).open(view.url)
    assert not page.is_visible("#obstacles")
    page.close()


def test_settings_change_what_is_shown_and_are_kept(browser: Browser, view: View) -> None:
    """Blended view, fixed colors, cloud colors and theme; all usable by keyboard alone."""
    context = browser.new_context(viewport={"width": 1280, "height": 900}, color_scheme="light")
    watched = Watched(context.new_page())
    page = watched.open(view.url)
    page.select_option("#layout", "blend")
    page.wait_for_selector("#blend", state="visible")
    assert not page.is_visible("#image")
    page.fill("#label-share", "0.5")
    page.select_option("#theme", "dark")
    page.uncheck("#auto")
    page.fill("#near", "0.5")
    page.fill("#far", "20")
    wait_until(page, "document.getElementById('range-text').textContent === '0.50 to 20.00 m'")
    before = canvas(page, "cloud")
    page.select_option("#cloud-colors", "depth")
    page.focus("#cloud")
    page.keyboard.press("ArrowLeft")
    page.keyboard.press("+")
    page.wait_for_timeout(500)
    assert np.abs(canvas(page, "cloud").astype(int) - before).mean() > 2
    shot(page, "blended")
    page.reload()
    watched.open(view.url)
    assert page.input_value("#far") == "20"
    assert page.is_visible("#blend")
    page.focus("#camera")
    reached = []
    for _ in range(30):
        page.keyboard.press("Tab")
        reached.append(page.evaluate("document.activeElement.id"))
    assert {"pause", "layout", "theme", "blend", "cloud", "near", "far", "max-rate"} <= set(reached)
    assert watched.problems == []
    context.close()


def test_the_page_comes_back_after_the_daemon_is_gone(browser: Browser, view: View) -> None:
    """It says that it is not connected, and shows frames again without a reload."""
    page = browser.new_page()
    watched = Watched(page)
    watched.open(view.url)
    view.stop()
    wait_until(page, "document.getElementById('state').textContent === 'not connected'")
    assert colors(canvas(page, "image")) > 5, "the last image stays"
    shown = int(page.inner_text("#shown"))
    view.start()
    wait_until(page, "shown => Number(document.getElementById('shown').textContent) > shown", shown)
    page.close()


def test_the_page_waits_for_cameras_that_are_starting(browser: Browser, view: View) -> None:
    """While a model is loaded, the server runs without a camera: that is not a problem."""
    page = browser.new_page()
    page.add_init_script(WITHOUT_CAMERAS)
    page.goto(view.url)
    wait_until(page, "document.getElementById('state').textContent === 'the cameras are starting'")
    assert not page.evaluate("document.getElementById('state').classList.contains('problem')")
    page.close()


def test_a_browser_learns_why_a_connection_ends(browser: Browser, view: View) -> None:
    """The server answers the page's close, and states a code when it closes."""
    page = browser.new_page()
    page.goto(view.url)
    assert page.evaluate(CLOSE, "") == [1000, True]
    assert page.evaluate(CLOSE, "{") == [1008, True]
    assert page.evaluate(CLOSE, "x" * 5000) == [1009, True]
    page.close()


def test_the_default_rate_suits_a_phone(browser: Browser, view: View) -> None:
    """At most 3 Mbit/s on average since the page asked for frames,
    and three frames more because of jitter.
    """
    page = browser.new_page(viewport={"width": 390, "height": 844})
    page.add_init_script(COUNT_BYTES)
    watched = Watched(page)
    watched.open(view.url)
    wait_until(page, "frameBytes.length >= 40")
    sizes, seconds = page.evaluate("[frameBytes, (performance.now() - asked) / 1000]")
    print(f"{8e-6 * sum(sizes) / seconds:.2f} Mbit/s over {seconds:.1f} s")
    assert 8e-6 * sum(sizes) <= 3.0 * seconds + 8e-6 * 3 * max(sizes)
    page.close()


def first_camera(view: View) -> str:
    """The name of the camera, as soon as it runs: the server is earlier."""
    end = time.monotonic() + TIMEOUT_S
    while time.monotonic() < end:
        with urllib.request.urlopen(view.url + "api/cameras", timeout=TIMEOUT_S) as answer:
            if cameras := json.load(answer)["cameras"]:
                return cameras[0]["name"]
        time.sleep(0.05)
    raise AssertionError(f"no camera after {TIMEOUT_S} s")


def test_the_video_is_shown_by_an_image_element(browser: Browser, view: View) -> None:
    """`/CAMERA/depth.mjpeg` in `<img>`, as a dashboard has it."""
    camera = first_camera(view)
    page = browser.new_page()
    page.goto(view.url)
    page.evaluate(
        "url => { const image = new Image(); image.src = url; image.id = 'video'; "
        "document.body.append(image); }",
        f"/{camera}/depth.mjpeg?width=320",
    )
    wait_until(page, "document.getElementById('video').naturalWidth === 320")
    page.close()


def test_first_paint(browser: Browser, view: View) -> None:
    """Loaded and painted: the time is printed,
    and is not held to a limit on a machine that does other work.
    """
    page = browser.new_page()
    start = time.monotonic()
    page.goto(view.url)
    wait_until(page, "performance.getEntriesByName('first-contentful-paint').length > 0")
    paint = page.evaluate("performance.getEntriesByName('first-contentful-paint')[0].startTime")
    loaded = time.monotonic() - start
    print(f"first contentful paint after {paint:.0f} ms; seen {1000 * loaded:.0f} ms after the request")
    assert paint > 0
    page.close()
