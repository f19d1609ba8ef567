#!/usr/bin/env python3
"""Runs a camera, the daemon with a recording, and readers that start and stop, and checks that nothing grows.

    python3 tests/soak.py --minutes 30 --nunetd target/release/nunetd --csv soak.csv

Images go through shared memory to `nunetd`, which records them. One reader is permanent; others start, and
end by themselves, on a signal, or are killed. Each interval is a line of the CSV: memory, descriptors and
threads of daemon and feeder, their files in /dev/shm, frames, and the age of frames in the permanent reader.
The test fails with exit code 1 and a reason if memory, shared memory, descriptors, threads or the largest age
of frames grew after the warm-up, if an interval had no frame, if the frame counts do not balance, or if files
are left.

Its processes use a private iceoryx2 root, so the shared memory of other programs is not counted.

It needs only Python's standard library, and 90 MB per minute for the recording in the folder TMPDIR.
"""

import argparse
import csv
import itertools
import json
import os
import pathlib
import random
import signal
import statistics
import subprocess
import sys
import tempfile
import threading
import time

ROOT = pathlib.Path(__file__).resolve().parents[1]
SHARED_MEMORY = pathlib.Path("/dev/shm")
# iceoryx2's own counter of nodes, which it never removes.
ALLOWED_REST = ".global_mgmt"
# Timeouts for the end of a process and for the first frame.
TIMEOUT_S = 60
FIELDS = [
    "seconds",
    "daemon_anon_kb",
    "daemon_rss_kb",
    "daemon_fds",
    "daemon_threads",
    "feeder_anon_kb",
    "feeder_fds",
    "shm_bytes",
    "recording_bytes",
    "frames",
    "age_p50_ms",
    "age_p99_ms",
]


