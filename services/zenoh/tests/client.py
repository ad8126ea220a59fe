"""Another zenoh client, from a package: listens, prints the frames that it hears, and at the end which keys it heard.

    client.py PORT COUNT"""
import json
import sys
import threading

import zenoh

port, count = map(int, sys.argv[1:])
config = zenoh.Config()
config.insert_json5("mode", '"peer"')
config.insert_json5("scouting/multicast/enabled", "false")
config.insert_json5("listen/endpoints", json.dumps([f"tcp/127.0.0.1:{port}"]))
done, frames, sizes = threading.Event(), [], {}


def hear(sample):
    payload = sample.payload.to_bytes()
    name = str(sample.key_expr).rsplit("/", 1)[1]
    sizes[name] = len(payload)
    if name == "frame":
        assert sample.encoding == zenoh.Encoding.APPLICATION_JSON, sample.encoding
        frames.append(payload.decode())
    if len(frames) >= count and len(sizes) == 5:
        done.set()


with zenoh.open(config) as session:
    subscriber = session.declare_subscriber("mluc/*/*", hear)
    if not done.wait(60):
        sys.exit(f"expected {count} frames and five keys, heard {len(frames)} and {sizes}")
    subscriber.undeclare()
print("\n".join(frames))
print(json.dumps({"keys": sorted(sizes)}))
