"""What another camera would have seen: turned, zoomed and cropped, with exact intrinsics and depth.

A view is a homography of the image. The camera turns about its center, so that nothing appears or
disappears, and the depth of each pixel changes by a factor that the homography gives. Pixels in
these formulas have their corner at a whole number, so that the center of the first one is (.5, .5).
"""

import math
from dataclasses import dataclass

import numpy as np
from PIL import Image

from nunet_models.classes import IGNORE
from nunet_models.data.augment import Sample
from nunet_models.data.sets.cameras import Pinhole
from nunet_models.data.sets.folder import CameraImage

Size = tuple[int, int]
"""Height and width."""


@dataclass(frozen=True)
class View:
    """A virtual camera, relative to the one that took the image.

    `crop` is the part of the image that is seen: left, top, width and height in pixels of the
    image, stretched to the whole view as nunetd stretches images to the network's input size.
    `roll` and `pitch` turn the camera, in degrees: clockwise, and upward. `flip` mirrors.
    """

    crop: tuple[float, float, float, float]
    roll: float = 0.0
    pitch: float = 0.0
    flip: bool = False
    fill: int = 127

    def intrinsics(self, camera: Pinhole, size: Size) -> np.ndarray:
        """Camera matrix `[3, 3]` of the view at `size`; it turns pixels before any mirroring."""
        left, top, width, height = self.crop
        x, y = size[1] / width, size[0] / height
        cx, cy = (camera.cx + 0.5 - left) * x, (camera.cy + 0.5 - top) * y
        return np.array([[camera.fx * x, 0, cx], [0, camera.fy * y, cy], [0, 0, 1.0]])

    def homography(self, camera: Pinhole, size: Size) -> np.ndarray:
        """`[3, 3]`: a pixel (x, y, 1) of the view to the image; third row: depth there per depth
        in the view."""  # noqa: D205, D209
        source = np.array(
            [[camera.fx, 0, camera.cx + 0.5], [0, camera.fy, camera.cy + 0.5], [0, 0, 1.0]]
        )
        back = np.linalg.inv(self.intrinsics(camera, size))
        found = source @ rotation(self.roll, self.pitch) @ back
        if self.flip:
            found = found @ np.array([[-1.0, 0, size[1]], [0, 1, 0], [0, 0, 1]])
        return found


def rotation(roll: float, pitch: float) -> np.ndarray:
    """Rays of a camera that is turned (degrees; clockwise, upward) to those of the unturned one."""
    r, p = math.radians(roll), math.radians(pitch)
    about_z = np.array([[math.cos(r), -math.sin(r), 0], [math.sin(r), math.cos(r), 0], [0, 0, 1.0]])
    about_x = np.array([[1.0, 0, 0], [0, math.cos(p), -math.sin(p)], [0, math.sin(p), math.cos(p)]])
    return about_x @ about_z


def seen(image: CameraImage, view: View, *, size: Size) -> Sample:
    """`image` as `view` shows it, at `size`; depth is the view's own z, in meters."""
    matrix = view.homography(image.camera, size)
    depth_m = _warped(_outside_nan(image), matrix, size, np.nan)
    rows, columns = np.mgrid[: size[0], : size[1]] + 0.5
    factor = matrix[2, 0] * columns + matrix[2, 1] * rows + matrix[2, 2]
    labels = image.pair.labels
    if labels is None:
        labels = np.full(size, IGNORE, np.uint8)
    else:
        labels = _warped(labels, matrix, size, IGNORE)
    return Sample(_colors(image, matrix, size, view), (depth_m / factor).astype(np.float32), labels)


def coverage(image: CameraImage, view: View) -> float:
    """Share of the view that the image's window fills, 0 to 1."""
    size = (12, 16)
    rows, columns = np.mgrid[: size[0], : size[1]] + 0.5
    points = np.stack([columns, rows, np.ones(size)]).reshape(3, -1)
    x, y, w = view.homography(image.camera, size) @ points
    top, left, bottom, right = image.window
    with np.errstate(divide="ignore", invalid="ignore"):
        x, y = x / w, y / w
    return float(((w > 0) & (x >= left) & (x < right) & (y >= top) & (y < bottom)).mean())


def _outside_nan(image: CameraImage) -> np.ndarray:
    """Depth without the frame around the window."""
    top, left, bottom, right = image.window
    depth = np.full_like(image.pair.depth_m, np.nan)
    depth[top:bottom, left:right] = image.pair.depth_m[top:bottom, left:right]
    return depth


def _warped(array: np.ndarray, matrix: np.ndarray, size: Size, fill: float) -> np.ndarray:
    """Nearest pixel: neither depth nor labels can be mixed."""
    return np.array(
        Image.fromarray(array).transform(
            size[::-1],
            Image.Transform.PERSPECTIVE,
            _coefficients(matrix),
            Image.Resampling.NEAREST,
            fillcolor=fill,
        )
    )


def _colors(image: CameraImage, matrix: np.ndarray, size: Size, view: View) -> np.ndarray:
    """Bilinear, of an image reduced first where the view would skip pixels."""
    top, left, bottom, right = image.window
    rgb = Image.fromarray(image.pair.rgb[top:bottom, left:right])
    matrix = np.array([[1, 0, -left], [0, 1, -top], [0, 0, 1.0]]) @ matrix
    shrink = math.sqrt(view.crop[2] * view.crop[3] / (size[0] * size[1]))
    reduction = max(1, int(shrink / 1.5))
    if reduction > 1:  # a bilinear sample reaches two pixels, as nunetd's average of 2x2 does
        rgb = rgb.reduce(reduction)
        matrix = np.diag([1 / reduction, 1 / reduction, 1.0]) @ matrix
    fill = (view.fill,) * 3
    how = Image.Resampling.BILINEAR
    shape = size[::-1]
    return np.array(
        rgb.transform(
            shape, Image.Transform.PERSPECTIVE, _coefficients(matrix), how, fillcolor=fill
        )
    )


def _coefficients(matrix: np.ndarray) -> tuple[float, ...]:
    """What PIL takes: eight numbers, scaled so that the ninth is 1."""
    return tuple((matrix / matrix[2, 2]).ravel()[:8])
