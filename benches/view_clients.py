"""What clients of the live view cost: their frames per second, nunetd's processor time, and its latency.

Needs only Python, and `NUNETD` naming a release build: `python benches/view_clients.py [MODEL] [ROUNDS]`.
Each round runs nunetd without clients, with one that receives 640x480, and with a second one that never
reads.
"""

import base64
import json
import os
import re
import socket
import statistics
import struct
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).parents[1]
RATE_HZ = 15
FRAMES = 300
TIMEOUT_S = 60.0
WATCH = {"type": "watch", "camera": "bench", "max_width": 640, "max_fps": RATE_HZ, "max_mbit_per_s": 100}
TEXT, BINARY, CLOSE = 1, 2, 8
CLIENTS = {"no client": (0, 0), "one client": (1, 0), "one, and one that never reads": (1, 1)}


class Client:
    """A WebSocket (RFC 6455) that asks for frames as soon as nunetd has the camera."""

    def __init__(self, port: int) -> None:
        self.socket = socket.create_connection(("127.0.0.1", port), TIMEOUT_S)
        self.stream = self.socket.makefile("rb")
        key = base64.b64encode(os.urandom(16)).decode()
        self.socket.sendall(
            f"GET /ws HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
            f"Sec-WebSocket-Key: {key}\r\nSec-WebSocket-Version: 13\r\n\r\n".encode()
        )
        assert b" 101 " in self.stream.readline()
        while self.stream.readline().strip():
            pass
        while WATCH["camera"] not in json.loads(self.read()[1]).get("cameras", []):
            pass
        self.send(json.dumps(WATCH).encode())

    def send(self, text: bytes) -> None:
        """Clients must mask what they send; a mask of zeros leaves the text as it is."""
        self.socket.sendall(struct.pack(">BBHI", 0x80 | TEXT, 0x80 | 126, len(text), 0) + text)

    def read(self) -> tuple[int, bytes]:
        """Kind and content of the next message; `CLOSE` after the last one."""
        head = self.stream.read(2)
        if len(head) < 2:
            return CLOSE, b""
        length = head[1]
        if length > 125:
            size = 2 if length == 126 else 8
            length = int.from_bytes(self.stream.read(size), "big")
        return head[0] & 15, self.stream.read(length)

    def count_frames(self) -> float:
        """Frames per second until nunetd ends."""
        times = []
        while (kind := self.read()[0]) != CLOSE:
            if kind == BINARY:
                times.append(time.monotonic())
        return (len(times) - 1) / (times[-1] - times[0])


def port_of(log: Path, process: subprocess.Popen) -> int:
    """The port that nunetd logs."""
    end = time.monotonic() + TIMEOUT_S
    while time.monotonic() < end and process.poll() is None:
        if found := re.search(r"live view on http://127\.0\.0\.1:(\d+)/", log.read_text()):
            return int(found[1])
        time.sleep(0.02)
    sys.exit(log.read_text())


def run(model: str, reading: int, stalled: int) -> dict[str, float]:
    """One run of nunetd with this number of clients."""
    with tempfile.TemporaryDirectory() as folder:
        stats, log = Path(folder) / "stats.json", Path(folder) / "log"
        command = [
            os.environ["NUNETD"], "run", "--source", str(ROOT / "models/clip/rgb"), "--loop",
            "--rate", str(RATE_HZ), "--frames", str(FRAMES), "--camera", "bench", "--model", model,
            "--view", "127.0.0.1:0", "--stats-json", str(stats),
        ]  # fmt: skip
        with log.open("w") as stderr:
            process = subprocess.Popen(command, stdin=subprocess.DEVNULL, stderr=stderr)
        port = port_of(log, process)
        clients = [Client(port) for _ in range(stalled + reading)]
        rates = [client.count_frames() for client in clients[stalled:]]
        _, status, usage = os.wait4(process.pid, 0)
        assert status == 0, log.read_text()
        for client in clients:
            client.socket.close()
        result = json.loads(stats.read_text())
    return {
        "fps": min(rates, default=0.0),
        "cpu_ms": (usage.ru_utime + usage.ru_stime) / FRAMES * 1e3,
        "published": result["frames"]["published"],
        "p50_ms": result["latency_ms"]["total"]["p50"],
        "p99_ms": result["latency_ms"]["total"]["p99"],
    }


def main(model: str, rounds: int) -> None:
    """Interleaves the cases, and prints the medians of their rounds."""
    results = {name: [] for name in CLIENTS}
    for _ in range(rounds):
        for name, clients in CLIENTS.items():
            results[name].append(run(model, *clients))
    print("median of rounds | frames | per s at client | CPU ms per frame | p50 ms | p99 ms")
    for name, runs in results.items():
        of = {key: statistics.median(run[key] for run in runs) for key in runs[0]}
        print(
            f"{name} | {of['published']:.0f} | {of['fps']:.1f} | {of['cpu_ms']:.1f} |"
            f" {of['p50_ms']:.2f} | {of['p99_ms']:.2f}"
        )


main(sys.argv[1] if len(sys.argv) > 1 else "wnet_c", int(sys.argv[2]) if len(sys.argv) > 2 else 3)
