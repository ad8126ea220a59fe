"""What others' packages read of `mluc view` and `mluc record`: the package websockets as client of the Foxglove WebSocket protocol,
mcap and mcap-ros2-support for files and CDR.

    check.py socket ADDRESS     check.py file RUN.mcap LINES.jsonl
"""
import json
import socket
import struct
import sys
import urllib.request

from mcap.reader import make_reader
from mcap.records import Schema
from mcap_ros2.decoder import DecoderFactory
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

PROTOCOLS = ["foxglove.sdk.v1"]
ROS = ["/mluc/points", "/mluc/objects", "/mluc/markers", "/diagnostics", "/tf"]


def same(found, expected):
    assert len(found) == len(expected) and all(abs(a - b) < 1e-4 for a, b in zip(found, expected)), (found, expected)


def xyz(vector):
    return [vector.x, vector.y, vector.z]


def stamp_ns(header):
    return header.stamp.sec * 10**9 + header.stamp.nanosec


def check_objects(array, line):
    assert stamp_ns(array.header) == line["stamp_ns"]
    assert [d.results[0].hypothesis.class_id for d in array.detections] == [o["label"] for o in line["objects"]]
    for detection, o in zip(array.detections, line["objects"]):
        same(xyz(detection.bbox.center.position), o["center_m"])
        same(xyz(detection.bbox.size), o["size_m"])
        same([detection.results[0].hypothesis.score], [o["score"]])
        assert detection.results[0].pose.pose.orientation.w == detection.bbox.center.orientation.w
        assert len(detection.results[0].pose.covariance) == 36


def check_cloud(cloud, line):
    """Whether the points know their objects."""
    names = [(f.name, f.offset, f.datatype) for f in cloud.fields]
    assert names == [("x", 0, 7), ("y", 4, 7), ("z", 8, 7), ("intensity", 12, 7), ("object", 16, 5)], names
    data = bytes(cloud.data)
    assert (cloud.point_step, cloud.is_dense, cloud.is_bigendian) == (20, True, False)
    assert len(data) == cloud.row_step == 20 * cloud.width > 0
    owners = [owner for *_, owner in struct.iter_unpack("<4fi", data)]
    if max(owners) < 0:
        return False
    points = [owners.count(place) for place in range(len(line["objects"]))]
    # A point of two objects counts for one of them.
    assert all(found <= o["points"] for found, o in zip(points, line["objects"])), points
    assert sum(points) == len(owners) - owners.count(-1)
    return True


def check_rest(markers, states, tf, line):
    first, *others = markers.markers
    assert first.action == 3 and len(others) == 2 * len(line["objects"])
    for cube, words, o in zip(others[::2], others[1::2], line["objects"]):
        assert (cube.type, words.type, cube.ns) == (1, 9, o["label"])
        assert words.text == f"{o['label']} {o['score']:.2f}" or abs(float(words.text.split()[-1]) - o["score"]) < 0.01
        same(xyz(cube.scale), o["size_m"])
        assert cube.color.a > 0 and cube.mesh_resource == "" and cube.pose.orientation.w <= 1
    assert len({(m.ns, m.id) for m in others}) == len(others)
    assert [s.name for s in states.status] == [f"mluc {states.status[0].hardware_id}: {n}" for n in ("pipeline", "ingest", "backbone", "head", "refiner")]
    values = {v.key: v.value for v in states.status[0].values}
    assert int(values["frames_out"]) >= 0 and values["state"] in states.status[0].message
    (transform,) = tf.transforms
    assert transform.header.frame_id == "base_link" and transform.transform.rotation.w == 1.0


