"""The refiner's side of the contract (docs/CONTRACT.md) for Python: joining, following runs, frames, publishing, heartbeats.

Needs iceoryx2 and numpy from PyPI. Points and detections are numpy views onto shared memory: nothing is copied.
"""

import ctypes as C
import fcntl
import glob
import os
import shutil
import signal
import sys
import time
from types import SimpleNamespace

import iceoryx2 as iox
import numpy as np

WIRE_VERSION, REFINER, NONE = 5, 3, 2**32 - 1
POINTS_MAX, OBJECT_POINTS_MAX, DETECTIONS_MAX, HEARTBEAT_NS, SILENCE_NS = 262_144, 131_072, 512, 100_000_000, 1_000_000_000
THINNED = 4  # a bit of an object's flags
# Bits of a header's flags.
DEGRADED, LIMIT_HIT, NOT_FINITE, POINTS_GONE, LIMIT_OBJECT_POINTS = 1 << 2, 1 << 3, 1 << 5, 1 << 7, 1 << 13
PUBLISHED, OVERLAPS_KNOWN, OVERLAPS_UNKNOWN, TOO_FEW_POINTS, OVERSIZED, INVALID_BOX, UNCONFIRMED, UNDERSIZED, LOW_SCORE = range(9)
STATES, STATUS_AGE_MAX_NS = ("starting", "running", "degraded", "blind", "late", "stopped"), 2_000_000_000
STARTING, WAITING_INPUT, RUNNING, BAD, FAILED, STOPPING = range(6)


def struct(name, text):
    """A C struct with the contract's type name; "center_m:3f" is float center_m[3]."""
    kinds = {"u": C.c_uint32, "U": C.c_uint64, "f": C.c_float, "d": C.c_double, "b": C.c_ubyte}
    pairs = [word.split(":") for word in text.split()]
    fields = [(field, kinds[kind[-1]] * int(kind[:-1]) if kind[:-1] else kinds[kind]) for field, kind in pairs]
    return type(name, (C.Structure,), {"_fields_": fields, "type_name": staticmethod(lambda: "mluc." + name)})


FrameHeader = struct("FrameHeader", """wire_version:u flags:u run_id:U sequence:U sensor_stamp_ns:U sensor_id:u attempt:u
    points_in:u points_dropped:u points_out_of_range:u feature_rows:u feature_channels:u limit_dropped:u
    model_fingerprint:U ego_position_m:3d ego_yaw_rad:d ego_is_known:u ego_reserved:u stages:12U name:48b""")
Point = struct("Point", "x_m:f y_m:f z_m:f intensity:f")
Detection = struct("Detection", """center_m:3f size_m:3f yaw_rad:f class_id:u kind:u cell:u objectness:f score:f
    probabilities:8f embedding:8f eds:f eds_normalised:f eds_perpendicular:f delta:f softmax_max:f logit_max:f energy:f
    unknown_probability:f gate:u threshold:f""")
Object = struct("Object", """kind:u disposition:u suppressed_by:u class_id:u score:f center_m:3f size_m:3f yaw_rad:f
    eds:f eds_normalised:f unknown_probability:f gate:u threshold:f points_first:u points_count:u flags:u track_id:u overlap:f
    footprint_count:u footprint_m:32f""")
Health = struct("Health", """wire_version:u stage:u state:u pid:u run_id:U frames_in:U frames_out:U frames_dropped:U
    messages_refused:U run_p50_us:u run_p99_us:u run_max_us:u bytes_written:u bytes_read:U mappings_verified:U
    candidates:12U reason:192b""")
RunDescription = struct("RunDescription", """wire_version:u classes_count:u run_id:U started_ns:U model_fingerprint:U
    base_from_sensor:6d sensor_height_m:f objectness_min:f gate:u gate_threshold:f model_name:64b sensor_name:64b
    class_names:256b known_score:96b unknown_score:96b""")
Status = struct("Status", """wire_version:u state:u run_id:U judged_ns:U sequence:U age_ns:U frames_in:U frames_out:U
    frames_dropped:U frames_late:U stages_out:4U stages_late:4U blind_sectors:U not_finite_share:f is_ground_lost:u
    reason:192b""")
