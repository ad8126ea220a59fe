"""Cyclone DDS at both ends of a pipeline: publishes KITTI's .bin files as clouds on /points until it has read the objects of each, which
must be those of the lines; then some clouds without y. With `moving` it publishes, until it is stopped, what a sensor sees that drives ahead
at 30 m/s while it turns, and where it is: on /odom, and on /tf and /tf_static.

    cyclone.py DIR LINES.jsonl [moving]
"""
import json
import math
import os
import pathlib
import struct
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
SPEED_MPS = 30
TURN_S = 0.1


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
class PoseWithCovariance(IdlStruct, typename=ros("geometry_msgs", "PoseWithCovariance")):
    pose: Pose
    covariance: array[float64, 36]


@dataclass
class Twist(IdlStruct, typename=ros("geometry_msgs", "Twist")):
    linear: Xyz
    angular: Xyz


@dataclass
class TwistWithCovariance(IdlStruct, typename=ros("geometry_msgs", "TwistWithCovariance")):
    twist: Twist
    covariance: array[float64, 36]


@dataclass
class Odometry(IdlStruct, typename=ros("nav_msgs", "Odometry")):
    header: Header
    child_frame_id: str
    pose: PoseWithCovariance
    twist: TwistWithCovariance


@dataclass
class Transform(IdlStruct, typename=ros("geometry_msgs", "Transform")):
    translation: Xyz
    rotation: Quaternion


@dataclass
class TransformStamped(IdlStruct, typename=ros("geometry_msgs", "TransformStamped")):
    header: Header
    child_frame_id: str
    transform: Transform


@dataclass
class TFMessage(IdlStruct, typename=ros("tf2_msgs", "TFMessage")):
    transforms: sequence[TransformStamped]


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
    header, step = Header(Time(second, 0), "lidar_top"), 16 if len(names) < 5 else 20
    return PointCloud2(header, 1, len(data) // step, fields, False, step, len(data), data, True)


def seen_moving(scan):
    """The scan as seen while driving: each point with its time after the stamp, when the sensor is nearer to what lies ahead."""
    points = list(struct.iter_unpack("<4f", scan))
    times_s = [TURN_S * (0.5 + math.atan2(y, x) / math.tau) for x, y, _, _ in points]
    rows = [struct.pack("<5f", x - SPEED_MPS * t, y, z, w, t) for (x, y, z, w), t in zip(points, times_s)]
    return b"".join(rows)


def move(participant, scans):
    """Each scan in turn, after the poses around its turn."""

    def writer(name, kind, qos):
        return DataWriter(participant, Topic(participant, f"rt/{name}", kind), qos=qos)

    latched = Qos(Policy.Reliability.Reliable(duration(seconds=1)), Policy.Durability.TransientLocal, cdr)
    points = writer("points", PointCloud2, sensor_data)
    odom, tf = writer("odom", Odometry, default), writer("tf", TFMessage, default)
    tf_static = writer("tf_static", TFMessage, latched)
    still, zero = Quaternion(0, 0, 0, 1), Xyz(0, 0, 0)
    mounted = TransformStamped(Header(Time(0, 0), "base_link"), "lidar_top", Transform(Xyz(0.5, 0, 1), still))
    tf_static.write(TFMessage([mounted]))
    scans = [seen_moving(scan) for scan in scans]
    begun, sent = time.monotonic(), 0
    while time.monotonic() - begun < PATIENCE_S:
        second = 10 + sent
        for tenth_ms in range(-500, 2001, 250):
            at = second * 10_000 + tenth_ms
            header = Header(Time(at // 10_000, at % 10_000 * 100_000), "odom")
            here = Xyz(SPEED_MPS * at / 10_000, 0, 0)
            pose = PoseWithCovariance(Pose(here, still), [0] * 36)
            odom.write(Odometry(header, "base_link", pose, TwistWithCovariance(Twist(zero, zero), [0] * 36)))
            tf.write(TFMessage([TransformStamped(header, "base_link", Transform(here, still))]))
        time.sleep(PERIOD_S / 2)
        points.write(cloud(second, scans[sent % len(scans)], ["x", "y", "z", "intensity", "time"]))
        sent += 1
        time.sleep(PERIOD_S / 2)


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
if "moving" in sys.argv:
    move(participant, scans)
    sys.exit()
writer = DataWriter(participant, Topic(participant, "rt/points", PointCloud2), qos=sensor_data)
reader = DataReader(participant, Topic(participant, f"rt/{sys.argv[3]}/objects", Detection3DArray), qos=default)

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
