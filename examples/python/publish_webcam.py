"""Publish the images of a webcam with OpenCV: `publish_webcam.py CAMERA [DEVICE [FRAMES]]`.

In another terminal: `nunetd --source shm:CAMERA --camera CAMERA`. OpenCV writes directly into shared memory,
without another copy. Needs the package `opencv-python`.
"""

from __future__ import annotations

import argparse
import sys
import time

import cv2  # type: ignore[import-not-found, unused-ignore]
import nunet_py as nunet


def main(camera: str, device: str, count: int | None) -> None:
    """Send images until the camera stops, Ctrl-C, or `count` images."""
    capture = cv2.VideoCapture(int(device) if device.isdigit() else device)
    try:
        # Keep only the newest image in OpenCV's queue.
        capture.set(cv2.CAP_PROP_BUFFERSIZE, 1)
        found, first = capture.read()
        if not found:
            sys.exit(f"publish_webcam: `{device}` returns no images; `nunetd doctor` lists cameras")
        height, width = first.shape[:2]
        with nunet.publisher(camera, size=(width, height), encoding="bgr8") as publisher:
            print(f"{width}x{height} on `{camera}`", flush=True)
            sent = 0
            while sent != count and capture.grab():
                # The capture time, not the time of decoding.
                with publisher.loan(capture_nanos=time.monotonic_ns()) as image:
                    if not capture.retrieve(image)[0]:
                        sys.exit(f"publish_webcam: `{device}` returned a damaged image")
                sent += 1
    finally:
        capture.release()


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("camera")
    parser.add_argument("device", nargs="?", default="0")
    parser.add_argument("frames", type=int, nargs="?")
    arguments = parser.parse_args()
    try:
        main(arguments.camera, arguments.device, arguments.frames)
    except nunet.NunetError as error:
        sys.exit(f"publish_webcam: {error}")
    except KeyboardInterrupt:
        sys.exit(130)
