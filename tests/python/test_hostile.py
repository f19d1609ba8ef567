"""Truncated and damaged files of every kind, read by the real `nunetd` under limits of memory and time.

It must exit with a code and an error message, never by a signal, and within both limits.
`NUNET_SWEEP=1000 NUNETD=target/release/nunetd python -m pytest -s tests/python/test_hostile.py` tries a
thousand copies of each kind and prints how these runs ended.
"""

import collections
import concurrent.futures
import contextlib
import importlib.util
import io
import os
import pathlib
import random
import resource
import shutil
import signal
import subprocess
import time

import numpy as np
import pytest
from conftest import MODEL
from mcap.reader import NonSeekingReader
from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter
from PIL import Image
from test_pipe import y4m
from test_recordings import image, json_recording, make_bag

COPIES = int(os.environ.get("NUNET_SWEEP") or 8)
# The largest image that is decoded takes 512 MB, and its results as much; the model test raises its own
# limit.
ADDRESS_SPACE = 4 << 30
PEAK_BYTES = 1500 << 20
TIMEOUT_S = 60
ONCE = ["--provider", "cpu", "--threads", "1"]
CALIBRATION = """image_width: 640
image_height: 480
camera_matrix: {rows: 3, cols: 3, data: [518.5, 0, 325.25, 0, 519, 253.5, 0, 0, 1]}
distortion_model: plumb_bob
distortion_coefficients: {rows: 1, cols: 5, data: [-0.31, 0.11, 7.0e-4, -.0004, 0]}
"""
SIDECAR = """[input]
tensor = "rgb"
layout = "nhwc"
dtype = "uint8"
size = [96, 128]
[output]
depth = "depth"
encoding = "metric"
min_m = 0.1
max_m = 20.0
"""
ROOT = pathlib.Path(__file__).parents[2]
CONFIG = f"""model = "{MODEL.with_suffix(".toml")}"
source = "{ROOT}/models/clip/rgb/*.jpg"
rate = 15.5
loop = true
publish = ["depth", "cloud"]
every = ["segmentation=3"]
filter = ["holes", "spatial=alpha:0.4,delta:0.1"]
intrinsics = "518.9,519.5,325.6,253.7@640x480"
"""


def image_file(form):
    file = io.BytesIO()
    Image.fromarray(image(0)[:120, :160]).save(file, form)
    return file.getvalue()


def recorded(folder, form):
    return make_bag(folder / form, form, images=[image(index) for index in range(2)]).read_bytes()


def json_file(folder):
    json_recording(folder / "json.mcap")
    return (folder / "json.mcap").read_bytes()


@pytest.fixture(scope="module")
def good(tmp_path_factory):
    """A good file of each kind."""
    folder = tmp_path_factory.mktemp("good")
    return {
        "mcap_png": recorded(folder, "png"),
        "mcap_rgb": recorded(folder, "rgb8"),
        "mcap_json": json_file(folder),
        "y4m": y4m(),
        "jpeg": image_file("jpeg"),
        "png": image_file("png"),
        "config": CONFIG.encode(),
        "calibration": CALIBRATION.encode(),
        "manifest": MODEL.with_suffix(".toml").read_bytes(),
        "sidecar": SIDECAR.encode(),
        "model": MODEL.read_bytes(),
    }


