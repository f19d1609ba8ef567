"""Publishes images with Cyclone DDS, ten per second, until it is killed."""

import sys
import time

from cyclone_messages import Header, Image, Time
from cyclonedds.core import Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.pub import DataWriter
from cyclonedds.topic import Topic
from cyclonedds.util import duration

WIDTH, HEIGHT = 256, 192


def main(topic: str) -> None:
    """Publishes the same image with another stamp each time."""
    participant = DomainParticipant(0)
    qos = Qos(
        Policy.Reliability.Reliable(duration(milliseconds=100)), Policy.History.KeepLast(5),
        Policy.DataRepresentation(use_cdrv0_representation=True),
    )  # fmt: skip
    writer = DataWriter(participant, Topic(participant, f"rt{topic}", Image), qos=qos)
    pixels = [number % 251 for number in range(3 * WIDTH * HEIGHT)]
    for number in range(10_000):
        header = Header(Time(7, number), "cyclone")
        writer.write(Image(header, HEIGHT, WIDTH, "rgb8", 0, 3 * WIDTH, pixels))
        time.sleep(0.1)


main(sys.argv[1])
