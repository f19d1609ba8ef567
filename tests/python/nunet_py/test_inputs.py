"""Everything that `infer` accepts as an image, several images at once, and filters."""

import io
import warnings

import numpy as np
import nunet_py as nunet
import pytest
from PIL import Image
from support import ONE_THREAD, RECURRENT, ROOM, TINY, hint_of, model, noise


@pytest.fixture(scope="module")
def rgb():
    return noise(96, 128)


def depth_of(result):
    """The bytes of a depth map."""
    return result.depth.tobytes()


def record(rows, columns):
    """An image in one field of packed records."""
    packed = np.zeros((rows, columns), "u1, (3,)u1")
    packed["f1"] = noise(rows, columns)
    return packed["f1"]


def test_a_file_of_ten_bits_in_sixteen_causes_one_warning(tmp_path):
    tiny = model()
    for name in ["a.png", "b.png"]:
        Image.fromarray(np.full((96, 128), 1023, np.uint16)).save(tmp_path / name)
    with pytest.warns(UserWarning, match="almost black: at most 1023 of 65535\nhint: scale the values"):
        tiny.infer(tmp_path / "a.png")
    with warnings.catch_warnings():
        warnings.simplefilter("error", UserWarning)
        tiny.infer(tmp_path / "b.png")


STRIDED = {
    "upside down": lambda rgb: rgb[::-1],
    "mirrored": lambda rgb: rgb[:, ::-1],
    "channels reversed": lambda rgb: rgb[..., ::-1],
    "every second": lambda rgb: rgb[::2, ::2],
    "fortran": np.asfortranarray,
    "channels of four": lambda rgb: np.dstack([rgb, rgb[..., 0]])[..., :3],
    "transposed": lambda rgb: rgb.transpose(1, 0, 2),
    "channels moved": lambda rgb: np.ascontiguousarray(rgb.transpose(2, 0, 1)).transpose(1, 2, 0),
    "repeated gray": lambda rgb: np.broadcast_to(rgb[..., :1], rgb.shape),
    "packed records": lambda rgb: record(96, 128),
}


@pytest.mark.parametrize("change", STRIDED.values(), ids=STRIDED)
def test_an_array_with_any_strides_is_read(tiny, rgb, change):
    strided = change(rgb)
    result = tiny.infer(strided)
    assert depth_of(result) == depth_of(tiny.infer(np.ascontiguousarray(strided)))
    if strided.shape == rgb.shape:
        assert (result.rgb == strided).all()


def test_bgr_arrays_are_read_with_color_bgr(tiny, rgb):
    expected = tiny.infer(rgb)
    for bgr in (rgb[..., ::-1], np.ascontiguousarray(rgb[..., ::-1])):
        result = tiny.infer(bgr, color="bgr")
        assert depth_of(result) == depth_of(expected) and (result.rgb == rgb).all()
    assert depth_of(tiny.infer(rgb, color="bgr")) != depth_of(expected)
    with pytest.raises(ValueError, match="`color` is `RGB`; expected `rgb` or `bgr`") as error:
        tiny.infer(rgb, color="RGB")
    hint_of(error)
    with pytest.raises(TypeError, match="`color` is `None`") as error:
        tiny.infer(rgb, color=None)
    hint_of(error)


def test_a_file_is_read_by_its_path(tiny, rgb, tmp_path):
    path = tmp_path / "room.png"
    Image.fromarray(rgb).save(path)
    expected = tiny.infer(rgb)
    for named in (path, str(path)):
        result = tiny.infer(named, color="bgr")
        assert depth_of(result) == depth_of(expected), "a file knows its channel order"
    assert tiny.infer(ROOM).depth.shape == (96, 128)


def test_a_turned_photograph_is_set_upright(tiny, tmp_path):
    path = tmp_path / "turned.png"
    exif = Image.Exif()
    exif[0x0112] = 3  # turned by 180 degrees
    Image.fromarray(noise(96, 128)).save(path, exif=exif)
    assert (tiny.infer(path).rgb == noise(96, 128)[::-1, ::-1]).all()


