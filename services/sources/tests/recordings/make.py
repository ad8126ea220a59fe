"""Makes the recordings of ../recordings.rs, with MCAP's own Python packages:
pip install mcap mcap-ros2-support mcap-protobuf-support foxglove-schemas-protobuf; python3 make.py

Three points, as rows of f32 x, u16 ring, f64 y, f32 z, u8 intensity * 4; stamped 5.000000006 s, recorded at 1.0 and 1.1 s.
"""
import struct

from foxglove_schemas_protobuf.PackedElementField_pb2 import PackedElementField
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud
from mcap.writer import CompressionType, Writer
from mcap_protobuf.schema import build_file_descriptor_set
from mcap_ros2.writer import Writer as RosWriter

POINTS = [(1.0, 2.0, 3.0, 0.5), (-4.0, 5.5, -6.0, 0.25), (7.0, -8.0, 9.0, 1.0)]
TIMES_NS = (1_000_000_000, 1_100_000_000)
FIELDS = [("x", 0, 7), ("ring", 4, 4), ("y", 6, 8), ("z", 14, 7), ("intensity", 18, 2)]
DEFINITION = """std_msgs/Header header
uint32 height
uint32 width
sensor_msgs/PointField[] fields
bool is_bigendian
uint32 point_step
uint32 row_step
uint8[] data
bool is_dense
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
================================================================================
MSG: sensor_msgs/PointField
string name
uint32 offset
uint8 datatype
uint32 count
"""


def rows(order, padding=0):
    row = lambda p: struct.pack(order + "fHdfB", p[0], 7, p[1], p[2], int(4 * p[3])) + b"\xee" * padding
    return b"".join(row(p) for p in POINTS)


def by_hand(order, is_ros1=False, padding=0, fields=FIELDS):
    """CDR of either order, or ROS 1; a row a point."""
    out = bytearray(struct.pack("<I", 9) if is_ros1 else (b"\0\1\0\0" if order == "<" else b"\0\0\0\0"))
    numbers = "<" if is_ros1 else order

    def number(value):
        out.extend(b"\xee" * (0 if is_ros1 else -len(out) % 4) + struct.pack(numbers + "I", value))

    def text(word):
        word = word.encode() + (b"" if is_ros1 else b"\0")
        number(len(word))
        out.extend(word)

    number(5), number(6), text("lidar"), number(3), number(1), number(len(fields))
    for name, offset, datatype in fields:
        text(name), number(offset)
        out.append(datatype)
        number(1)
    out.append(order == ">")
    data = rows(order, padding)
    number(19), number(19 + padding), number(len(data))
    return bytes(out) + data + b"\1"


def ros2():
    fields = [dict(name=n, offset=o, datatype=d, count=1) for n, o, d in FIELDS]
    header = dict(stamp=dict(sec=5, nanosec=6), frame_id="lidar")
    return dict(header=header, height=1, width=3, fields=fields, is_bigendian=False, point_step=19, row_step=57, data=rows("<"), is_dense=True)


def foxglove():
    kinds = dict(zip(range(1, 9), (2, 1, 4, 3, 6, 5, 7, 8)))
    cloud = PointCloud(frame_id="lidar", point_stride=19, data=rows("<"))
    cloud.timestamp.seconds, cloud.timestamp.nanos = 5, 6
    cloud.fields.extend(PackedElementField(name=n, offset=o, type=kinds[d]) for n, o, d in FIELDS)
    return cloud.SerializeToString()


def write(path, topics, **options):
    """`topics`: name, schema, its encoding, its text, encoding of the messages, a message."""
    with open(path, "wb") as file:
        writer = Writer(file, **options)
        writer.start()
        channels = []
        for topic, schema, schema_encoding, text, encoding, message in topics:
            schema = writer.register_schema(schema, schema_encoding, text)
            channels.append((writer.register_channel(topic, encoding, schema), message))
        for number, time_ns in enumerate(TIMES_NS):
            for channel, message in channels:
                writer.add_message(channel, time_ns, message, time_ns, number)
        writer.finish()


def ros(topic, message):
    return topic, "sensor_msgs/msg/PointCloud2", "ros2msg", b"", "cdr", message


