"""Random views of an image: zoom, roll, pitch, aspect ratio and place."""

from dataclasses import dataclass, replace

import numpy as np

from nunet_models.data.augment import STRONG, Augmentation, Sample, recolored
from nunet_models.data.sets.folder import CameraImage
from nunet_models.data.sets.view import Size, View, coverage, seen
from nunet_models.zoo.spec import Camera

COLORS = replace(STRONG, cutout=0.15)
"""Of a view; its zoom and rotation are not used."""
TRIES = 4  # to turn a camera, by half as much each time, before it stays upright


@dataclass(frozen=True)
class ViewRanges:
    """How far views differ from the images.

    `zoom` is the usual range of the focal length's factor; with `near_chance` it is drawn from
    `near_zoom` instead, which makes rooms as near as a desk. All are drawn evenly in the
    logarithm. `turn_chance` is that of a roll and a pitch up to these angles in degrees.
    `coverage` is the least share of a view that the image must fill. `whole_chance` is that of a
    view without a zoom: the whole image, as nunetd shows it to the network. `square_chance` is
    that of a view with square pixels where the image's shape is another, and `wide_chance` that
    of a 16:9 part of the image; both are stretched as nunetd would.
    `frame_chance` is that of a white or black frame drawn over the view, of up to `frame_px`.
    """

    zoom: tuple[float, float] = (0.85, 1.5)
    near_zoom: tuple[float, float] = (1.2, 4.0)
    near_chance: float = 0.3
    whole_chance: float = 0.25
    turn_chance: float = 0.4
    roll_deg: float = 30.0
    pitch_deg: float = 30.0
    coverage: float = 0.7
    square_chance: float = 0.5
    wide_chance: float = 0.1
    flip: float = 0.5
    frame_chance: float = 0.15
    frame_px: int = 5
    colors: Augmentation = COLORS


@dataclass(frozen=True)
class Shapes:
    """Sizes of a sample: what is drawn, the network's inner size, and the canonical camera.

    A `size` less than `inner` is a patch: pixels are as large as in the whole view, and there are
    fewer of them, so that a step takes less time.
    """

    size: Size
    inner: Size
    canonical: Camera

    @classmethod
    def of_part(cls, inner: Size, part: float, canonical: Camera) -> "Shapes":
        """Sides of `part` of those of `inner`, rounded to multiples of an encoder's stride."""
        size = tuple(max(STRIDE, round(side * part / STRIDE) * STRIDE) for side in inner)
        return cls(inner if part == 1.0 else size, inner, canonical)


STRIDE = 32

WHOLE = ViewRanges(
    zoom=(1.0, 1.0),
    near_chance=0.0,
    whole_chance=1.0,
    turn_chance=0.0,
    square_chance=0.0,
    wide_chance=0.0,
    flip=0.0,
    frame_chance=0.0,
    colors=Augmentation(),
)
"""No augmentation: the window of the image, stretched to the network's size."""

WIDE = 16 / 9


def whole_view(image: CameraImage) -> View:
    """The window of the image."""
    top, left, bottom, right = image.window
    return View((left, top, right - left, bottom - top))


def drawn_view(
    image: CameraImage,
    ranges: ViewRanges,
    size: Size,
    random: np.random.Generator,
    *,
    zoom: float = 1.0,
) -> View:
    """A random view of `image`; the same for the same state of `random`.

    `zoom` is a factor of the drawn one: what a patch of the network's size needs.
    """
    width, height = _shape(image, ranges, size, random)
    zoom *= _zoom(ranges, random)
    view = _placed(image, (width / zoom, height / zoom), random)
    view = replace(view, flip=bool(random.random() < ranges.flip), fill=int(random.integers(256)))
    if random.random() >= ranges.turn_chance:
        return view
    roll, pitch = random.triangular(-1, 0, 1, 2) * np.array([ranges.roll_deg, ranges.pitch_deg])
    if random.random() < 0.3:  # also the ends of the range
        roll = random.uniform(-ranges.roll_deg, ranges.roll_deg)
    for half in range(TRIES):
        turned = replace(view, roll=roll / 2**half, pitch=pitch / 4**half)
        if coverage(image, turned) >= ranges.coverage:
            return turned
    return view


def sample(
    image: CameraImage,
    ranges: ViewRanges,
    *,
    how: Shapes,
    random: np.random.Generator,
) -> Sample:
    """A random view of `image`, ready to train on, depth for the canonical camera."""
    size, part = how.size, how.size[1] / how.inner[1]
    view = drawn_view(image, ranges, size, random, zoom=1.0 / part)
    found = seen(image, view, size=size)
    fx = view.intrinsics(image.camera, size)[0, 0] / how.inner[1]
    depth = found.depth_m * np.float32(how.canonical.fx / how.canonical.width / fx)
    rgb = recolored(found.rgb, ranges.colors, random)
    if random.random() < ranges.frame_chance:
        _frame(rgb, int(random.integers(1, ranges.frame_px + 1)), random)
    return Sample(rgb, depth, found.labels)


def _shape(
    image: CameraImage, ranges: ViewRanges, size: Size, random: np.random.Generator
) -> tuple[float, float]:
    """Width and height of the part of the window that a view without a zoom shows."""
    top, left, bottom, right = image.window
    width, height = float(right - left), float(bottom - top)
    square = size[1] / size[0] * image.camera.fx / image.camera.fy
    chance = random.random()
    if chance < ranges.wide_chance:
        return _largest(width, height, WIDE * image.camera.fx / image.camera.fy)
    if chance < ranges.wide_chance + ranges.square_chance:
        return _largest(width, height, square)
    return width, height


def _largest(width: float, height: float, ratio: float) -> tuple[float, float]:
    """The largest part of this ratio of width to height."""
    return min(width, height * ratio), min(height, width / ratio)


def _zoom(ranges: ViewRanges, random: np.random.Generator) -> float:
    chance = random.random()
    if chance < ranges.whole_chance:
        return 1.0
    near = chance < ranges.whole_chance + ranges.near_chance
    least, most = np.log(ranges.near_zoom if near else ranges.zoom)
    return float(np.exp(random.uniform(least, most)))


def _placed(image: CameraImage, shape: tuple[float, float], random: np.random.Generator) -> View:
    """A part of this width and height somewhere in the window, or around it where it is larger."""
    top, left, bottom, right = image.window
    x = left + (right - left - shape[0]) * random.random()
    y = top + (bottom - top - shape[1]) * random.random()
    return View((x, y, *shape))


def _frame(rgb: np.ndarray, pixels: int, random: np.random.Generator) -> None:
    """A frame of one color over the edges, as some datasets and cameras have: depth goes on."""
    value = (0, 255)[int(random.integers(2))]
    rgb[:pixels] = value
    rgb[-pixels:] = value
    rgb[:, :pixels] = value
    rgb[:, -pixels:] = value