def test_unreadable_files_raise_the_exception_of_their_kind(tiny, tmp_path):
    with pytest.raises(FileNotFoundError, match=r"missing\.jpg"):
        tiny.infer(tmp_path / "missing.jpg")
    text = tmp_path / "text.jpg"
    text.write_text("not an image")
    with pytest.raises(nunet.NunetError, match=r"text\.jpg") as error:
        tiny.infer(text)
    hint_of(error)
    with pytest.raises(nunet.NunetError):
        tiny.infer(tmp_path)
    cut = tmp_path / "cut.jpg"
    cut.write_bytes(ROOM.read_bytes()[:5000])
    with pytest.raises(nunet.NunetError, match=r"cut\.jpg"):
        tiny.infer(cut)


@pytest.mark.parametrize("mode", ["RGB", "RGBA", "L", "P", "1", "CMYK", "LA"])
def test_a_pil_image_of_8_bits_is_read_in_every_mode(tiny, rgb, mode):
    image = Image.fromarray(rgb).convert(mode)
    assert depth_of(tiny.infer(image)) == depth_of(tiny.infer(np.asarray(image.convert("RGB"))))


@pytest.mark.parametrize("mode", ["I", "F", "I;16"])
def test_a_pil_image_of_more_bits_is_refused(tiny, rgb, mode):
    image = Image.fromarray(rgb[..., 0]).convert("I").convert(mode)
    with pytest.raises(TypeError, match=f"mode `{mode}`; expected 8 bits per channel") as error:
        tiny.infer(image)
    hint_of(error)


def test_a_pil_image_that_is_still_a_file_is_read(tiny):
    assert tiny.infer(Image.open(io.BytesIO(ROOM.read_bytes()))).depth.shape == (96, 128)


def test_a_model_can_be_called(tiny, rgb):
    camera = nunet.Camera(128, 128, 64, 48, (128, 96))
    expected = tiny.infer(rgb, camera=camera)
    called = tiny(rgb[..., ::-1], camera=camera, color="bgr", keep_state=True)
    assert depth_of(called) == depth_of(expected) and called.camera == camera


def test_a_batch_gives_a_result_for_each_image(tiny, tmp_path):
    arrays = [noise(96, 128, seed) for seed in range(3)]
    expected = [depth_of(tiny.infer(array)) for array in arrays]
    path = tmp_path / "last.png"
    Image.fromarray(arrays[2]).save(path)
    for images in (arrays, np.stack(arrays), iter(arrays), (arrays[0], Image.fromarray(arrays[1]), path)):
        assert [depth_of(result) for result in tiny.infer_batch(images)] == expected
    assert tiny.infer_batch([]) == []
    bgr = tiny.infer_batch([array[..., ::-1] for array in arrays], color="bgr")
    assert [depth_of(result) for result in bgr] == expected


def test_a_batch_may_be_a_video(rgb):
    net = model(RECURRENT)
    images = [noise(96, 128, seed) for seed in range(3)]
    alone = [depth_of(net.infer(image)) for image in images]
    stream = [depth_of(net.infer(image, keep_state=index > 0)) for index, image in enumerate(images)]
    assert [depth_of(result) for result in net.infer_batch(images)] == alone
    for _ in range(2):
        assert [depth_of(result) for result in net.infer_batch(images, keep_state=True)] == stream


def test_a_batch_says_which_image_is_wrong_and_refuses_a_single_one(tiny, rgb, tmp_path):
    with pytest.raises(TypeError, match="uint8") as error:
        tiny.infer_batch([rgb, rgb / 255])
    hint_of(error)
    if hasattr(error.value, "__notes__"):
        assert error.value.__notes__ == ["image 1 of the batch"]
    for single in (rgb, tmp_path / "a.png", "a.png", Image.fromarray(rgb), None):
        with pytest.raises(TypeError, match=r"`images` is a single .*; expected several images") as error:
            tiny.infer_batch(single)
        hint_of(error)


