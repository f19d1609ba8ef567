"""Reads a camera's label names and its transform with Cyclone DDS, and prints them."""

import sys
import time

from cyclone_messages import LabelInfo, TFMessage
from cyclonedds.core import Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration

TIMEOUT_S = 30


def first(participant: DomainParticipant, name: str, data_type: type) -> object:
    """The first message that a late subscriber receives."""
    qos = Qos(
        Policy.Reliability.Reliable(duration(milliseconds=100)), Policy.Durability.TransientLocal,
        Policy.History.KeepLast(1), Policy.DataRepresentation(use_cdrv0_representation=True),
    )  # fmt: skip
    reader = DataReader(participant, Topic(participant, name, data_type), qos=qos)
    end = time.monotonic() + TIMEOUT_S
    while time.monotonic() < end:
        for sample in reader.take(1):
            return sample
        time.sleep(0.05)
    raise SystemExit(f"nothing arrived on {name}")


def main(camera: str) -> None:
    """Prints a line for each class and each transform."""
    participant = DomainParticipant(0)
    for transform in first(participant, "rt/tf_static", TFMessage).transforms:
        place = transform.transform.translation
        frames = f"{transform.header.frame_id} {transform.child_frame_id}"
        print(f"transform {frames} {place.x:.3f} {place.y:.3f} {place.z:.3f}")
    for label in first(participant, f"rt/{camera}/labels/label_info", LabelInfo).class_map:
        print(f"class {label.class_id} {label.class_name}")


if __name__ == "__main__":
    main(sys.argv[1])