def check_socket(address):
    page = urllib.request.urlopen(f"http://{address}/", timeout=10).read().decode()
    assert "<title>mluc view</title>" in page
    url = f"ws://{address}/"
    for origin, protocols in [("http://elsewhere.example", PROTOCOLS), (f"http://{address}", ["soap"])]:
        try:
            connect(url, subprotocols=protocols, origin=origin)
            raise AssertionError(f"{origin} {protocols} was taken")
        except InvalidStatus as error:
            assert error.response.status_code == 403
    with socket.create_connection(address.split(":")) as garbage:
        garbage.sendall(b"\x16\x03\x01 \r\nupgrade: websocket\r\nsec-websocket-protocol: foxglove.sdk.v1\r\n\xff\x00\r\n\r\n")

    # Subscribes to all, and reads nothing from then on: its threads stop at the first messages.
    idle = connect(url, subprotocols=PROTOCOLS, max_queue=1)
    with connect(url, subprotocols=PROTOCOLS, origin=f"http://{address}", max_size=None) as client:
        assert json.loads(client.recv())["op"] == "serverInfo"
        channels = {c["id"]: c for c in json.loads(client.recv())["channels"]}
        assert sorted(c["topic"] for c in channels.values()) == sorted([*ROS, "/mluc/frame"])
        decoder = DecoderFactory().decoder_for
        decode = {i: decoder("cdr", Schema(i, c["schema"].encode(), "ros2msg", c["schemaName"]))
                  for i, c in channels.items() if c["encoding"] == "cdr"}
        for text in ["{", "[]", '{"op":"advertise"}', '{"op":"subscribe","subscriptions":[{"id":1,"channelId":77}]}']:
            client.send(text)
            assert json.loads(client.recv())["op"] == "status", text
        client.send(b"\x01")
        assert json.loads(client.recv())["op"] == "status"
        subscribe = {"op": "subscribe", "subscriptions": [{"id": 100 + i, "channelId": i} for i in channels]}
        for socket_ in (idle, client):
            socket_.send(json.dumps(subscribe))
        times, whole, owned = {}, 0, 0
        while whole < 5 or not owned:
            message = client.recv(timeout=20)
            opcode, number, time_ns = struct.unpack_from("<BIQ", message)
            channel = channels[number - 100]
            assert opcode == 1
            data = message[13:]
            times = {time_ns: times.get(time_ns, {})}
            times[time_ns][channel["topic"]] = json.loads(data) if channel["encoding"] == "json" else decode[channel["id"]](data)
            moment = times[time_ns]
            if len(moment) == len(channels):
                line = moment["/mluc/frame"]
                check_objects(moment["/mluc/objects"], line)
                owned += check_cloud(moment["/mluc/points"], line)
                check_rest(moment["/mluc/markers"], moment["/diagnostics"], moment["/tf"], line)
                whole += 1
        client.send(json.dumps({"op": "unsubscribe", "subscriptionIds": [100 + i for i in channels]}))
    print(f"{whole} frames")


def check_file(path, lines):
    by_stamp = {line["stamp_ns"]: line for line in map(json.loads, open(lines)) if "objects" in line}
    counts = dict.fromkeys([*ROS, "/mluc/frame"], 0)
    matched = owned = 0
    with open(path, "rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        assert reader.get_header().profile == "ros2"
        for _, channel, _, message in reader.iter_decoded_messages():
            counts[channel.topic] += 1
            line = by_stamp.get(stamp_ns(message.header)) if hasattr(message, "header") else None
            if channel.topic == "/mluc/objects" and line:
                check_objects(message, line)
                matched += 1
            elif channel.topic == "/mluc/frame":
                told = json.loads(message.data)
                assert told["objects"] == by_stamp.get(told["stamp_ns"], told)["objects"]
            elif channel.topic == "/mluc/points" and line:
                owned += check_cloud(message, line)
    assert all(counts.values()) and matched >= 3 and owned >= 1, (counts, matched, owned)
    print(counts, f"{matched} frames as `mluc up` told them, {owned} whose points know their objects")


check = {"socket": check_socket, "file": check_file}[sys.argv[1]]
check(*filter(None, sys.argv[2:]))