# element, elements, subscribers, buffer, borrowed, loans, history: both sides open or make a topic with the same ones.
TOPICS = {
    "points": (Point, POINTS_MAX, 6, 2, 5, 2, 0),
    "detections": (Detection, DETECTIONS_MAX, 4, 2, 5, 2, 1),
    "objects": (Object, 512, 8, 2, 5, 2, 1),
    "object_points": (C.c_uint32, OBJECT_POINTS_MAX, 3, 1, 2, 1, 0),
    "health/refiner": (Health, 1, 8, 2, 5, 2, 1),
    "run": (RunDescription, 1, 16, 1, 1, 1, 1),
    "status": (Status, 1, 16, 1, 1, 1, 1),
}


def view(sample, element, count):
    """A numpy view of a sample's elements; valid while the sample is held."""
    data = (C.c_ubyte * (count * C.sizeof(element))).from_address(sample.payload_ptr)
    array = np.frombuffer(data, np.dtype(element))
    array.flags.writeable = False
    return array


def header_of(sample):
    return FrameHeader.from_buffer_copy(C.string_at(sample.user_header_ptr, C.sizeof(FrameHeader)))


def stem():
    return f"mluc-{os.geteuid()}-{os.environ.get('MLUC_INSTANCE') or 'default'}"


def make_node(stem):
    config = iox.config.default()
    config.global_cfg.prefix = iox.FileName.new(stem + ".")
    config.global_cfg.root_path = iox.Path.new("/dev/shm/" + stem)
    iox.set_log_level(iox.LogLevel.Fatal)
    builder = iox.NodeBuilder.new().config(config).signal_handling_mode(iox.SignalHandlingMode.Disabled)
    return builder.create(iox.ServiceType.Ipc)


def open_topic(node, name):
    element, _, subscribers, buffer, borrowed, _, history = TOPICS[name]
    service = iox.ServiceName.new("mluc/" + name)
    data = node.service_builder(service).publish_subscribe(iox.Slice[element]).user_header(FrameHeader)
    data = data.enable_safe_overflow(True).max_publishers(1).max_subscribers(subscribers).max_nodes(16)
    data = data.subscriber_max_buffer_size(buffer).subscriber_max_borrowed_samples(borrowed).history_size(history)
    wake = node.service_builder(service).event().max_notifiers(4).max_listeners(subscribers)
    return data.open_or_create(), wake.max_nodes(16).event_id_max_value(1).open_or_create()


class Watch:
    """For consumers: what the pipeline is worth, so that "nothing there" can be told from "blind", "late" and "stopped"."""

    def __init__(self):
        self.lock = open(f"/dev/shm/{stem()}/.lock")
        fcntl.flock(self.lock, fcntl.LOCK_SH)
        self.node = make_node(stem())
        self.statuses, self.last = open_topic(self.node, "status")[0].subscriber_builder().create(), None

    def status(self):
        """State word, reason, and the whole Status; None before the supervisor has published one."""
        while (sample := self.statuses.receive()) is not None:
            status = Status.from_buffer_copy(C.string_at(sample.payload_ptr, C.sizeof(Status)))
            sample.delete()
            if status.wire_version == WIRE_VERSION and status.state < len(STATES):
                self.last = status
        if self.last is None:
            return None
        if time.monotonic_ns() - self.last.judged_ns > STATUS_AGE_MAX_NS and self.last.state != STATES.index("stopped"):
            return "stopped", "the supervisor hangs or is gone", self.last
        reason = bytes(self.last.reason).rstrip(b"\0").decode(errors="replace")
        return STATES[self.last.state], reason, self.last


