#!/usr/bin/env python3
"""Ask OpenCV where the pixels of several cameras look, and write its answers to `opencv_rays.json` beside
this file.

    pip install numpy opencv-python-headless
    python opencv_rays.py

The cameras are made up, with numbers like those that calibrations of such lenses find. For each of them:

- `rays`: column and row of a pixel, and x / z and y / z of its ray by `cv2.undistortPoints` or
  `cv2.fisheye.undistortPoints`. OpenCV iterates and does not say whether it has converged, so that an answer
  is kept only where OpenCV itself throws it back on its pixel.
- `beyond`: pixels that no ray in front of the camera reaches, by a search through all radii or angles that
  has nothing to do with how the answer is computed elsewhere.
- `points`: x, y, z and where `cv2.projectPoints` or `cv2.fisheye.projectPoints` says that they appear.
"""

import json
from pathlib import Path

import cv2
import numpy as np

COLUMNS, ROWS = 13, 10  # of the grid of pixels, corners included
ROUND_TRIP_PX = 1e-9
# Near the lens's end the small errors of centring decide which pixels see something: nothing is said about
# them.
SURE_INSIDE, SURE_OUTSIDE = 0.97, 1.06

CAMERAS = [
    {
        "name": "wide webcam",
        "model": "brown_conrady",
        "size": (1280, 720),
        "intrinsics": (641.3, 640.8, 633.7, 372.4),
        "distortion": [-0.2915, 0.1127, 0.00071, -0.00043, -0.0154],
    },
    {
        "name": "telephoto with a pincushion",
        "model": "brown_conrady",
        "size": (1920, 1080),
        "intrinsics": (2410.5, 2412.1, 951.2, 548.9),
        "distortion": [0.2418, -0.3127, -0.0011, 0.0008],
    },
    {
        "name": "strong barrel",
        "model": "brown_conrady",
        "size": (640, 480),
        "intrinsics": (298.4, 297.9, 322.6, 236.1),
        "distortion": [-0.3902, 0.1608, 0.0009, -0.0012, -0.0311],
    },
    {
        "name": "rational action camera",
        "model": "brown_conrady",
        "size": (1920, 1440),
        "intrinsics": (883.2, 882.5, 968.4, 712.7),
        "distortion": [5.1127, 3.0246, -0.00012, 0.00021, 0.1614, 5.4491, 4.6018, 0.8712],
    },
    {
        "name": "tilted with a thin prism",
        "model": "brown_conrady",
        "size": (1024, 768),
        "intrinsics": (702.6, 703.3, 498.2, 391.5),
        "distortion": [
            *(-0.1821, 0.0604, 0.0006, -0.0002, -0.0071, 0.0119, -0.0022, 0.0004),  # k1 k2 p1 p2 k3 to k6
            *(0.0011, -0.0004, -0.0008, 0.0003),  # s1 to s4
            *(0.0421, -0.0287),  # tilts
        ],
    },
    {
        "name": "fisheye of 180 degrees",
        "model": "kannala_brandt",
        "size": (1280, 960),
        "intrinsics": (358.1, 357.6, 642.9, 474.3),
        "distortion": [-0.0123, 0.0034, -0.0025, 0.0004],
    },
    {
        "name": "fisheye that folds before 90 degrees",
        "model": "kannala_brandt",
        "size": (848, 800),
        "intrinsics": (286.2, 286.9, 419.8, 403.1),
        "distortion": [0.0142, -0.0718, 0.0131, -0.0112],
    },
]


def matrix(camera):
    """The camera matrix, `[3, 3]`."""
    fx, fy, cx, cy = camera["intrinsics"]
    return np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]], np.float64)


def project(camera, points):
    """Pixels `[n, 2]` of points `[n, 3]`."""
    zero, lens = np.zeros(3), np.array(camera["distortion"])
    if camera["model"] == "kannala_brandt":
        pixels, _ = cv2.fisheye.projectPoints(points[:, None], zero, zero, matrix(camera), lens)
    else:
        pixels, _ = cv2.projectPoints(points[:, None], zero, zero, matrix(camera), lens)
    return pixels[:, 0]


