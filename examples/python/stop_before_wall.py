"""A speed that stops the robot before the nearest obstacle ahead, as reported by a running nunetd.

Run `nunetd --source /dev/video0 --camera front --mount 0.1,0,0.25,0,-0.07,0`, then
`python stop_before_wall.py front`.
"""

import argparse
import os
import sys

import numpy as np
import nunet_py as nunet

FULL_SPEED = 0.6  # meters per second
TIMEOUT_S = 0.5  # the robot stops if no frame arrives for so long
STOP_M = 0.4  # the robot stops this far before an obstacle
BRAKE_M = 1.0  # meters over which it brakes
AHEAD_RAD = 0.35  # half the angle ahead that counts


def speed(obstacles: nunet.Obstacles) -> float:
    """Return the speed for what is ahead. A direction counts only as far as it is known to be free."""
    ahead = np.abs(obstacles.angles) < AHEAD_RAD
    free_m = obstacles.ranges[ahead].min(initial=np.inf) if ahead.any() else 0.0
    return FULL_SPEED * float(np.clip((free_m - STOP_M) / BRAKE_M, 0.0, 1.0))


def main(camera: str) -> None:
    """Print the speed for each frame, and 0 while no frame arrives."""
    with nunet.subscribe(camera, topics=["obstacles"], timeout=10.0) as frames:
        while True:
            try:
                print(f"{speed(frames.next(timeout=TIMEOUT_S).obstacles):.2f} m/s", flush=True)
            except TimeoutError:
                print(f"0.00 m/s: no frame for {TIMEOUT_S} s", flush=True)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("camera")
    arguments = parser.parse_args()
    try:
        main(arguments.camera)
    except (TimeoutError, nunet.NunetError) as error:
        sys.exit(f"stop_before_wall: {error}")
    except KeyboardInterrupt:
        sys.exit(130)
    except BrokenPipeError:  # the pipe was closed, as in `stop_before_wall.py front | head -1`
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
