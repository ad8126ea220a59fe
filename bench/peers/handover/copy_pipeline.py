"""Hand-over as a message pipeline without shared memory does it: serialise, copy through a socket, deserialise.

For each message of a frame (as large as `mluc bench` found it) two processes and a Unix stream socket:

1. serialise: a header of the kind ROS messages have (sequence, stamp, frame name, length), then the array's bytes, into
   one buffer (one copy);
2. send and receive: the kernel copies twice;
3. deserialise: an array of its own for the receiver (one copy).

The clock starts when the sender's array is ready and stops when the receiver has its array. The copies are memcpy's in
numpy and the kernel; Python itself adds some 20 us a message. A real middleware adds discovery, fragments and queues.

Twice: `fresh` takes memory for every message, as message libraries do; `reused` keeps its buffers, the best that copying
can do.

copy_pipeline.py MLUC RECORD [ROUNDS]
"""

import json
import os
import pathlib
import platform
import socket
import struct
import subprocess
import sys
import tempfile
import time

import numpy

# Sequence, stamp ns, bytes of the name, bytes of the data.
HEADER = struct.Struct("<QQ16sQ")
PAUSE_S = 0.001
WARM_UP = 20


class Buffers:
    """Memory for messages: taken anew each time, or kept."""

    def __init__(self, reuses):
        self.reuses = reuses
        self.kept = {}

    def of(self, use, count):
        """So many bytes."""
        if not self.reuses:
            return bytearray(count)
        if len(self.kept.get(use, b"")) != count:
            self.kept[use] = bytearray(count)
        return self.kept[use]


def serialise(sequence, array, buffers):
    """One message as bytes."""
    message = buffers.of("message", HEADER.size + array.nbytes)
    HEADER.pack_into(message, 0, sequence, time.time_ns(), b"sensor", array.nbytes)
    numpy.frombuffer(message, dtype=numpy.uint32, offset=HEADER.size)[:] = array
    return message


def read_exactly(stream, message):
    """Fills a buffer, or ends the process."""
    view = memoryview(message)
    done = 0
    while done < len(message):
        got = stream.recv_into(view[done:])
        if got == 0:
            raise SystemExit(0)
        done += got
    return message


def receive(stream, buffers):
    """The receiving process: takes messages, tells when each one was an array, and its sum."""
    while True:
        _, _, _, size = HEADER.unpack(read_exactly(stream, bytearray(HEADER.size)))
        message = read_exactly(stream, buffers.of("message", size))
        array = numpy.frombuffer(buffers.of("array", size), dtype=numpy.uint32)
        array[:] = numpy.frombuffer(message, dtype=numpy.uint32)
        arrived_ns = time.monotonic_ns()
        stream.sendall(struct.pack("<QQ", arrived_ns, int(array.sum(dtype=numpy.uint64))))


def percentiles(times_ns):
    """As the other report has them."""
    times_us = sorted(time_ns / 1e3 for time_ns in times_ns)

    def at(share):
        return round(times_us[min(len(times_us) - 1, int(share * len(times_us)))], 2)

    return {"count": len(times_us), "p50_us": at(0.5), "p90_us": at(0.9), "p99_us": at(0.99), "max_us": at(1.0)}


def measure(payload_bytes, rounds, reuses):
    """Percentiles of the time from array to array."""
    here, there = socket.socketpair(socket.AF_UNIX, socket.SOCK_STREAM)
    child = os.fork()
    if child == 0:
        here.close()
        try:
            receive(there, Buffers(reuses))
        finally:
            os._exit(0)
    there.close()
    buffers = Buffers(reuses)
    array = numpy.zeros(payload_bytes // 4, dtype=numpy.uint32)
    times_ns = []
    for sequence in range(WARM_UP + rounds):
        time.sleep(PAUSE_S)
        array[:] = sequence
        begun_ns = time.monotonic_ns()
        here.sendall(serialise(sequence, array, buffers))
        arrived_ns, total = struct.unpack("<QQ", read_exactly(here, bytearray(16)))
        if total != sequence * len(array):
            raise RuntimeError(f"{sequence * len(array)} was sent, {total} arrived")
        if sequence >= WARM_UP:
            times_ns.append(arrived_ns - begun_ns)
    here.close()
    os.waitpid(child, 0)
    return percentiles(times_ns)


def main():
    program, record = sys.argv[1:3]
    rounds = int(sys.argv[3]) if len(sys.argv) > 3 else 500
    with tempfile.TemporaryDirectory() as out:
        bench = [program, "bench", "--seconds", "20", "--out", out]
        done = subprocess.run(bench, capture_output=True, text=True)
        if done.returncode not in (0, 3):  # 3: frames were dropped
            raise SystemExit(done.stderr)
        ours = json.loads((pathlib.Path(out) / "report.json").read_text())
    if any(topic["p50_us"] is None for topic in ours["hops"].values()):
        raise SystemExit("no frame found an idle consumer on some topic: the machine is too slow for the scans' rate, or busy")
    topics = {}
    for name, topic in ours["hops"].items():
        count = rounds if topic["payload_bytes"] < 1e7 else max(50, rounds // 4)
        copied = {name: measure(topic["payload_bytes"], count, name == "reused") for name in ["fresh", "reused"]}
        hop = {"p50_us": topic["p50_us"], "p99_us": topic["p99_us"]}
        topics[name] = {
            "payload_bytes": topic["payload_bytes"],
            "fresh": copied["fresh"],
            "reused": copied["reused"],
            "hop": hop,
            "fresh_over_hop_p50": round(copied["fresh"]["p50_us"] / hop["p50_us"], 1),
            "reused_over_hop_p50": round(copied["reused"]["p50_us"] / hop["p50_us"], 1),
        }
    total = {key: sum(topic[key]["p50_us"] for topic in topics.values()) for key in ["fresh", "reused", "hop"]}
    result = {
        "command": "bench/peers/handover/run.sh",
        "machine": ours["machine"],
        "versions": {"python": platform.python_version(), "numpy": numpy.__version__},
        "topics": topics,
        "frame_p50_us": {key: round(value, 1) for key, value in total.items()},
        "frame_reused_over_hop_p50": round(total["reused"] / total["hop"], 1),
    }
    pathlib.Path(record).write_text(json.dumps(result, indent=2) + "\n")
    print(json.dumps(result, indent=2))


if __name__ == "__main__":
    main()
