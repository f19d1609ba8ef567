"""Models in this process: inputs, results and errors."""

import json
import re
import shutil
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import nunet_py as nunet
import pytest
from PIL import Image
from support import ONE_THREAD, RECURRENT, ROOM, ROOT, TINY, hint_of, model, noise, run_python

HINT = re.compile(r"\nhint: \S")


def test_a_bundled_model_gives_meters_labels_and_points_of_a_room():
    net = nunet.Model("wnet_c.onnx", provider="cpu")
    assert (net.size, net.architecture, net.trained, net.provider) == ((640, 480), "wnet_c", True, "cpu")
    assert net.path.is_file()
    rgb = np.asarray(Image.open(ROOM))
    camera = nunet.Camera(fx=518.9, fy=519.5, cx=325.6, cy=253.7, size=(640, 480))
    result = net.infer(rgb, camera=camera)
    assert (result.depth.shape, result.depth.dtype) == ((480, 640), np.float32)
    assert 0.5 < np.nanmedian(result.depth) < 10, "a bedroom is some meters deep"
    assert (result.labels.shape, result.labels.dtype) == ((480, 640), np.uint8)
    assert result.labels.max() < len(result.class_names) and "floor" in result.class_names
    assert (result.units, result.scale_source) == ("metre", "focal_scaled")
    assert (result.camera, result.rgb.tobytes()) == (camera, rgb.tobytes())
    assert result.invalid_pixels == np.count_nonzero(np.isnan(result.depth))
    cloud = result.cloud()
    assert (cloud.points.shape, cloud.points.dtype) == ((480, 640, 3), np.float32)
    assert cloud.points[..., 2].tobytes() == result.depth.tobytes()
    assert (cloud.colors == result.rgb).all() and (cloud.labels == result.labels).all()
    assert cloud.valid().shape == (480 * 640 - result.invalid_pixels, 3)


def test_points_beyond_the_range_have_no_coordinates(tiny):
    result = tiny.infer(noise(*tiny.size[::-1]))
    points = result.cloud().points
    distance = np.linalg.norm(points, axis=2)
    limit = float(np.nanmedian(distance))
    limited = result.cloud(max_range=limit).points
    beyond = ~(distance <= limit)
    close = np.isclose(distance, limit, rtol=1e-5)  # rounded another way here than there
    assert np.isnan(limited[beyond & ~close]).all() and beyond.mean() > 0.3
    assert (limited[~beyond & ~close] == points[~beyond & ~close]).all()
    for endless in [None, float("inf")]:
        assert result.cloud(max_range=endless).points.tobytes() == points.tobytes()
    for wrong in [0, -1.0, float("nan")]:
        with pytest.raises(ValueError, match=r"`max_range` is .*; expected a distance") as error:
            result.cloud(max_range=wrong)
        hint_of(error)
    with pytest.raises(TypeError, match="`max_range` is `'far'`"):
        result.cloud(max_range="far")


def test_a_bundled_model_is_found_from_every_folder_and_a_bare_name_may_lack_its_ending(tmp_path):
    code = "import nunet_py; print(nunet_py.Model('wnet_c').path)"
    done = subprocess.run(
        [sys.executable, "-c", code], check=True, capture_output=True, text=True, cwd=tmp_path
    )
    assert done.stdout.strip().endswith("wnet_c.onnx")


def test_an_image_of_the_networks_size_is_not_copied_and_any_other_is_resized(tiny):
    width, height = tiny.size
    for size in [(height, width), (2 * height, 2 * width), (7, 5), (1, 1), (300, 1000)]:
        result = tiny.infer(noise(*size))
        assert result.depth.shape == result.labels.shape == result.rgb.shape[:2] == (height, width)
        assert list(result.timings) == ["preprocess", "network", "decode", "cloud", "total"]
        assert result.timings["total"] >= result.timings["network"] > 0
    rgb = noise(height, width)
    assert tiny.infer(rgb).rgb.tobytes() == rgb.tobytes()


def test_results_own_their_memory(tiny):
    first, second = (tiny.infer(noise(96, 128, seed)) for seed in (1, 2))
    kept = first.depth.copy()
    assert not np.shares_memory(first.depth, second.depth)
    second.depth[:] = 0
    del second
    tiny.infer(noise(96, 128, 3))
    assert first.depth.tobytes() == kept.tobytes()
    assert first.depth.flags.c_contiguous and first.depth.flags.writeable


