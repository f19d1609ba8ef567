"""Results in colors, as plots and for Open3D."""

import subprocess
import sys
import types

import numpy as np
import nunet_py as nunet
import pytest
from PIL import Image
from support import ON_THE_COMMAND_LINE, TINY, hint_of, model, noise, run_python

GRAY = (150, 150, 150)


@pytest.fixture(scope="module")
def result():
    return model().infer(noise(96, 128))


def test_colors_are_those_of_nunetds_depth_image(nunetd, result, tmp_path):
    Image.fromarray(noise(96, 128)).save(tmp_path / "noise.png")
    command = [
        nunetd,
        "-q",
        "infer",
        str(tmp_path / "noise.png"),
        "--out",
        str(tmp_path),
        "--model",
        str(TINY),
    ]
    subprocess.run([*command, *ON_THE_COMMAND_LINE], check=True)
    drawn = np.asarray(Image.open(tmp_path / "depth.png").convert("RGB"))
    colored = nunet.colorize(result.depth)
    assert (colored.shape, colored.dtype) == ((96, 128, 3), np.uint8)
    assert (colored == drawn[:, :128]).all()


def test_near_is_red_far_is_blue_and_no_depth_is_gray():
    depth = np.array([[1.0, 3.0, np.nan, np.inf]], np.float32)
    red, blue, none, endless = nunet.colorize(depth, near=0.8, far=3.2)[0]
    assert red[0] > red[2] and blue[2] > blue[0]
    assert tuple(none) == tuple(endless) == GRAY


def test_a_fixed_range_gives_one_depth_one_color_in_every_map():
    first, second = (np.linspace(1, end, 64, dtype=np.float32).reshape(8, 8) for end in (2, 9))
    colors = [nunet.colorize(depth, near=0, far=10)[0, 0] for depth in (first, second)]
    assert (colors[0] == colors[1]).all()
    assert (nunet.colorize(first, near=-5.0)[0, 0] != nunet.colorize(first)[0, 0]).any(), (
        "one end alone may be given"
    )


BAD = {
    "list": ([[1.0]], {}, TypeError, r"np.asarray\(depth\)"),
    "double": (np.ones((2, 2)), {}, TypeError, "astype\\(np.float32\\)"),
    "millimeters": (np.ones((2, 2), np.uint16), {}, TypeError, "depth / 1000"),
    "axis": (np.ones((1, 2, 2), np.float32), {}, ValueError, "squeeze"),
    "empty": (np.ones((0, 2), np.float32), {}, ValueError, "which is empty"),
    "packed": (np.ones(9, "u1, (2, 2)<f4")["f1"][0], {}, ValueError, r"not aligned.*\n.*depth.copy\(\)"),
    "near as a word": (np.ones((2, 2), np.float32), dict(near="1"), TypeError, "`near` is `'1'`"),
    "near beyond all": (np.ones((2, 2), np.float32), dict(near=100.0), ValueError, "`far` of the map is `1`"),
    "far before all": (np.ones((2, 2), np.float32), dict(far=0.5), ValueError, "`near` of the map is `1`"),
    "mirrored": (np.ones((2, 2), np.float32)[:, ::-1], {}, ValueError, "ascontiguousarray"),
    "no range": (
        np.ones((2, 2), np.float32),
        dict(near=2, far=2),
        ValueError,
        "expected `far` beyond `near`",
    ),
    "endless": (np.ones((2, 2), np.float32), dict(far=float("inf")), ValueError, "finite"),
}


@pytest.mark.parametrize("depth, ends, kind, words", BAD.values(), ids=BAD)
def test_an_invalid_depth_map_is_refused_with_a_fix(depth, ends, kind, words):
    with pytest.raises(kind, match=words) as error:
        nunet.colorize(depth, **ends)
    hint_of(error)


@pytest.mark.parametrize("ends", [{}, {"near": 100.0}, {"far": -3.0}])
def test_a_map_without_depth_is_gray_for_every_range(ends):
    assert (nunet.colorize(np.full((2, 2), np.nan, np.float32), **ends) == GRAY).all()


def test_a_plot_shows_image_depth_and_the_names_of_the_labels(result, tmp_path):
    figure = result.plot()
    titles = [axes.get_title() for axes in figure.axes]
    assert titles[:3] == ["image", "depth (assumed_camera)", "labels"]
    assert figure.axes[3].get_ylabel() == "meters"
    shown = figure.axes[1].images[0].get_array()
    assert np.ma.filled(shown, np.nan).tobytes() == result.depth.tobytes()
    legend = [text.get_text() for text in figure.axes[2].get_legend().get_texts()]
    assert legend == [result.class_names[index] for index in np.unique(result.labels)]
    figure.savefig(tmp_path / "plot.png")
    assert Image.open(tmp_path / "plot.png").size[0] > 1000


def test_a_plot_needs_neither_window_nor_display():
    code = f"""
        import numpy as np, nunet_py as nunet, sys
        nunet.Model({str(TINY)!r}).infer(np.zeros((96, 128, 3), np.uint8)).plot()
        print("matplotlib.pyplot" in sys.modules)
    """
    done = run_python(code)
    assert (done.returncode, done.stdout) == (0, "False\n"), done.stderr


def open3d_stand_in():
    """The part of open3d that is called:
    open3d has no wheel for every Python and takes hundreds of megabytes.
    """
    module = types.ModuleType("open3d")
    module.geometry = types.SimpleNamespace(PointCloud=types.SimpleNamespace)

    def vector(values):
        assert values.dtype == np.float64 and values.ndim == 2 and values.shape[1] == 3, (
            "what Vector3dVector takes"
        )
        return values

    module.utility = types.SimpleNamespace(Vector3dVector=vector)
    return module


def test_open3d_gets_the_valid_points_with_their_colors(result, monkeypatch):
    monkeypatch.setitem(sys.modules, "open3d", open3d_stand_in())
    cloud = result.cloud()
    valid = np.isfinite(cloud.points[..., 2])
    for points in (result.to_open3d(), cloud.to_open3d()):
        assert (points.points == cloud.valid()).all()
        assert (np.rint(points.colors * 255) == cloud.colors[valid]).all()


@pytest.mark.parametrize("package, call", [("matplotlib", "plot"), ("open3d", "to_open3d")])
def test_a_missing_optional_package_is_named(result, monkeypatch, package, call):
    monkeypatch.setitem(sys.modules, package, None)
    monkeypatch.delitem(sys.modules, "nunet_py._plot", raising=False)
    with pytest.raises(ImportError, match=f"`{call}` needs the package {package}\n") as error:
        getattr(result, call)()
    assert f"`pip install {package}`" in hint_of(error)
