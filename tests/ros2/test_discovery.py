"""What nunetds say to each other."""

from pathlib import Path

from conftest import ROOT

FRAMES = 50


def test_two_nunetds_only_announce_themselves_to_each_other(start_on: object) -> None:
    """Messages of discovery that are never confirmed would be repeated without a pause."""
    clip = str(ROOT / "models/clip/rgb")
    options = ["--model", "unet", "--loop", "--rate", "10"]
    first, second = start_on(clip, *options), start_on(clip, *options)
    first.wait_for_frames(1)
    second.wait_for_frames(FRAMES)
    before = datagrams_sent()
    second.wait_for_frames(FRAMES)
    count = datagrams_sent() - before
    first.stop()
    second.stop()
    assert 0 < count < 100 * FRAMES, f"{count} datagrams during {FRAMES} frames"


def datagrams_sent() -> int:
    """By all processes of this network namespace."""
    names, values = (
        line.split() for line in Path("/proc/net/snmp").read_text().splitlines() if "Udp:" in line
    )
    return int(values[names.index("OutDatagrams")])