def test_without_a_camera_meters_are_those_of_the_training_camera_and_a_camera_scales_them(tiny):
    rgb = noise(96, 128)
    assumed = tiny.infer(rgb)
    assert (assumed.scale_source, assumed.camera) == ("assumed_camera", None)
    training = tiny.metadata["camera"]
    fx = training["fx"] * 128 / training["width"]
    scaled = tiny.infer(rgb, camera=nunet.Camera(2 * fx, 2 * fx, 63.5, 47.5, (128, 96)))
    assert scaled.scale_source == "focal_scaled"
    np.testing.assert_allclose(scaled.depth, 2 * assumed.depth, rtol=1e-6)
    assert tiny.infer(rgb).depth.tobytes() == assumed.depth.tobytes(), "a camera is for its image alone"


def test_a_camera_of_another_size_fits_and_one_of_another_shape_does_not(tiny):
    rgb = noise(480, 640)
    small = nunet.Camera(260, 260, 160, 120, (320, 240))
    assert tiny.infer(rgb, camera=small).camera.fx == pytest.approx(260 * 128 / 320)
    with pytest.raises(nunet.CameraError, match=r"320x320.*640x480.*\nhint: "):
        tiny.infer(rgb, camera=nunet.Camera(260, 260, 160, 160, (320, 320)))
    with pytest.raises(TypeError, match=r"`camera` is .* expected a Camera") as error:
        tiny.infer(rgb, camera=(260, 260, 160, 120))
    hint_of(error)


BAD_IMAGES = {
    "none": (lambda rgb: None, TypeError, "cv2.imread"),
    "bytes": (lambda rgb: rgb.tobytes(), TypeError, "io.BytesIO(rgb)"),
    "bytearray": (lambda rgb: bytearray(rgb.tobytes()), TypeError, "io.BytesIO(rgb)"),
    "16 bits": (lambda rgb: rgb.astype(np.uint16), TypeError, "(rgb >> 8).astype(np.uint8)"),
    "PIL of 16 bits": (lambda rgb: Image.fromarray(rgb[..., 0].astype(np.uint16)), TypeError, "mode `RGB`"),
    "list": (lambda rgb: rgb.tolist(), TypeError, "np.asarray(rgb)"),
    "float": (lambda rgb: rgb / np.float32(255), TypeError, "astype(np.uint8)"),
    "int64": (lambda rgb: rgb.astype(np.int64), TypeError, "astype(np.uint8)"),
    "bool": (lambda rgb: rgb > 0, TypeError, "astype(np.uint8)"),
    "object": (lambda rgb: rgb.astype(object), TypeError, "astype(np.uint8)"),
    "gray": (lambda rgb: rgb[..., 0].copy(), ValueError, "np.repeat(rgb[..., None], 3, axis=2)"),
    "gray with an axis": (lambda rgb: rgb[..., :1].copy(), ValueError, "np.repeat(rgb, 3, axis=2)"),
    "alpha": (lambda rgb: np.dstack([rgb, rgb[..., 0]]), ValueError, "`rgb[..., :3]`"),
    "channels first": (lambda rgb: rgb.transpose(2, 0, 1).copy(), ValueError, "rgb.transpose(1, 2, 0)"),
    "batch": (lambda rgb: rgb[None], ValueError, "rgb[0]"),
    "scalar": (lambda rgb: np.zeros((), np.uint8), ValueError, "expected (H, W, 3)"),
    "empty": (lambda rgb: rgb[:0], ValueError, "32768"),
    "huge": (lambda rgb: np.zeros((1, 32769, 3), np.uint8), ValueError, "32768"),
}


@pytest.mark.parametrize("change, kind, words", BAD_IMAGES.values(), ids=BAD_IMAGES)
def test_an_object_that_is_not_an_image_is_refused_with_a_fix(tiny, change, kind, words):
    with pytest.raises(kind) as raised:
        tiny.infer(change(noise(96, 128)))
    assert words in hint_of(raised)
    assert tiny.infer(noise(96, 128)).depth.shape == (96, 128), "the model works on"


def test_a_read_only_image_is_accepted(tiny):
    rgb = noise(96, 128)
    expected = tiny.infer(rgb).depth
    rgb.flags.writeable = False
    assert tiny.infer(rgb).depth.tobytes() == expected.tobytes()