class Bench:
    """A folder in which one file is tried after the other."""

    def __init__(self, nunetd, folder):
        self.nunetd, self.folder = nunetd, folder
        folder.mkdir(parents=True)
        self.environment = os.environ | {
            "ORT_DYLIB_PATH": os.environ.get("ORT_DYLIB_PATH") or str(runtime_library()),
            "RUST_BACKTRACE": "0",
            "XDG_CACHE_HOME": str(folder / "cache"),  # thousands of verdicts on models
        }
        Image.fromarray(image(1)[:120, :160]).save(folder / "good.png")
        for path in MODEL.parent.glob(f"{MODEL.stem}.*onnx"):
            shutil.copy(path, folder)
        # A foreign network: the same file without the key that marks nunet's files.
        (folder / "foreign.onnx").write_bytes(MODEL.read_bytes().replace(b"nunet.version", b"xunet.version"))

    def command(self, kind, data):
        """Writes the file, and returns the arguments of nunetd that read it."""
        path = self.folder / {
            "config": "a.toml",
            "calibration": "a.yaml",
            "manifest": "staged.toml",
            "sidecar": "foreign.toml",
            "model": "a.onnx",
        }.get(kind, f"a.{kind.split('_')[0]}")
        if kind != "y4m":
            path.write_bytes(data)
        # A result of an earlier copy must not count for this one.
        (self.folder / "out.mcap").unlink(missing_ok=True)
        infer = ["infer", str(self.folder / "good.png"), "--out", str(self.folder / "out"), *ONCE]
        model = ["--model", str(MODEL)]
        camera = ["--camera", f"pytest-hostile-{os.getpid()}-{self.folder.name}", "--publish", "depth"]
        return {
            "mcap": ["replay", str(path), str(self.folder / "out.mcap"), *model, *ONCE],
            "y4m": [*model, *ONCE, "--source", "-", *camera],
            "jpeg": ["infer", str(path), *infer[2:], *model],
            "png": ["infer", str(path), *infer[2:], *model],
            "config": ["config", "--config", str(path)],
            "calibration": [*infer, *model, "--calibration", str(path)],
            "manifest": [*infer, "--model", str(path)],
            "sidecar": [*infer, "--model", str(self.folder / "foreign.onnx")],
            "model": [*infer, "--model", str(path)],
        }[kind.split("_")[0]]

    def try_one(self, kind, data):
        """Exit code (negative for a signal), stderr, and the most memory that was in use, bytes."""
        command = [self.nunetd, *self.command(kind, data)]
        with (self.folder / "stderr").open("w+b") as stderr, (self.folder / "stdin").open("w+b") as given:
            given.write(data if kind == "y4m" else b"")
            given.seek(0)
            process = subprocess.Popen(
                command,
                stdin=given,
                stdout=subprocess.DEVNULL,
                stderr=stderr,
                env=self.environment,
                preexec_fn=limited,
            )
            status, usage = wait(process)
            stderr.seek(0)
            return (
                os.waitstatus_to_exitcode(status),
                stderr.read().decode(errors="replace"),
                usage.ru_maxrss << 10,
            )


def runtime_library():
    """ONNX Runtime's library in this environment's own package."""
    package = pathlib.Path(importlib.util.find_spec("onnxruntime").origin).parent
    return next((package / "capi").glob("libonnxruntime.so.*"))


def limited():
    """Sets the soft limits only, because the child process of the model check sets its own."""
    resource.setrlimit(resource.RLIMIT_AS, (ADDRESS_SPACE, resource.RLIM_INFINITY))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def wait(process):
    """Waits with `wait4`, which returns the memory too.

    A process that does not end is killed, by a signal.
    """
    deadline = time.monotonic() + TIMEOUT_S
    while True:
        pid, status, usage = os.wait4(process.pid, os.WNOHANG)
        if pid:
            process.returncode = os.waitstatus_to_exitcode(status)
            return status, usage
        if time.monotonic() > deadline:
            process.send_signal(signal.SIGKILL)
            deadline += TIMEOUT_S
        time.sleep(0.005)


def damaged(whole, seed):
    """Each second copy is cut off; the others have a few bits, bytes and slices that are wrong."""
    chance = random.Random(seed)
    if seed % 2 == 0:
        return whole[: chance.randrange(len(whole))]
    data = bytearray(whole)
    # Headers and indices are at both ends; the rest is mostly pixels or weights.
    for _ in range(chance.randint(1, 4)):
        span = chance.choice([len(data), min(len(data), 512)])
        at = chance.randrange(span) if chance.random() < 0.7 else len(data) - 1 - chance.randrange(span)
        match chance.randrange(5):
            case 0 | 1:
                data[at] ^= 1 << chance.randrange(8)
            case 2:
                data[at] = chance.choice(b"\0\xff\x7f\x80[]{}\"'-.:9\n")
            case 3:
                number = chance.choice([0, 1, 2**64 - 1, 2**63 - 1, 2**32 - 1, 2**31]).to_bytes(8, "little")
                width = min(chance.choice([2, 4, 8]), len(data) - at)
                data[at : at + width] = number[:width]
            case _:
                del data[at : at + chance.randint(1, 16)]
    return bytes(data)


def problems_of(kind, code, stderr, peak):
    """Problems of how a run ended."""
    allowed = {0, 1, 2, 3} if kind in {"config", "calibration"} else {0, 1, 3}
    if code not in allowed:
        yield f"exit code {code}"
    if "panicked" in stderr:
        yield "a panic"
    if code == 1 and not stderr.startswith("error: ") and "\nerror: " not in stderr:
        yield "no word about what is wrong"
    if len(stderr) > 20_000:
        yield f"{len(stderr)} bytes of messages"
    if peak > PEAK_BYTES:
        yield f"{peak >> 20} MB"