def undistort(camera, pixels):
    """Rays `[n, 2]` of pixels `[n, 2]`, and whether OpenCV throws them back where they came from."""
    lens = np.array(camera["distortion"])
    if camera["model"] == "kannala_brandt":
        end = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 500, 1e-14)
        rays = cv2.fisheye.undistortPoints(pixels[:, None], matrix(camera), lens, criteria=end)[:, 0]
    else:
        end = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 5000, 1e-12)
        rays = cv2.undistortPoints(pixels[:, None], matrix(camera), lens, criteria=end)[:, 0]
    back = project(camera, np.column_stack([rays, np.ones(len(rays))]))
    return rays, np.hypot(*(back - pixels).T) < ROUND_TRIP_PX


def radius_at_end(camera):
    """How far from the center, in focal lengths,
    the rings of the lens reach before they fold or are at 90 degrees.
    """
    lens = np.array(camera["distortion"] + [0.0] * (14 - len(camera["distortion"])))
    if camera["model"] == "kannala_brandt":
        angle = np.linspace(0, np.pi / 2, 2_000_001)
        u = angle**2
        distorted = angle * (1 + lens[0] * u + lens[1] * u**2 + lens[2] * u**3 + lens[3] * u**4)
    else:
        radius = np.tan(np.linspace(0, np.arctan(1000), 2_000_001))
        u = radius**2
        above = 1 + lens[0] * u + lens[1] * u**2 + lens[4] * u**3
        below = 1 + lens[5] * u + lens[6] * u**2 + lens[7] * u**3
        distorted = radius * above / below
    falls = np.flatnonzero(np.diff(distorted) < 0)
    return distorted[falls[0]] if len(falls) else distorted[-1]


def answers(camera, random):
    """The camera with OpenCV's answers."""
    (width, height), (fx, fy, cx, cy) = camera["size"], camera["intrinsics"]
    columns, rows = np.linspace(0, width - 1, COLUMNS).round(), np.linspace(0, height - 1, ROWS).round()
    pixels = np.stack(np.meshgrid(columns, rows), -1).reshape(-1, 2)
    radius = np.hypot((pixels[:, 0] - cx) / fx, (pixels[:, 1] - cy) / fy) / radius_at_end(camera)
    rays, sound = undistort(camera, pixels)
    inside, beyond = radius < SURE_INSIDE, radius > SURE_OUTSIDE
    kept = inside & sound
    print(
        f"{camera['name']}: {kept.sum()} rays, {beyond.sum()} beyond, "
        f"{(inside & ~sound).sum()} not found by OpenCV"
    )
    depth = random.uniform(0.2, 20, kept.sum())
    points = np.column_stack([rays[kept], np.ones(kept.sum())]) * depth[:, None]
    return {
        "name": camera["name"],
        "model": camera["model"],
        "width": width,
        "height": height,
        "intrinsics": camera["intrinsics"],
        "distortion": camera["distortion"],
        "rays": np.column_stack([pixels[kept], rays[kept]]).tolist(),
        "beyond": pixels[beyond].tolist(),
        "points": np.column_stack([points, project(camera, points)])[::4].tolist(),
    }


def main():
    """Write the file: a line a pixel or point."""
    random = np.random.default_rng(1)
    golden = {
        "made_by": "opencv_rays.py",
        "opencv": cv2.__version__,
        "cameras": [answers(camera, random) for camera in CAMERAS],
    }
    text = (
        json.dumps(golden).replace("[[", "[\n[").replace("], [", "],\n[").replace('}, {"name"', '},\n{"name"')
    )
    Path(__file__).with_suffix(".json").write_text(text + "\n")


if __name__ == "__main__":
    main()