def test_bad_models_raise_the_exception_of_their_kind(tmp_path):
    (tmp_path / "half.onnx").write_bytes(TINY.read_bytes()[:50_000])
    (tmp_path / "empty.onnx").touch()
    manifest = TINY.with_suffix(".toml").read_text().replace("segmentation.logits", "segmentation.nothing")
    for part in ("segmentation", "depth"):
        shutil.copy(TINY.with_name(f"tiny_wnet_c.{part}.onnx"), tmp_path)
    (tmp_path / "staged.toml").write_text(manifest)
    for name, kind, words in [
        ("missing.onnx", FileNotFoundError, r"missing\.onnx"),
        ("half.onnx", nunet.ModelError, r"half\.onnx"),
        ("empty.onnx", nunet.ModelError, r"empty\.onnx"),
        ("staged.toml", nunet.WiringError, "segmentation"),
    ]:
        with pytest.raises(kind, match=words):
            nunet.Model(tmp_path / name)
    with pytest.raises(FileNotFoundError, match=r"\nhint: .*wnet_c\.onnx"):
        nunet.Model("wnet_d")
    assert issubclass(nunet.ModelError, nunet.NunetError) and issubclass(nunet.WiringError, nunet.NunetError)


def test_invalid_options_are_refused():
    with pytest.raises(ValueError, match=r"`provider` is `gpu`; .*\nhint: pass one of auto, cpu, openvino"):
        nunet.Model(TINY, provider="gpu")
    with pytest.raises(ValueError, match="`provider` is `gpu`") as error:
        nunet.Model(TINY, provider="gpu`\nhint: none")
    assert len(hint_of(error).splitlines()) == 2 and error.value.hint.startswith("pass one of")
    for threads in (0, -1):
        with pytest.raises(ValueError, match=f"`threads` is `{threads}`; expected 1 or more\nhint: "):
            nunet.Model(TINY, threads=threads)
    with pytest.raises(nunet.NunetError, match="`cuda`"):
        nunet.Model(TINY, provider="cuda")
    for name in (None, 3, b"\0"):
        with pytest.raises((TypeError, ValueError, OSError)) as error:
            nunet.Model(name)
        hint_of(error)


def test_untrained_weights_cause_a_warning():
    with pytest.warns(UserWarning, match="untrained weights"):
        nunet.Model(TINY, **ONE_THREAD)


def test_a_staged_graph_runs_as_the_fused_file(tiny):
    staged = model(TINY.with_suffix(".toml"))
    rgb = noise(96, 128)
    fused, parts = tiny.infer(rgb), staged.infer(rgb)
    assert list(parts.timings)[1:3] == ["segmentation", "depth"]
    np.testing.assert_allclose(parts.depth, fused.depth, rtol=1e-5)


def test_a_recurrent_network_keeps_its_state_only_with_keep_state():
    net = model(RECURRENT)
    images = [noise(96, 128, seed) for seed in range(3)]
    alone = [net.infer(rgb).depth.tobytes() for rgb in images]
    assert [net.infer(rgb).depth.tobytes() for rgb in images] == alone
    stream = [net.infer(rgb, keep_state=bool(index)).depth.tobytes() for index, rgb in enumerate(images)]
    assert stream[0] == alone[0] and stream[1] != alone[1] and stream[2] != alone[2]


def test_metadata_is_what_inspect_prints(nunetd, tiny):
    command = [nunetd, "inspect", "--json", str(TINY), "--provider", "cpu"]
    done = subprocess.run(command, check=True, capture_output=True)
    assert tiny.metadata == json.loads(done.stdout)


