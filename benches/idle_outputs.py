"""What outputs cost while nobody is connected to them: the frame time with and without.

Needs only Python, and `NUNETD` naming a release build: `python benches/idle_outputs.py [MODEL] [ROUNDS]`.
Each round runs nunetd twice, in turn: without network outputs, and with ROS 2 over DDS and Zenoh, live view,
Foxglove and metrics. ROS 2 stays on this machine.
"""

import json
import os
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).parents[1]
FRAMES = 200
TIMEOUT_S = 120.0
ANY_PORT = "127.0.0.1:0"
OUTPUTS = [
    "--ros2", "dds", "--ros2", "zenoh", "--ros2-topics", "all",
    "--view", ANY_PORT, "--foxglove", ANY_PORT, "--metrics", ANY_PORT,
]  # fmt: skip


def frame_ms(model: str, outputs: list[str]) -> float:
    """The median time of a frame, from its capture to the end of its publication, milliseconds."""
    with tempfile.TemporaryDirectory() as folder:
        stats = Path(folder) / "stats.json"
        command = [
            os.environ["NUNETD"], "-q", "run", "--source", str(ROOT / "models/clip/rgb"), "--loop",
            "--frames", str(FRAMES), "--camera", "bench", "--mount", "0,0,0.25,0,0,0", "--model", model,
            "--stats-json", str(stats), *outputs,
        ]  # fmt: skip
        environment = {**os.environ, "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
        subprocess.run(command, check=True, stdin=subprocess.DEVNULL, env=environment, timeout=TIMEOUT_S)
        return json.loads(stats.read_text())["latency_ms"]["total"]["p50"]


def main(model: str, rounds: int) -> None:
    """Prints the median of the rounds and of their ratios."""
    pairs = [(frame_ms(model, []), frame_ms(model, OUTPUTS)) for _ in range(rounds)]
    off, on = (statistics.median(times) for times in zip(*pairs, strict=True))
    ratio = statistics.median(with_outputs / without for without, with_outputs in pairs)
    print(f"{model}, {rounds} rounds of {FRAMES} frames: outputs off {off:.2f} ms, on {on:.2f} ms,", end=" ")
    print(f"ratio {ratio:.3f}")


main(sys.argv[1] if len(sys.argv) > 1 else "wnet_c", int(sys.argv[2]) if len(sys.argv) > 2 else 9)
