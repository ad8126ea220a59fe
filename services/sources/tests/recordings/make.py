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