def test_one_model_serves_several_threads_and_each_gets_its_own_answer(tiny):
    images = [noise(96, 128, seed) for seed in range(4)]
    expected = [tiny.infer(rgb).depth.tobytes() for rgb in images]
    wrong = []

    def work(index):
        for _ in range(25):
            if tiny.infer(images[index]).depth.tobytes() != expected[index]:
                wrong.append(index)

    threads = [threading.Thread(target=work, args=(index,)) for index in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not wrong


def test_other_threads_run_while_an_image_is_inferred():
    code = """
        import sys, threading, numpy as np, nunet_py as nunet
        net, inferring, ticks = nunet.Model("wnet_c", provider="cpu", threads=1), threading.Event(), []
        rgb = np.zeros((480, 640, 3), np.uint8)
        def tick():
            while not inferring.is_set():
                ticks.append(0)
                inferring.wait(0.001)
        sys.setswitchinterval(1000)   # nobody is interrupted: only who lets go of the GIL lets others run
        thread = threading.Thread(target=tick)
        thread.start()
        before = len(ticks)
        net.infer(rgb)
        during = len(ticks) - before
        inferring.set()
        print(during)
    """
    done = run_python(code)
    assert done.returncode == 0, done.stderr
    assert int(done.stdout) > 1


def test_a_model_does_not_survive_a_fork_and_says_so():
    code = f"""
        import os, numpy as np, nunet_py as nunet
        net = nunet.Model({str(TINY)!r}, provider="cpu", threads=2)
        rgb = np.zeros((96, 128, 3), np.uint8)
        net.infer(rgb)
        child = os.fork()
        if child == 0:
            try:
                net.infer(rgb)
            except nunet.NunetError as error:
                print(error, net.size, flush=True)
                del net   # must not wait for threads that are not here
                os._exit(7)
            os._exit(0)
        assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 7
        net.infer(rgb)
    """
    done = run_python(code)
    assert done.returncode == 0, done.stderr
    assert "a fork of it" in done.stdout and HINT.search(done.stdout)


def test_an_interpreter_ends_cleanly_with_live_results_and_a_running_thread():
    code = f"""
        import threading, numpy as np, nunet_py as nunet
        net = nunet.Model({str(TINY)!r}, provider="cpu")
        rgb = np.zeros((96, 128, 3), np.uint8)
        depth, cloud = net.infer(rgb).depth[10:20], net.infer(rgb).cloud().points
        started = threading.Event()
        def work():
            while True:
                net.infer(rgb)
                started.set()
        threading.Thread(target=work, daemon=True).start()
        started.wait()
        print(depth.shape)
    """
    for _ in range(5):
        done = run_python(code)
        assert (done.returncode, done.stdout, done.stderr) == (0, "(10, 128)\n", "")


def test_a_thousand_images_leak_neither_memory_nor_references():
    code = f"""
        import gc, os, sys, numpy as np, nunet_py as nunet
        net = nunet.Model({str(TINY)!r}, provider="cpu", threads=1)
        images = [np.full((96, 128, 3), value, np.uint8) for value in range(5)]
        camera = nunet.Camera(128, 128, 64, 48, (128, 96))
        def resident():
            with open("/proc/self/statm") as file:
                return int(file.read().split()[1]) * os.sysconf("SC_PAGESIZE")
        def work(count):
            for index in range(count):
                result = net.infer(images[index % 5], camera=camera if index % 2 else None)
                result.cloud().valid()
                nunet.colorize(result.depth)
                try:
                    net.infer(images[0][0])
                except ValueError:
                    pass
        work(200)
        gc.collect()
        before, counts = resident(), [sys.getrefcount(x) for x in (net, camera, *images, net.class_names)]
        objects = len(gc.get_objects())
        work(1000)
        gc.collect()
        after = [sys.getrefcount(x) for x in (net, camera, *images, net.class_names)]
        assert after == counts, (counts, after)
        assert len(gc.get_objects()) - objects < 50
        print(resident() - before)
    """
    done = run_python(code)
    assert done.returncode == 0, done.stderr
    # An image's results take 0.4 MB: a leak of one in a hundred would show.
    assert int(done.stdout) < 2_000_000


def test_reprs_describe_their_objects(tiny):
    assert repr(tiny).startswith("Model('") and "untrained" in repr(tiny) and "128x96" in repr(tiny)
    result = tiny.infer(noise(96, 128))
    assert repr(result).startswith("Result(128x96, units='metre', scale_source='assumed_camera'")
    assert repr(result.cloud()) == "Cloud(128x96 points)"


def test_the_bundled_models_are_those_of_the_repository():
    folder = Path(nunet.__file__).parent / "models"
    bundled = {path.name: path.read_bytes() for path in folder.glob("*.onnx")}
    assert set(bundled) == {"wnet_c.onnx", "unet.onnx"}
    for name, content in bundled.items():
        assert content == (ROOT / "models" / name).read_bytes(), name