def arguments():
    """Parses the command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--minutes", type=float, default=30)
    parser.add_argument("--rate", type=float, default=5, help="frames a second")
    parser.add_argument("--interval", type=float, default=10, help="seconds between two lines")
    parser.add_argument("--warm-up", type=float, default=60, help="seconds whose lines do not count")
    parser.add_argument(
        "--drift-mb", type=float, default=6, help="the most that a process' own memory may grow"
    )
    parser.add_argument("--drift-shm-mb", type=float, default=1, help="the most that shared memory may grow")
    parser.add_argument(
        "--drift-age-ms", type=float, default=100, help="the most that the 99th percentile may rise"
    )
    parser.add_argument("--nunetd", default=os.environ.get("NUNETD", str(ROOT / "target/release/nunetd")))
    parser.add_argument("--model", default=str(ROOT / "models/tiny/tiny_wnet_c.onnx"))
    parser.add_argument("--images", default=str(ROOT / "models/clip/rgb"))
    parser.add_argument("--csv", type=pathlib.Path, default=pathlib.Path("soak.csv"))
    parser.add_argument("--seed", type=int, default=1, help="of the readers that come and go")
    return parser.parse_args()


class Reader:
    """The permanent reader: stores the ages of frames."""

    def __init__(self, command, folder):
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=folder)
        self.ages, self.frames, self.lock = [], 0, threading.Lock()
        threading.Thread(target=self.listen, daemon=True).start()

    def listen(self):
        """Ends with the process."""
        for line in self.process.stdout:
            with self.lock:
                self.ages.append(json.loads(line)["age_ms"])
                self.frames += 1

    def take(self):
        """Ages since the last call, and the frames in all."""
        with self.lock:
            ages, self.ages = self.ages, []
            return sorted(ages), self.frames


class TemporaryReaders:
    """Readers that start and stop: some end by themselves, some on a signal, some are killed."""

    def __init__(self, command, folder, seed):
        self.command, self.folder, self.chance, self.next = command, folder, random.Random(seed), 0.0
        self.process, self.count, self.bad = None, 0, []

    def update(self, now):
        """Starts a reader, or ends the running one."""
        if now < self.next:
            return
        self.next = now + self.chance.uniform(1, 6)
        if self.process is None:
            self.process = subprocess.Popen(self.command, stdout=subprocess.DEVNULL, cwd=self.folder)
            self.count += 1
        else:
            self.end(self.chance.choice([signal.SIGTERM, signal.SIGINT, signal.SIGKILL]))

    def end(self, sent=signal.SIGTERM):
        """Checks that a reader that was not killed exits with 0."""
        if self.process is None:
            return
        self.process.send_signal(sent)
        code = self.process.wait(timeout=TIMEOUT_S)
        if code not in {0, -signal.SIGKILL}:
            self.bad.append(code)
        self.process = None


def resources(process):
    """Memory in kB, descriptors and threads of a process."""
    folder = pathlib.Path(f"/proc/{process.pid}")
    status = dict(line.split(":", 1) for line in (folder / "status").read_text().splitlines())
    number = {name: int(status[name].split()[0]) for name in ("RssAnon", "VmRSS", "Threads")}
    return number["RssAnon"], number["VmRSS"], len(list((folder / "fd").iterdir())), number["Threads"]


class World:
    """A private iceoryx2 root: processes that are started in `folder` find its configuration there."""

    def __init__(self, folder):
        self.folder, self.prefix = folder, f"nunetsoak{os.getpid()}_"
        self.root = folder / "iceoryx2"
        (folder / "config").mkdir()
        config = f'[global]\nroot-path = "{self.root}"\nprefix = "{self.prefix}"\n'
        (folder / "config/iceoryx2.toml").write_text(config)

    def shared(self):
        """Paths and sizes of the files in shared memory."""
        found = {}
        for path in SHARED_MEMORY.glob(f"{self.prefix}*"):
            try:
                found[path] = path.stat().st_blocks * 512
            except FileNotFoundError:
                continue  # a reader has just ended
        return found

    def left(self):
        """Files that are left after all processes ended; they are removed."""
        files = [path for path in self.root.rglob("*") if path.is_file()] if self.root.is_dir() else []
        memory = list(self.shared())
        for path in memory:
            path.unlink(missing_ok=True)
        return [str(path) for path in sorted([*memory, *files]) if not path.name.endswith(ALLOWED_REST)]


def percentile(ages, share):
    """The percentile of a sorted list; an empty text for an empty one."""
    return round(ages[min(len(ages) - 1, int(share * len(ages)))], 3) if ages else ""


class Soak:
    """All processes."""

    def __init__(self, given, world):
        self.given, self.world, self.name = given, world, f"soak-{os.getpid()}"
        folder = world.folder
        self.recording, self.stats = folder / "soak.mcap", folder / "stats.json"
        # They are started elsewhere.
        given_paths = (given.nunetd, given.images, given.model)
        nunetd, images, model = (str(pathlib.Path(path).resolve()) for path in given_paths)
        tool = [nunetd, "-q"]
        feed = [*tool, "feed", images, "--camera", self.name, "--loop", "--rate", str(given.rate)]
        run = [*tool, "--model", model, "--source", f"shm:{self.name}", "--camera", self.name]
        run += ["--record", str(self.recording), "--stats-json", str(self.stats)]
        watch = [*tool, "watch", self.name, "--json", "--timeout", str(TIMEOUT_S)]
        self.feeder = subprocess.Popen(feed, cwd=folder)
        self.daemon = subprocess.Popen(run, cwd=folder)
        self.reader = Reader(watch, folder)
        self.temporary_readers = TemporaryReaders(watch, folder, given.seed)

    def line(self, seconds):
        """One line of the CSV."""
        daemon, feeder = resources(self.daemon), resources(self.feeder)
        ages, frames = self.reader.take()
        recorded = self.recording.stat().st_size if self.recording.exists() else 0
        memory = sum(self.world.shared().values())
        values = [round(seconds, 1), *daemon, feeder[0], feeder[2], memory, recorded, frames]
        return dict(zip(FIELDS, [*values, percentile(ages, 0.5), percentile(ages, 0.99)], strict=True))

    def run(self):
        """Prints lines until the time is over or a process has died."""
        lines, start = [], time.monotonic()
        with self.given.csv.open("w", newline="") as file:
            table = csv.DictWriter(file, FIELDS)
            table.writeheader()
            due = self.given.interval
            while (seconds := time.monotonic() - start) < 60 * self.given.minutes:
                time.sleep(0.2)
                dead = self.ended()
                if dead:
                    return lines, [f"{dead} has ended by itself"]
                self.temporary_readers.update(seconds)
                if seconds >= due:
                    due += self.given.interval
                    lines.append(self.line(seconds))
                    table.writerow(lines[-1])
                    file.flush()
                    print("  ".join(f"{name} {value}" for name, value in lines[-1].items()), flush=True)
        return lines, []

    def ended(self):
        """The processes that have ended."""
        all_of_them = {
            "the feeder": self.feeder,
            "the daemon": self.daemon,
            "the reader": self.reader.process,
        }
        return ", ".join(name for name, process in all_of_them.items() if process.poll() is not None)

    def stop(self):
        """Stops all processes with SIGTERM, readers first, and returns the problems."""
        self.temporary_readers.end()
        problems = [f"a reader ended with {code}" for code in self.temporary_readers.bad]
        ending = {"reader": self.reader.process, "daemon": self.daemon, "feeder": self.feeder}
        for name, process in ending.items():
            process.terminate()
            try:
                code = process.wait(timeout=TIMEOUT_S)
            except subprocess.TimeoutExpired:
                process.kill()
                code = process.wait()
            if code != 0:
                problems.append(f"the {name} ended with {code}")
        return problems


def growth_problems(lines, field, limit):
    """Problems of a value that grew from the first third of the lines to the last by more than `limit`."""
    third = len(lines) // 3
    if third == 0:
        return [f"too few lines to say whether {field} grows: soak longer"]
    thirds = [[line[field] for line in part if line[field] != ""] for part in (lines[:third], lines[-third:])]
    if not all(thirds):
        return [f"{field} was never seen"]
    first, last = map(statistics.median, thirds)
    print(f"{field}: {first:.0f} in the first third, {last:.0f} in the last; {limit:.0f} more are allowed")
    return [f"{field} grew from {first:.0f} to {last:.0f}"] if last - first > limit else []


def gap_problems(lines):
    """Problems of intervals without a frame for the permanent reader."""
    still = [later for line, later in itertools.pairwise(lines) if later["frames"] <= line["frames"]]
    return [f"no frame came in the interval before second {line['seconds']}" for line in still]


def count_problems(path):
    """Problems of the daemon's frame counts."""
    if not path.exists():
        return ["the daemon left no statistics"]
    frames = json.loads(path.read_text())["frames"]
    print(f"frames: {frames}")
    ended = frames["published"] + frames["superseded"] + frames["failed"] + frames["in_flight"]
    problems = (
        []
        if frames["captured"] == ended
        else [f"{frames['captured']} frames captured, {ended} accounted for"]
    )
    if frames["in_flight"] or frames["failed"]:
        problems.append(f"{frames['in_flight']} frames are unfinished, {frames['failed']} failed")
    return problems if frames["published"] else [*problems, "no frame was published"]