def run_damaged(nunetd, folder, kind, whole):
    """Tries all copies of one kind; how they ended, the most memory, and what is wrong."""
    bench = Bench(nunetd, folder / kind)
    codes, most, problems = collections.Counter(), 0, []
    code, stderr, _ = bench.try_one(kind, whole)
    assert code == 0, f"the good {kind}: {stderr}"
    for seed in range(COPIES):
        code, stderr, peak = bench.try_one(kind, damaged(whole, seed))
        codes[code] += 1
        most = max(most, peak)
        found = problems_of(kind, code, stderr, peak)
        problems += [f"{kind}, seed {seed}: {what}\n{stderr[:1000]}" for what in found]
    return kind, dict(sorted(codes.items())), most, problems


def test_damaged_files_end_with_an_exit_code_in_time_and_in_bounds(nunetd, good, tmp_path):
    with concurrent.futures.ThreadPoolExecutor(os.cpu_count()) as pool:
        jobs = [pool.submit(run_damaged, nunetd, tmp_path, kind, whole) for kind, whole in good.items()]
        results = [job.result() for job in jobs]
    for kind, codes, most, _ in results:
        print(f"{kind:<12} exit codes {codes}, at most {most >> 20} MB")
    problems = [problem for *_, found in results for problem in found]
    assert not problems, f"{len(problems)} runs ended badly, the first:\n" + "\n".join(problems[:5])


def test_a_cut_recording_gives_every_image_before_the_cut(nunetd, good, tmp_path):
    """Not less than the format's own reader finds; it delivers whole chunks only."""
    bench = Bench(nunetd, tmp_path / "cut")
    chance = random.Random(2)
    for kind in ("mcap_png", "mcap_rgb", "mcap_json"):
        whole = good[kind]
        all_images = images(io.BytesIO(whole))
        assert all_images > 0, f"the reader finds no image in the whole {kind}"
        counts = set()
        # The last cut is within the footer: all images are before it.
        cuts = [chance.randrange(len(whole)) for _ in range(max(2, COPIES // 4))] + [len(whole) - 4]
        for cut in cuts:
            data = whole[:cut]
            code, stderr, _ = bench.try_one(kind, data)
            expected = images(io.BytesIO(data))
            counts.add(expected)
            found = 0
            if code in {0, 3} and (bench.folder / "out.mcap").exists():
                with (bench.folder / "out.mcap").open("rb") as file:
                    found = images(file, "/camera/depth/image_raw")
            assert found >= expected, f"{kind} cut to {len(data)} of {len(whole)} bytes: {stderr}"
        assert all_images in counts, f"{kind}: no cut left an image"


def images(file, topic=None):
    """The number of image messages that an independent reader finds before an error."""
    count = 0
    with contextlib.suppress(Exception):
        for _, channel, _ in NonSeekingReader(file).iter_messages(log_time_order=False):
            count += channel.topic == topic if topic else "image" in channel.topic
    return count


def bomb(path, payload):
    """A recording with one message of that many zeros, which compression makes small."""
    with path.open("wb") as file:
        writer = McapWriter(file, compression=CompressionType.ZSTD)
        writer.start()
        schema = writer.register_schema("sensor_msgs/msg/Image", "ros2msg", b"")
        channel = writer.register_channel("/image", "cdr", schema)
        writer.add_message(channel, log_time=7, publish_time=7, data=b"\0\1\0\0" + bytes(payload))
        writer.finish()
    return path.read_bytes()


def test_small_files_that_ask_for_much_memory_do_not_get_it(nunetd, tmp_path):
    bench = Bench(nunetd, tmp_path / "greedy")
    magic = b"\x89MCAP0\r\n"
    sides = np.array([20_000, 20_000], ">u4").tobytes()
    greedy = {
        "mcap_bomb": bomb(tmp_path / "bomb.mcap", 200 << 20),
        "mcap_claim": magic + b"\x05" + (255 << 20).to_bytes(8, "little") + b"x",
        "mcap_endless": magic + b"\x05" + (2**64 - 1).to_bytes(8, "little") + b"x",
        "png": image_file("png").replace(image_file("png")[16:24], sides),
        "y4m": b"YUV4MPEG2 W32768 H32768 F25:1 C444\nFRAME\nx",
        "config": b"a = " + b"[" * 200_000,
        "calibration": b"a: " + b"[" * 60_000,
        "sidecar": b"a = " + b"[" * 60_000,
        "manifest": b"a" * (1 << 20),
    }
    for kind, data in greedy.items():
        code, stderr, peak = bench.try_one(kind, data)
        assert not list(problems_of(kind, code, stderr, peak)), (
            f"{kind}: {code}, {peak >> 20} MB\n{stderr[:2000]}"
        )
        assert code != 0 or kind == "mcap_bomb", kind
        assert peak < 700 << 20, f"{kind}: {peak >> 20} MB for {len(data)} bytes"
