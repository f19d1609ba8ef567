"""Reads a camera's label names and its transform with Cyclone DDS, and prints them."""

import sys
import time
from dataclasses import dataclass

from cyclonedds.core import Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.idl import IdlStruct
from cyclonedds.idl.types import float32, float64, int32, sequence, uint16, uint32
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration

TIMEOUT_S = 30


@dataclass
class Time(IdlStruct, typename="builtin_interfaces::msg::dds_::Time_"):
    """When."""

    sec: int32
    nanosec: uint32


@dataclass
class Header(IdlStruct, typename="std_msgs::msg::dds_::Header_"):
    """When and where."""

    stamp: Time
    frame_id: str


@dataclass
class VisionClass(IdlStruct, typename="vision_msgs::msg::dds_::VisionClass_"):
    """A class."""

    class_id: uint16
    class_name: str


@dataclass
class LabelInfo(IdlStruct, typename="vision_msgs::msg::dds_::LabelInfo_"):
    """All classes."""

    header: Header
    class_map: sequence[VisionClass]
    threshold: float32


@dataclass
class Vector3(IdlStruct, typename="geometry_msgs::msg::dds_::Vector3_"):
    """Meters."""

    x: float64
    y: float64
    z: float64


@dataclass
class Quaternion(IdlStruct, typename="geometry_msgs::msg::dds_::Quaternion_"):
    """A rotation."""

    x: float64
    y: float64
    z: float64
    w: float64


@dataclass
class Transform(IdlStruct, typename="geometry_msgs::msg::dds_::Transform_"):
    """A place."""

    translation: Vector3
    rotation: Quaternion


@dataclass
class TransformStamped(IdlStruct, typename="geometry_msgs::msg::dds_::TransformStamped_"):
    """A place with its frames."""

    header: Header
    child_frame_id: str
    transform: Transform


@dataclass
class TFMessage(IdlStruct, typename="tf2_msgs::msg::dds_::TFMessage_"):
    """Several places."""

    transforms: sequence[TransformStamped]


def first(participant: DomainParticipant, name: str, data_type: type) -> object:
    """The message that a late subscriber gets."""
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


main(sys.argv[1])