lost = [("a", 0, 7)] + FIELDS[1:]
other = ("/rosout", "rcl_interfaces/msg/Log", "ros2msg", b"", "cdr", b"\0\1\0\0")
proto = build_file_descriptor_set(PointCloud).SerializeToString()
write("clouds.mcap", [
    other,
    ros("/big_endian", by_hand(">")),
    ros("/padded_rows", by_hand("<", padding=5)),
    ("/ros1", "sensor_msgs/PointCloud2", "ros1msg", b"", "ros1", by_hand("<", is_ros1=True)),
    ("/foxglove", "foxglove.PointCloud", "protobuf", proto, "protobuf", foxglove()),
    ("/json", "foxglove.PointCloud", "jsonschema", b"", "json", b"{}"),
    ros("/no_x", by_hand("<", fields=lost)),
    ros("/cut", by_hand("<")[:-20]),
], compression=CompressionType.ZSTD)
write("plain.mcap", [other, ros("/points", by_hand("<"))], compression=CompressionType.NONE, enable_crcs=False)
write("lz4.mcap", [ros("/points", by_hand("<"))], compression=CompressionType.LZ4, chunk_size=100)
write("unchunked.mcap", [ros("/points", by_hand("<"))], use_chunking=False)
with open("ros2.mcap", "wb") as file:
    writer = RosWriter(file)
    schema = writer.register_msgdef("sensor_msgs/msg/PointCloud2", DEFINITION)
    for number, time_ns in enumerate(TIMES_NS):
        writer.write_message("/points", schema, ros2(), time_ns, time_ns, number)
    writer.finish()


# A sensor that is turned by 90 degrees on a robot that drives ahead at 10 m/s: ten points 10 m before it, 10 ms apart, from the stamp on.
HEADER = "std_msgs/Header header\n"
TYPES = """================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
================================================================================
MSG: geometry_msgs/Pose
geometry_msgs/Vector3 position
geometry_msgs/Quaternion orientation
================================================================================
MSG: geometry_msgs/Vector3
float64 x
float64 y
float64 z
================================================================================
MSG: geometry_msgs/Quaternion
float64 x
float64 y
float64 z
float64 w
================================================================================
MSG: geometry_msgs/PoseWithCovariance
geometry_msgs/Pose pose
float64[36] covariance
================================================================================
MSG: geometry_msgs/Transform
geometry_msgs/Vector3 translation
geometry_msgs/Quaternion rotation
================================================================================
MSG: geometry_msgs/TransformStamped
std_msgs/Header header
string child_frame_id
geometry_msgs/Transform transform
"""
with open("moving.mcap", "wb") as file:
    writer = RosWriter(file)
    cloud = writer.register_msgdef("sensor_msgs/msg/PointCloud2", DEFINITION)
    odometry = writer.register_msgdef("nav_msgs/msg/Odometry", HEADER + "string child_frame_id\ngeometry_msgs/PoseWithCovariance pose\n" + TYPES)
    pose = writer.register_msgdef("geometry_msgs/msg/PoseStamped", HEADER + "geometry_msgs/Pose pose\n" + TYPES)
    tf = writer.register_msgdef("tf2_msgs/msg/TFMessage", "geometry_msgs/TransformStamped[] transforms\n" + TYPES)

    def send(topic, schema, time_ms, message):
        writer.write_message(topic, schema, message, time_ms * 1_000_000, time_ms * 1_000_000)

    def header(time_ms, frame):
        return dict(stamp=dict(sec=time_ms // 1000, nanosec=time_ms % 1000 * 1_000_000), frame_id=frame)

    def transform(time_ms, parent, child, x, z, rotation):
        return dict(header=header(time_ms, parent), child_frame_id=child, transform=dict(translation=dict(x=x, y=0.0, z=z), rotation=rotation))

    ahead, left = dict(x=0.0, y=0.0, z=0.0, w=1.0), dict(x=0.0, y=0.0, z=0.5**0.5, w=0.5**0.5)
    mount = transform(5000, "base_link", "lidar", 1.0, 0.5, left)
    send("/tf_static", tf, 5000, dict(transforms=[mount]))
    data = b"".join(struct.pack("<fffI", 10.0, 0.0, -1.0, i * 10_000_000) for i in range(11))
    fields = [dict(name=n, offset=4 * i, datatype=7 if i < 3 else 6, count=1) for i, n in enumerate("xyzt")]
    for time_ms in range(5000, 5300, 50):
        x = 0.01 * (time_ms - 5000)
        where = dict(position=dict(x=x, y=0.0, z=0.0), orientation=ahead)
        send("/odom", odometry, time_ms, dict(header=header(time_ms, "odom"), child_frame_id="base_link", pose=dict(pose=where, covariance=[0.0] * 36)))
        send("/pose", pose, time_ms, dict(header=header(time_ms, "map"), pose=where))
        send("/tf", tf, time_ms, dict(transforms=[transform(time_ms, "odom", "base_link", x, 0.0, ahead)]))
        # A turn is sent when it is over.
        if time_ms in (5100, 5200):
            send("/points", cloud, time_ms, dict(header=header(time_ms - 100, "lidar"), height=1, width=11, fields=fields, is_bigendian=False, point_step=16, row_step=176, data=data, is_dense=True))
    writer.finish()