def test_filters_are_written_as_on_the_command_line(rgb):
    net = model(filters=["temporal", "spatial=alpha:0.4"])
    assert net.filters == (
        "spatial=magnitude:2,alpha:0.4,delta:0.02,fill:0",
        "temporal=alpha:0.4,delta:0.02,persistence:3",
    )
    assert model().filters == () and model(filters=None).filters == () and model(filters=[]).filters == ()
    plain, filtered = model().infer(rgb), net.infer(rgb)
    assert depth_of(plain) != depth_of(filtered)
    assert list(filtered.timings)[2:5] == ["decode", "spatial", "temporal"]


def test_decimation_makes_every_array_smaller(rgb):
    camera = nunet.Camera(128, 128, 63.5, 47.5, (128, 96))
    net = model(filters="decimation=2")
    result = net.infer(rgb, camera=camera)
    assert net.size == (64, 48)
    assert result.depth.shape == result.labels.shape == result.rgb.shape[:2] == (48, 64)
    assert result.camera == camera.at_size(64, 48)
    blocks = rgb.reshape(48, 2, 64, 2, 3).astype(int)
    assert (result.rgb >= blocks.min((1, 3))).all() and (result.rgb <= blocks.max((1, 3))).all()
    cloud = result.cloud()
    assert cloud.points.shape == (48, 64, 3) and (cloud.colors == result.rgb).all()


def test_a_temporal_filter_keeps_its_state_when_asked(rgb):
    net = model(filters=["temporal=alpha:0.1,delta:1"])
    alone = [depth_of(net.infer(noise(96, 128, seed))) for seed in (1, 2)]
    net.infer(noise(96, 128, 1))
    assert depth_of(net.infer(noise(96, 128, 2))) == alone[1]
    net.infer(noise(96, 128, 1))
    assert depth_of(net.infer(noise(96, 128, 2), keep_state=True)) != alone[1]


@pytest.mark.parametrize(
    ("filters", "kind", "words"),
    [
        ("blur", ValueError, "blur"),
        (["spatial", "spatial"], ValueError, "spatial"),
        ("spatial=alpha:7", ValueError, "alpha"),
        ("spatial=radius:7", ValueError, "radius"),
        (3, TypeError, "`filters` is `3`"),
        ([3], TypeError, "`filters`"),
        ("decimation=9", ValueError, "decimation"),
    ],
)
def test_wrong_filters_are_refused(filters, kind, words):
    with pytest.raises(kind, match=words):
        nunet.Model(TINY, filters=filters, **ONE_THREAD)


def messages(function):
    """The texts of the warnings of a call."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        function()
    return [str(warning.message) for warning in caught]


def test_a_missing_camera_causes_one_warning(rgb):
    net = model()
    (message,) = messages(lambda: net.infer(rgb))
    assert message.startswith("no camera was given") and "\nhint: " in message
    assert messages(lambda: net.infer(rgb)) == []
    camera = nunet.Camera(128, 128, 64, 48, (128, 96))
    assert messages(lambda: model().infer(rgb, camera=camera)) == []


def test_another_aspect_ratio_causes_one_warning():
    net = model()
    wide, high = noise(90, 160), noise(160, 90)
    camera = nunet.Camera(128, 128, 80, 45, (160, 90))
    (message,) = messages(lambda: net.infer(wide, camera=camera))
    assert "160x90" in message and "120x90 at (20, 0)" in message and "\nhint: " in message
    upright = nunet.Camera(128, 128, 45, 80, (90, 160))
    assert messages(lambda: net.infer(high, camera=upright)) == []
    squeezed = model(aspect="stretch")
    (message,) = messages(lambda: squeezed.infer(wide, camera=camera))
    assert "stretched to 128x96" in message
    assert messages(lambda: model(aspect="letterbox").infer(wide, camera=camera)) == []
    nearly = nunet.Camera(256, 256, 128, 96, (257, 193))
    assert messages(lambda: model().infer(noise(193, 257), camera=nearly)) == []
