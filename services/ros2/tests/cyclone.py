"""Cyclone DDS at both ends of a pipeline: publishes KITTI's .bin files as clouds on /points until it has read the objects of each, which
must be those of the lines; then some clouds without y.

    cyclone.py DIR LINES.jsonl
"""
import json
import os
import pathlib
import sys
import time
from dataclasses import dataclass

from cyclonedds.core import Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.idl import IdlStruct
from cyclonedds.idl.types import array, float64, int32, sequence, uint8, uint32
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration

PERIOD_S = 0.2
PATIENCE_S = 60


def ros(package, name):
    return f"{package}::msg::dds_::{name}_"


@dataclass
class Time(IdlStruct, typename=ros("builtin_interfaces", "Time")):
    sec: int32
    nanosec: uint32


@dataclass
class Header(IdlStruct, typename=ros("std_msgs", "Header")):
    stamp: Time
    frame_id: str


@dataclass
class PointField(IdlStruct, typename=ros("sensor_msgs", "PointField")):
    name: str
    offset: uint32
    datatype: uint8
    count: uint32


@dataclass
class PointCloud2(IdlStruct, typename=ros("sensor_msgs", "PointCloud2")):
    header: Header
    height: uint32
    width: uint32
    fields: sequence[PointField]
    is_bigendian: bool
    point_step: uint32
    row_step: uint32
    data: sequence[uint8]
    is_dense: bool


@dataclass
class Xyz(IdlStruct, typename=ros("geometry_msgs", "Vector3")):
    x: float64
    y: float64
    z: float64


@dataclass
class Quaternion(IdlStruct, typename=ros("geometry_msgs", "Quaternion")):
    x: float64
    y: float64
    z: float64
    w: float64


@dataclass
class Pose(IdlStruct, typename=ros("geometry_msgs", "Pose")):
    position: Xyz
    orientation: Quaternion


@dataclass
class Hypothesis(IdlStruct, typename=ros("vision_msgs", "ObjectHypothesisWithPose")):
    class_id: str
    score: float64
    pose: Pose
    covariance: array[float64, 36]


@dataclass
class Detection3D(IdlStruct, typename=ros("vision_msgs", "Detection3D")):
    header: Header
    results: sequence[Hypothesis]
    center: Pose
    size: Xyz
    id: str


@dataclass
class Detection3DArray(IdlStruct, typename=ros("vision_msgs", "Detection3DArray")):
    header: Header
    detections: sequence[Detection3D]


def cloud(second, data, names):
    fields = [PointField(name, 4 * place, 7, 1) for place, name in enumerate(names)]
    header = Header(Time(second, 0), "lidar_top")
    return PointCloud2(header, 1, len(data) // 16, fields, False, 16, len(data), data, True)


def check(detections, expected):
    assert len(detections) == len(expected) > 0, (detections, expected)
    for d, o in zip(detections, expected):
        at, size = d.center.position, d.size
        assert d.results[0].class_id == o["label"], (d, o)
        found = [at.x, at.y, at.z, size.x, size.y, size.z, d.results[0].score]
        assert all(abs(a - b) < 1e-3 for a, b in zip(found, [*o["center_m"], *o["size_m"], o["score"]])), (d, o)


expected = [json.loads(line) for line in open(sys.argv[2])]
scans = [path.read_bytes() for path in sorted(pathlib.Path(sys.argv[1]).glob("*.bin"))]
participant = DomainParticipant(int(os.environ["ROS_DOMAIN_ID"]))
# As ROS 2 writes: version 1 of CDR.
cdr = Policy.DataRepresentation(use_cdrv0_representation=True)
sensor_data = Qos(Policy.Reliability.BestEffort, Policy.History.KeepLast(5), cdr)
default = Qos(Policy.Reliability.Reliable(duration(seconds=1)), Policy.History.KeepLast(10), cdr)
writer = DataWriter(participant, Topic(participant, "rt/points", PointCloud2), qos=sensor_data)
reader = DataReader(participant, Topic(participant, "rt/mluc/objects", Detection3DArray), qos=default)

begun, missing, sent = time.monotonic(), set(range(1, len(scans) + 1)), 0
while missing:
    assert time.monotonic() - begun < PATIENCE_S, f"no objects of the scans {missing}"
    second = sent % len(scans) + 1
    writer.write(cloud(second, scans[second - 1], ["x", "y", "z", "intensity"]))
    sent += 1
    time.sleep(PERIOD_S)
    for array_ in reader.take(N=100):
        second = array_.header.stamp.sec
        check(array_.detections, expected[second - 1]["objects"])
        missing.discard(second)
for _ in range(3):
    writer.write(cloud(99, scans[0], ["x", "z", "intensity"]))
    time.sleep(PERIOD_S)
