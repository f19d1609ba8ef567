"""The examples of frames in shared memory, run as a user runs them."""

import contextlib
import os
import pathlib
import subprocess
import sys

import nunet_py as nunet
from streaming import TIMEOUT, daemon, unique_name

ROOT = pathlib.Path(__file__).parents[3]
EXAMPLES = ROOT / "examples" / "python"

# A camera that returns gray images of increasing brightness until it is unplugged, written where OpenCV would
# write.
FAKE_CV2 = """
import os, pathlib, time
import numpy as np
CAP_PROP_BUFFERSIZE = 38
UNPLUGGED = pathlib.Path(os.environ["FAKE_UNPLUGGED"])
class VideoCapture:
    def __init__(self, device):
        assert device == 0
        self.sent = -1
    def set(self, key, value):
        return True
    def grab(self):
        time.sleep(0.01)
        self.sent += 1
        return not UNPLUGGED.exists()
    def retrieve(self, image):
        assert image.shape == (48, 64, 3) and image.flags.c_contiguous
        image[:] = self.sent % 256
        return True, image
    def read(self):
        return True, np.zeros((48, 64, 3), np.uint8)
    def release(self):
        print("released", flush=True)
"""


def test_subscribe_prints_one_line_per_frame(camera):
    command = [sys.executable, EXAMPLES / "subscribe.py", camera, "3"]
    ended = subprocess.run(command, capture_output=True, text=True, timeout=120)
    assert ended.returncode == 0, ended.stderr
    lines = ended.stdout.splitlines()
    assert len(lines) == 3
    assert all(" ms old, center " in line and line.startswith("frame ") for line in lines)


def test_subscribe_prints_a_hint_when_its_daemon_dies(nunetd):
    name = unique_name()
    with daemon(nunetd, name, "--rate", "30") as process:
        command = [sys.executable, EXAMPLES / "subscribe.py", name]
        example = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        assert example.stdout.readline().startswith("frame ")
        process.kill()
        process.wait(timeout=30)
        _, error = example.communicate(timeout=120)
    assert example.returncode == 1
    assert error.startswith("subscribe: no frame of camera") and "\nhint: " in error


@contextlib.contextmanager
def stop_before_wall(nunetd, image):
    """The lines that the example prints for one image of the rendered drive,
    with the default network, and nunetd.
    """
    name = unique_name()
    camera = [
        "--mount",
        "0,0,0.25,0,-0.07,0",
        "--intrinsics",
        "262,262,160.3,119.2@320x240",
        "--loop",
        "--rate",
        "5",
    ]
    source, model = ROOT / "models/drive/rgb" / image, ROOT / "models/wnet_c.onnx"
    with daemon(nunetd, name, *camera, source=str(source), model=model) as process:
        command = [sys.executable, EXAMPLES / "stop_before_wall.py", name]
        example = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        try:
            yield example.stdout, process
        finally:
            example.kill()
            example.communicate(timeout=60)


def speed_at(nunetd, image):
    """The first speed that the example prints for an image."""
    with stop_before_wall(nunetd, image) as (lines, _):
        return float(next(line for line in lines if line.endswith(" m/s\n")).removesuffix(" m/s\n"))


def test_stop_before_wall_drives_where_2_m_are_free_and_all_but_stops_half_a_meter_before_a_chair(nunetd):
    free, near, nearest = (speed_at(nunetd, image) for image in ("0220.jpg", "0230.jpg", "0235.jpg"))
    assert free == 0.6
    assert nearest < 0.15
    assert nearest < near < free


def test_stop_before_wall_stops_when_nunetd_is_gone(nunetd):
    with stop_before_wall(nunetd, "0220.jpg") as (lines, process):
        assert next(line for line in lines if line.endswith(" m/s\n")) == "0.60 m/s\n"
        process.kill()
        assert next(line for line in lines if not line.endswith(" m/s\n")) == "0.00 m/s: no frame for 0.5 s\n"


def test_publish_webcam_sends_every_image_of_the_camera(tmp_path):
    (tmp_path / "cv2.py").write_text(FAKE_CV2)
    name = unique_name()
    command = [sys.executable, EXAMPLES / "publish_webcam.py", name]
    unplugged = tmp_path / "unplugged"
    environment = os.environ | {"PYTHONPATH": str(tmp_path), "FAKE_UNPLUGGED": str(unplugged)}
    example = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment)
    try:
        assert example.stdout.readline() == f"64x48 on `{name}`\n"
        with nunet.subscribe(name, topics=["rgb"], timeout=TIMEOUT) as frames:
            for _ in range(5):
                frame = frames.next()
                assert (frame.rgb == frame.sequence % 256).all() and frame.header.encoding == "bgr8"
    finally:
        unplugged.touch()
        out, _ = example.communicate(timeout=60)
    assert (example.returncode, out) == (0, "released\n")


def test_the_benchmark_of_a_hop_runs_and_copies_nothing():
    command = [sys.executable, ROOT / "benches" / "python_hop.py", "20"]
    ended = subprocess.run(command, capture_output=True, text=True, timeout=300)
    assert ended.returncode == 0, ended.stderr
    rows = [line.split("|") for line in ended.stdout.splitlines() if "B |" in line]
    assert len(rows) == 3 and all(row[4].strip() == "0" for row in rows), ended.stdout