class Refiner:
    """This process as the refiner of the instance that `MLUC_INSTANCE` names, in one run after the other."""

    def __init__(self):
        self.root = "/dev/shm/" + stem()
        self.join(self.root)
        self.node = make_node(stem())
        self.outputs = {name: self.output(name) for name in ("objects", "object_points", "health/refiner")}
        self.descriptions = open_topic(self.node, "run")[0].subscriber_builder().create()
        self.points = open_topic(self.node, "points")[0].subscriber_builder().create()
        detections, wake = open_topic(self.node, "detections")
        self.detections = detections.subscriber_builder().create()
        self.listener = wake.listener_builder().create()
        self.scans, self.times, self.beats, self.is_stopping = [], [0], 0, False
        self.run, self.classes, self.last, self.sent = RunDescription(), 8, None, 0
        self.health = Health(wire_version=WIRE_VERSION, stage=REFINER, pid=os.getpid())
        for number in (signal.SIGTERM, signal.SIGINT):
            signal.signal(number, self.stop)
        self.say(WAITING_INPUT, "waiting for a run")
        self.follow()

    def join(self, root):
        """Lives in the instance until it ends, as its only refiner; refuses another version by name."""
        try:
            self.locks = open(root + "/.lock"), open(root + "/refiner.pid", "a")
            begun = open(root + "/contract").read().strip()
            fcntl.flock(self.locks[0], fcntl.LOCK_SH)
            fcntl.flock(self.locks[1], fcntl.LOCK_EX | fcntl.LOCK_NB)
        except FileNotFoundError as error:
            sys.exit(f"no pipeline runs there, start `mluc up` first: {error}")
        except BlockingIOError:
            sys.exit(f"another refiner runs already: stop it first ({root}/refiner.pid)")
        if f"wire={WIRE_VERSION}" not in begun.split():
            sys.exit(f"this refiner speaks wire version {WIRE_VERSION}, {root} {begun}: run the same mluc twice")

    def output(self, name):
        data, wake = open_topic(self.node, name)
        port = data.publisher_builder().initial_max_slice_len(TOPICS[name][1]).max_loaned_samples(TOPICS[name][5])
        port = port.allocation_strategy(iox.AllocationStrategy.Static)
        port = port.backpressure_strategy(iox.BackpressureStrategy.DiscardData)
        return port.create(), wake.notifier_builder().create()

    def send(self, name, header, data):
        port, notifier = self.outputs[name]
        sample = port.loan_slice_uninit(len(data))
        header.stages[3 * REFINER + 2] = time.monotonic_ns()
        C.memmove(sample.user_header_ptr, C.addressof(header), C.sizeof(header))
        C.memmove(sample.payload_ptr, data.ctypes.data, data.nbytes)
        sample.assume_init().send()
        notifier.notify()

    def follow(self):
        """The topic `run` describes the run; a description with another id begins a new one."""
        while (sample := self.descriptions.receive()) is not None:
            run = RunDescription.from_buffer_copy(C.string_at(sample.payload_ptr, C.sizeof(RunDescription)))
            sample.delete()
            if run.wire_version != WIRE_VERSION or run.run_id in (0, self.run.run_id):
                continue
            self.run, self.classes, self.last, self.sent = run, run.classes_count, None, 0
            while self.scans:
                self.scans.pop().delete()
            self.health.run_id = run.run_id
            self.say(WAITING_INPUT, "waiting for detections")

    def stop(self, *_):
        self.is_stopping = True

    def say(self, state, reason=""):
        """A heartbeat: every 0.1 s, and at once when the state changes."""
        self.health.state, self.health.reason[:] = state, reason.encode()[:192].ljust(192, b"\0")
        percentiles = np.percentile(self.times[-1000:], (50, 99, 100))
        self.health.run_p50_us, self.health.run_p99_us, self.health.run_max_us = (int(run) for run in percentiles)
        header = FrameHeader(wire_version=WIRE_VERSION, run_id=self.run.run_id, sequence=self.beats)
        self.send("health/refiner", header, np.frombuffer(self.health, np.dtype(Health)))
        self.beats, self.said_ns, self.state = self.beats + 1, time.monotonic_ns(), (state, reason)

    def refuse(self, reason):
        self.health.messages_refused += 1
        print(f"message refused: {reason}", file=sys.stderr)
        self.say(BAD, reason)

    def frames(self):
        """Frame after frame, always the newest, until this process is asked to end."""
        heard_ns = time.monotonic_ns()
        while not self.is_stopping:
            try:
                self.listener.timed_wait(iox.Duration.from_millis(50))
            except iox.ListenerWaitError:  # a signal came
                continue
            newest = self.newest_detections()
            self.follow()
            self.take_scans()
            if newest is not None:
                frame, heard_ns = self.frame(newest), time.monotonic_ns()
                if frame is not None:
                    yield frame
                newest.delete()
            silence_ns = time.monotonic_ns() - heard_ns
            if silence_ns > SILENCE_NS and self.state[0] != WAITING_INPUT:
                self.say(WAITING_INPUT, "waiting for detections: their producer is silent or gone")
            elif time.monotonic_ns() - self.said_ns > HEARTBEAT_NS:
                self.say(*self.state)
        self.leave()

    def leave(self):
        """Says so, and removes the instance's files where nobody else is left in it."""
        self.say(STOPPING)
        try:
            fcntl.flock(self.locks[0], fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            return
        shutil.rmtree(self.root, ignore_errors=True)
        for path in glob.glob(self.root + ".*"):
            os.unlink(path)

    def newest_detections(self):
        newest = None
        while (sample := self.detections.receive()) is not None:
            if newest is not None:
                newest.delete()
            newest, self.received_ns = sample, time.monotonic_ns()
        return newest

    def take_scans(self):
        """Holds the two scans before the last frame's and the newest two: detections come later than points."""
        while (scan := self.points.receive()) is not None:
            header = header_of(scan)
            if (header.wire_version, header.run_id) != (WIRE_VERSION, self.run.run_id):
                scan.delete()
                continue
            self.sent = max(self.sent, header.sequence + 1)
            self.scans.append(scan)
            if len(self.scans) > 4:
                self.scans.pop(2).delete()

    def frame(self, sample):
        """Header, points and detections of a sample; None: refused."""
        header = header_of(sample)
        header.stages[3 * REFINER : 3 * REFINER + 2] = self.received_ns, time.monotonic_ns()
        for what, found, expected in (
            ("wire version of the sender", header.wire_version, WIRE_VERSION),
            ("run", header.run_id, self.run.run_id),
            ("model", header.model_fingerprint, self.run.model_fingerprint or header.model_fingerprint),
        ):
            if found != expected:
                return self.refuse(f"{what}: expected {expected}, found {found}")
        first = self.last or 0
        if not first <= header.sequence < self.sent:
            return self.refuse(f"sequence: expected {first} to {self.sent - 1}, which ingest has sent, found {header.sequence}")
        if self.last is not None and header.sequence > self.last:
            self.health.frames_dropped += header.sequence - self.last - 1
        self.last = header.sequence
        count = sample.header.number_of_elements
        if count > DETECTIONS_MAX:
            return self.refuse(f"detections: {count} exceeds the limit of {DETECTIONS_MAX}")
        points = np.zeros((0, 4), np.float32)
        for scan in reversed(self.scans):
            size = scan.header.number_of_elements
            if header_of(scan).sequence == header.sequence and size <= POINTS_MAX:
                points = view(scan, Point, size).view(np.float32).reshape(-1, 4)
                break
        else:
            header.flags |= POINTS_GONE | DEGRADED
        return SimpleNamespace(header=header, points=points, detections=view(sample, Detection, count))

    def count(self, unknown):
        """Health tells what became of the candidates: by disposition, then by flag."""
        counts = np.ctypeslib.as_array(self.health.candidates)
        counts[:9] += np.bincount(unknown["disposition"], minlength=9)[:9].astype(np.uint64)
        counts[9:] += (unknown["flags"][:, None] >> np.arange(3) & 1).sum(0).astype(np.uint64)

    def thin(self, header, objects, indices):
        """Every second point of each object, or fewer, where all of them are more than the topic takes."""
        step, first, count = 1, objects["points_first"].astype(int), objects["points_count"].astype(int)
        while (-(-count // step)).sum() > OBJECT_POINTS_MAX:
            step += 1
        objects["flags"] |= np.where(count > 1, THINNED, 0).astype(np.uint32)
        objects["points_count"] = -(-count // step)
        objects["points_first"] = np.cumsum(objects["points_count"]) - objects["points_count"]
        header.flags |= LIMIT_HIT | LIMIT_OBJECT_POINTS
        return np.concatenate([indices[f : f + n : step] for f, n in zip(first, count)])

    def publish(self, frame, objects, indices):
        """The objects (an array of dtype Object) and their points: indices into the frame's."""
        header = frame.header
        if len(indices) > OBJECT_POINTS_MAX:
            indices = self.thin(header, objects, indices)
        self.send("object_points", header, np.ascontiguousarray(indices, np.uint32))
        self.send("objects", header, objects)
        self.times.append((time.monotonic_ns() - header.stages[3 * REFINER + 1]) // 1000)
        self.health.frames_in, self.health.frames_out = self.health.frames_in + 1, self.health.frames_out + 1
        self.health.bytes_read = frame.points.nbytes + frame.detections.nbytes
        self.health.bytes_written = objects.nbytes + 4 * len(indices)
        self.count(objects[objects["kind"] == 1])
        while len(self.scans) > 2:
            self.scans.pop(0).delete()
        if self.state[0] != RUNNING:
            self.say(RUNNING)