def end_problems(path):
    """Problems of the recording's end, where its index and MCAP's magic bytes are."""
    if not path.exists():
        return ["there is no recording"]
    with path.open("rb") as file:
        file.seek(max(0, path.stat().st_size - 8))
        return [] if file.read() == b"\x89MCAP0\r\n" else ["the recording has no end"]


def main():
    """Runs the test, prints the result, and returns the exit code."""
    given = arguments()
    with tempfile.TemporaryDirectory() as folder:
        world = World(pathlib.Path(folder).resolve())
        soak = Soak(given, world)
        try:
            lines, problems = soak.run()
        except BaseException:
            soak.stop()
            world.left()
            raise
        problems += soak.stop()
        problems += count_problems(soak.stats) + end_problems(soak.recording)
        problems += [f"left behind: {path}" for path in world.left()]
    counted = [line for line in lines if line["seconds"] >= given.warm_up]
    limits = {
        "daemon_anon_kb": given.drift_mb * 1024,
        "feeder_anon_kb": given.drift_mb * 1024,
        "shm_bytes": given.drift_shm_mb * 1e6,
        "age_p99_ms": given.drift_age_ms,
        # An open reader uses a few descriptors.
        "daemon_fds": 4,
        "feeder_fds": 4,
        "daemon_threads": 0,
    }
    for field, limit in limits.items():
        problems += growth_problems(counted, field, limit)
    problems += gap_problems(counted)
    print(f"{soak.temporary_readers.count} readers came and went")
    for problem in problems:
        print(f"error: {problem}", file=sys.stderr)
    return 1 if problems else 0


if __name__ == "__main__":
    sys.exit(main())
