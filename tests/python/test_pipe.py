"""Images on stdin: those that `ffmpeg` writes, if it is installed,
and the same formats written by this test.
"""

import io
import json
import os
import shutil
import subprocess

import numpy as np
import pytest
from conftest import MODEL
from PIL import Image

SIZE = (64, 48)
FRAMES = 12


def y4m():
    """A gray ramp that moves, as 4:2:0 with neutral chroma."""
    width, height = SIZE
    images = [b"YUV4MPEG2 W%d H%d F25:1 Ip A1:1 C420jpeg\n" % SIZE]
    for index in range(FRAMES):
        luma = (np.arange(width)[None] * 2 + np.arange(height)[:, None] + 5 * index).astype(np.uint8)
        images += [b"FRAME\n", luma.tobytes(), b"\x80" * (width * height // 2)]
    return b"".join(images)


def run(nunetd, tmp_path, given, *more):
    """Exit code, stderr and stats of a run that reads `given` from stdin."""
    stats, name = tmp_path / "stats.json", f"pytest-pipe-{os.getpid()}"
    source = [] if "--source" in more else ["--source", "-"]
    command = [nunetd, "--model", str(MODEL), *source, "--camera", name, "--stats-json", str(stats), *more]
    done = subprocess.run(command, check=False, input=given, capture_output=True, timeout=60)
    return done.returncode, done.stderr.decode(), json.loads(stats.read_text()) if stats.exists() else None


def test_every_image_of_a_y4m_stream_is_taken(nunetd, tmp_path):
    code, stderr, stats = run(nunetd, tmp_path, y4m(), "--out", str(tmp_path / "out"))
    assert code == 0, stderr
    assert (stats["frames"]["captured"], stats["frames"]["published"]) == (FRAMES, FRAMES)
    assert np.isfinite(np.load(tmp_path / "out" / "depth.npy")).any()


def test_raw_images_need_a_size_and_a_format(nunetd, tmp_path):
    raw = bytes(3 * SIZE[0] * SIZE[1] * 4)
    code, stderr, stats = run(nunetd, tmp_path, raw, "--size", "64x48", "--format", "rgb8")
    assert (code, stats["frames"]["published"]) == (0, 4), stderr
    code, stderr, _ = run(nunetd, tmp_path, raw, "--size", "64x48")
    assert code == 2 and "a size without a format" in stderr


def jpegs():
    """JPEGs one after the other, each of one gray."""
    file = io.BytesIO()
    for index in range(FRAMES):
        Image.new("RGB", SIZE, (20 * index,) * 3).save(file, "JPEG")
    return file.getvalue()


def test_every_jpeg_of_a_stream_is_taken(nunetd, tmp_path):
    code, stderr, stats = run(nunetd, tmp_path, jpegs())
    assert (code, stats["frames"]["published"]) == (0, FRAMES), stderr


@pytest.mark.parametrize("stream", [y4m(), jpegs()], ids=["y4m", "jpegs"])
def test_a_command_is_a_camera_and_is_started_again(nunetd, tmp_path, stream):
    (tmp_path / "stream").write_bytes(stream)
    source = [
        "--source",
        f"exec:echo end of file >&2; cat {tmp_path / 'stream'}",
        "--frames",
        str(FRAMES + 4),
    ]
    code, stderr, stats = run(nunetd, tmp_path, b"", *source)
    assert code == 0 and stats["frames"]["captured"] >= FRAMES + 4, stderr
    assert "it ended with exit code 0: end of file" in stderr


def test_a_command_that_cannot_be_run_is_an_error_with_the_reason(nunetd, tmp_path):
    code, stderr, _ = run(nunetd, tmp_path, b"", "--source", "exec:/nonexistent/program -o -")
    assert code == 1 and "cannot run command `/nonexistent/program -o -`" in stderr and "hint: " in stderr, (
        stderr
    )


@pytest.mark.parametrize(
    ("given", "code", "part"),
    [
        (y4m()[:-7], 3, f"standard input ended within image {FRAMES}"),
        (b"RIFF\x00\x00\x00\x00AVI LIST", 1, "does not begin with `YUV4MPEG2`"),
        (b"YUV4MPEG2 W64 H48 F25:1 It C420\n", 1, "interlaced"),
        (b"YUV4MPEG2 W64 H48 F25:1 C420p10\n", 1, "`C420p10`, a color space that cannot be read"),
        (b"YUV4MPEG2", 1, "it ended before the header did"),
        (b"", 1, "standard input ended before its first image"),
    ],
)
def test_a_bad_stream_is_an_error_with_the_reason(nunetd, tmp_path, given, code, part):
    got, stderr, _ = run(nunetd, tmp_path, given)
    assert got == code and part in stderr, stderr


@pytest.mark.skipif(
    shutil.which("ffmpeg") is None, reason="ffmpeg is not installed; the stream by hand is tried above"
)
@pytest.mark.parametrize("pixels", ["yuv420p", "yuv422p", "yuv444p", "gray"])
def test_ffmpeg_pipes_a_video_in(nunetd, tmp_path, pixels):
    source = ["-f", "lavfi", "-i", "testsrc2=size=322x241:rate=30", "-frames:v", "15", "-pix_fmt", pixels]
    ffmpeg = ["ffmpeg", "-loglevel", "error", *source, "-f", "yuv4mpegpipe", "-"]
    video = subprocess.run(ffmpeg, check=True, capture_output=True, timeout=60).stdout
    code, stderr, stats = run(nunetd, tmp_path, video)
    assert (code, stats["frames"]["published"]) == (0, 15), stderr
