"""The contract (docs/CONTRACT.md) for Python, as a source of scans, a refiner or a consumer: joining, following runs, frames,
publishing, heartbeats.

Needs iceoryx2 and numpy from PyPI. Points and detections are numpy views onto shared memory: nothing is copied. A consumer's
objects are a checked copy.
"""

import contextlib
import ctypes as C
import fcntl
import glob
import os
import shutil
import signal
import stat
import sys
import time
from collections import deque
from types import SimpleNamespace

import iceoryx2 as iox
import numpy as np

WIRE_VERSION, REFINER, NONE = 6, 3, 2**32 - 1
INGEST = 0
POINTS_MAX, OBJECT_POINTS_MAX, DETECTIONS_MAX, HEARTBEAT_NS, SILENCE_NS = 262_144, 131_072, 512, 100_000_000, 1_000_000_000
UNREFINED, THINNED = 1, 4  # bits of an object's flags
GATES = 4  # codes of `gate`: 0 to 3
FOOTPRINT_MAX, FINITE = 16, ("center_m", "size_m", "yaw_rad", "score", "eds", "eds_normalised", "threshold", "overlap")
# Bits of a header's flags.
LATE, TRUNCATED, DEGRADED, LIMIT_HIT, RESENT, NOT_FINITE, DAMAGED_INPUT, POINTS_GONE, EMPTY, INPUT_SUSPECT = (1 << bit for bit in range(10))
LIMIT_OBJECT_POINTS, LIMIT_WORK, SUSPECT_UNIT, SUSPECT_AXES = 1 << 13, 1 << 14, 1 << 16, 1 << 17
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
    other_model_fingerprint:U base_from_sensor:6d sensor_height_m:f objectness_min:f gate:u gate_threshold:f model_name:64b sensor_name:64b
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
TOPICS.update({"health/" + stage: TOPICS["health/refiner"] for stage in ("ingest", "backbone", "head")})


def is_probability(values):
    """Whether values are 0 to 1, or -1: the model does not give a probability."""
    return (values == -1) | (values >= 0) & (values <= 1)


def are_convex(objects):
    """Whether outlines are convex and counter-clockwise, as `mluc up` demands: to 1 mm and the rounding of f32 far from the sensor."""
    count, corners = np.minimum(objects["footprint_count"], FOOTPRINT_MAX)[:, None], np.arange(FOOTPRINT_MAX)
    at = objects["footprint_m"].reshape(-1, FOOTPRINT_MAX, 2).astype(float)
    is_used = corners < count
    at[~is_used] = 0
    side = (np.take_along_axis(at, ((corners + 1) % np.maximum(count, 1))[..., None], 1) - at)[:, :, None]
    way = at[:, None] - at[:, :, None]  # from each corner to each other one
    slack = 1e-3 + 1e-6 * np.abs(at).max((1, 2), initial=0)[:, None, None]
    is_left = side[..., 0] * way[..., 1] - side[..., 1] * way[..., 0] >= -slack * (np.abs(side) + np.abs(way)).sum(-1)
    return (is_left | ~(is_used[:, :, None] & is_used[:, None])).all()


def text(words, size):
    """UTF-8 of a text, cut between characters, padded with NUL."""
    return words.encode(errors="replace")[:size].decode(errors="ignore").encode().ljust(size, b"\0")


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


def newest_sample(port):
    """The newest waiting message, to be deleted after use; older ones are discarded. None: no message waits."""
    newest = port.receive()
    while newest is not None and port.has_samples():
        newest.delete()  # before the next is taken: a topic may lend no more than one
        newest = port.receive()
    return newest


def newest(port, kind):
    """A copy of the newest message's first element; None: no message waits."""
    sample = newest_sample(port)
    if sample is None:
        return None
    element = kind.from_buffer_copy(C.string_at(sample.payload_ptr, C.sizeof(kind)))
    sample.delete()
    return element


class NotJoined(SystemExit, RuntimeError):
    """The instance cannot be joined. Not caught, it ends the program with its words and exit code 1."""


class Member:
    """Membership of this process in the instance that `MLUC_INSTANCE` names, in one run after the other."""

    def __init__(self):
        self.root, self.handlers = "/dev/shm/" + stem(), {}
        self.join()
        self.node, self.services = make_node(stem()), {}
        self.descriptions, self.run = self.input("run"), RunDescription()
        self.last, self.sent, self.scans, self.is_stopping = None, 0, [], False

    def join(self):
        """Joins the instance until this process ends; refuses another wire version, which it names, and a folder that another user made."""
        try:
            about = os.lstat(self.root)
            if not stat.S_ISDIR(about.st_mode) or about.st_uid != os.geteuid() or about.st_mode & 0o077:
                raise NotJoined(f"{self.root}: expected a folder of user {os.geteuid()}, mode 700, found user {about.st_uid}, {about.st_mode:o}")
            while True:
                self.lock = open(os.open(self.root + "/.lock", os.O_RDONLY | os.O_NOFOLLOW))
                fcntl.flock(self.lock, fcntl.LOCK_SH)
                # Whoever was alone and left has removed the file; then this lock is of nothing.
                if os.path.samestat(os.fstat(self.lock.fileno()), os.stat(self.root + "/.lock")):
                    break
            begun = open(self.root + "/contract").read().strip()
        except FileNotFoundError as error:
            raise NotJoined(f"no pipeline runs there, start `mluc up` first: {error}")
        if f"wire={WIRE_VERSION}" not in begun.split():
            raise NotJoined(f"expected wire version {WIRE_VERSION}, found {begun} in {self.root}/contract: run the same mluc on both sides")

    def input(self, name):
        self.services[name] = open_topic(self.node, name)[0]
        return self.services[name].subscriber_builder().create()

    def listen(self, name):
        return open_topic(self.node, name)[1].listener_builder().create()

    def end_on_signals(self):
        """SIGTERM and SIGINT set `is_stopping`, in place of the program's own handlers until `leave()` (of several objects, leave the last one first). Outside of the main thread the program
        sets it itself."""
        with contextlib.suppress(ValueError):
            for number in (signal.SIGTERM, signal.SIGINT):
                self.handlers[number] = signal.signal(number, self.stop)

    def stop(self, *_):
        self.is_stopping = True

    def follow(self):
        """Takes the descriptions of the topic `run`. A description with another id begins a new run; one with the same id has other
        thresholds, or another model with the same classes."""
        while (run := newest(self.descriptions, RunDescription)) is not None:
            if run.wire_version != WIRE_VERSION or run.run_id == 0:
                continue
            before, self.run = self.run.run_id, run
            if run.run_id != before:
                self.last, self.sent = None, 0
                while self.scans:
                    self.scans.pop().delete()
                self.begin()

    def begin(self):
        """Called when a new run begins."""

    def take_scans(self):
        """Takes the scans that arrived. Keeps two from the time of the last frame and the newest two: results come later than points."""
        while (scan := self.points.receive()) is not None:
            header = header_of(scan)
            if (header.wire_version, header.run_id) != (WIRE_VERSION, self.run.run_id):
                scan.delete()
                continue
            self.sent = max(self.sent, header.sequence + 1)
            self.scans.append(scan)
            if len(self.scans) > 4:
                self.scans.pop(2).delete()
        # Nothing is under way, and ingest is gone: the next one needs the memory that these scans hold.
        is_idle = self.sent == (0 if self.last is None else self.last + 1)
        if is_idle and self.services["points"].dynamic_config.number_of_publishers == 0:
            while self.scans:
                self.scans.pop().delete()

    def points_of(self, sequence):
        """The points of a scan, x, y, z, intensity; None: they are gone."""
        for scan in reversed(self.scans):
            size = scan.header.number_of_elements
            if header_of(scan).sequence == sequence and size <= POINTS_MAX:
                return view(scan, Point, size).view(np.float32).reshape(-1, 4)
        return None

    def let_scans_go(self):
        while len(self.scans) > 2:
            self.scans.pop(0).delete()

    def leave(self):
        """Closes all ports; then removes the instance's files if no other process is left in it. The object cannot be used again."""
        # What closed later would remove files of the next pipeline of this name.
        for name in ("scans", "indices", "points", "detections", "objects", "object_points", "statuses", "healths", "outputs", "listener",
                     "descriptions", "services", "node", "claim"):
            setattr(self, name, None)
        if not self.lock.closed:
            with self.lock:
                self.clean()
        with contextlib.suppress(ValueError):
            for number, handler in self.handlers.items():
                if signal.getsignal(number) == self.stop:
                    signal.signal(number, handler or signal.SIG_DFL)
        self.handlers = {}

    def clean(self):
        """Removes the instance's files if no other process is left in it."""
        try:
            fcntl.flock(self.lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            return
        # Another process that left at the same time may have removed all, and a new pipeline may have begun.
        try:
            if not os.path.samestat(os.fstat(self.lock.fileno()), os.stat(self.root + "/.lock")):
                return
        except FileNotFoundError:
            return
        # The lock goes last: without it the next process begins the instance anew, under the same names.
        for path in glob.glob(self.root + ".*") + glob.glob(self.root + "/*"):
            shutil.rmtree(path, ignore_errors=True) if os.path.isdir(path) else os.unlink(path)
        os.unlink(self.root + "/.lock")
        with contextlib.suppress(OSError):
            os.rmdir(self.root)


class Watch(Member):
    """For consumers: the pipeline's status, which distinguishes "nothing there" from "blind", "late" and "stopped"."""

    def __init__(self):
        super().__init__()
        self.statuses, self.told = self.input("status"), None

    def status(self):
        """State word, reason, and the whole Status; None before the supervisor has published one."""
        status = self.statuses and newest(self.statuses, Status)
        if status is not None and status.wire_version == WIRE_VERSION and status.state < len(STATES):
            self.told = status
        if self.told is None:
            return None
        if time.monotonic_ns() - self.told.judged_ns > STATUS_AGE_MAX_NS and self.told.state != STATES.index("stopped"):
            return "stopped", "the supervisor hangs or is gone", self.told
        reason = bytes(self.told.reason).rstrip(b"\0").decode(errors="replace")
        return STATES[self.told.state], reason, self.told


class Consumer(Watch):
    """The results, frame after frame: for programs that only read them."""

    def __init__(self):
        super().__init__()
        self.points, self.objects, self.object_points = (self.input(name) for name in ("points", "objects", "object_points"))
        self.listener, self.indices, self.dropped = self.listen("objects"), None, 0
        self.end_on_signals()

    def frames(self, silence_s=float("inf")):
        """Yields the newest frame of the run until this process is asked to end (after a `break` call `leave()`); None after `silence_s` without one: `status()` says why.
        Each has `header`, `objects` (an array of dtype Object; its `footprint_m` is flat: x, y, x, y, ..), `points`, and `points_of(object)`: indices
        into the points, which are there until the loop goes on (copy what you keep). `dropped` counts the frames that newer ones replaced."""
        heard_s = time.monotonic()
        while not self.is_stopping:
            try:
                self.listener.timed_wait(iox.Duration.from_millis(50))
            except iox.ListenerWaitError:  # a signal came
                continue
            # First the objects: what they belong to was sent before them.
            sample = newest_sample(self.objects)
            self.follow()
            self.take_scans()
            frame = None if sample is None else self.frame(sample)
            if frame is not None or time.monotonic() - heard_s > silence_s:
                yield frame
                heard_s = time.monotonic()
            if frame is not None:
                self.let_scans_go()
            if sample is not None:
                sample.delete()
        self.leave()

    def class_name(self, class_id):
        return bytes(self.run.class_names)[32 * class_id : 32 * class_id + 32].rstrip(b"\0").decode(errors="replace")

    def frame(self, sample):
        """The frame of a sample. None: it is of another run, model or version, was already seen, or breaks the contract."""
        header, count = header_of(sample), sample.header.number_of_elements
        models = (self.run.model_fingerprint, self.run.other_model_fingerprint or self.run.model_fingerprint)
        is_ours = (header.wire_version, header.run_id) == (WIRE_VERSION, self.run.run_id) and header.model_fingerprint in models
        first = 0 if self.last is None else self.last + 1
        if not is_ours or not first <= header.sequence < self.sent or count > TOPICS["objects"][1]:
            return None
        # A copy: what lies in shared memory may change after the check.
        objects = self.check(view(sample, Object, count).copy())
        if objects is None:
            return None
        if self.last is not None:
            self.dropped += header.sequence - first
        self.last, points = header.sequence, self.points_of(header.sequence)
        points = np.zeros((0, 4), np.float32) if points is None else points
        indices = self.indices_of(header)
        end = (objects["points_first"].astype(np.uint64) + objects["points_count"]).max(initial=0)
        if len(indices) and (indices.max() >= len(points) or end > len(indices)):
            indices = indices[:0]

        def points_of(o):
            return indices[o["points_first"] :][: o["points_count"]]

        return SimpleNamespace(header=header, points=points, objects=objects, points_of=points_of)

    def check(self, objects):
        """The objects. None, with a message on stderr: their numbers make no sense."""
        sound = all(np.isfinite(objects[name]).all() for name in FINITE)
        sound &= (objects["kind"] < 2).all() and (objects["disposition"] <= LOW_SCORE).all()
        told = objects[objects["disposition"] == PUBLISHED]
        sound &= (told["size_m"] > 0).all() and (told["footprint_count"] >= 3).all() and are_convex(told)
        sound &= (objects["gate"] < GATES).all() and is_probability(objects["unknown_probability"]).all()
        sound &= (objects["class_id"] < self.run.classes_count).all() and (objects["footprint_count"] <= FOOTPRINT_MAX).all()
        corners = np.where(np.arange(2 * FOOTPRINT_MAX) < 2 * objects["footprint_count"][:, None], objects["footprint_m"], 0)
        sound &= np.isfinite(corners).all()
        sound &= ((objects["overlap"] >= 0) & (objects["overlap"] <= 1)).all()
        by, names = objects["suppressed_by"], np.arange(len(objects))
        sound &= ((by == NONE) | (by < len(objects)) & (by != names)).all()
        for kind, disposition in enumerate((OVERLAPS_KNOWN, OVERLAPS_UNKNOWN)):
            of = by[objects["disposition"] == disposition]
            sound &= (of < len(objects)).all() and (objects["kind"][of[of < len(objects)]] == kind).all()
        sound &= (objects["points_first"].astype(np.uint64) + objects["points_count"] <= OBJECT_POINTS_MAX).all()
        if not sound:
            print("message refused: objects that break the contract", file=sys.stderr)
        return objects if sound else None

    def indices_of(self, header):
        """The indices of the points of a frame's objects; empty if those of a newer frame came already."""
        sample = newest_sample(self.object_points)
        if sample is not None:
            self.indices, _ = sample, self.indices and self.indices.delete()
        found = header_of(self.indices) if self.indices else FrameHeader()
        count = self.indices.header.number_of_elements if self.indices else 0
        if (found.run_id, found.sequence) != (header.run_id, header.sequence) or count > OBJECT_POINTS_MAX:
            return np.zeros(0, np.uint32)
        return view(self.indices, C.c_uint32, count)


class Stage(Member):
    """This process in the place of a stage of the instance."""

    def __init__(self, name, number, outputs):
        self.name, self.number = name, number
        super().__init__()
        self.outputs = {topic: self.output(topic) for topic in (*outputs, "health/" + name)}
        self.times, self.beats = deque([0], 1000), 0
        self.health = Health(wire_version=WIRE_VERSION, stage=number, pid=os.getpid())
        self.end_on_signals()
        self.say(STARTING)  # until the program waits: it may load something first

    def join(self):
        """Joins as the only process of its stage."""
        super().join()
        path = f"{self.root}/{self.name}.pid"
        self.claim = open(os.open(path, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW, 0o600), "r+b", 0)
        try:
            fcntl.flock(self.claim, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise NotJoined(f"another {self.name} runs already: stop it first ({path})")
        self.note()

    def note(self, sequence="-"):
        """Notes for the supervisor which frame is being worked on: a scan that kills stages twice is set aside."""
        os.pwrite(self.claim.fileno(), f"{os.getpid():10} {sequence:>20}\n".encode(), 0)

    def output(self, name):
        data, wake = open_topic(self.node, name)
        port = data.publisher_builder().initial_max_slice_len(TOPICS[name][1]).max_loaned_samples(TOPICS[name][5])
        port = port.allocation_strategy(iox.AllocationStrategy.Static)
        port = port.backpressure_strategy(iox.BackpressureStrategy.DiscardData)
        return port.create(), wake.notifier_builder().create()

    def send(self, name, header, data):
        port, notifier = self.outputs[name]
        sample = port.loan_slice_uninit(len(data))
        header.stages[3 * self.number + 2] = time.monotonic_ns()
        C.memmove(sample.user_header_ptr, C.addressof(header), C.sizeof(header))
        C.memmove(sample.payload_ptr, data.ctypes.data, data.nbytes)
        sample.assume_init().send()
        notifier.notify()

    def say(self, state, reason=""):
        """Sends a heartbeat: every 0.1 s, and at once when the state changes."""
        self.health.run_id = self.run.run_id
        self.health.state, self.health.reason[:] = state, text(reason, 192)
        self.health.run_p50_us, self.health.run_p99_us = (int(run) for run in np.percentile(self.times, (50, 99)))
        header = FrameHeader(wire_version=WIRE_VERSION, run_id=self.run.run_id, sequence=self.beats)
        self.send("health/" + self.name, header, np.frombuffer(self.health, np.dtype(Health)))
        self.beats, self.said_ns, self.state = self.beats + 1, time.monotonic_ns(), (state, reason)

    def tick(self):
        if time.monotonic_ns() - self.said_ns > HEARTBEAT_NS:
            self.say(*self.state)

    def done(self, started_ns):
        """Counts a frame that was published."""
        self.times.append((time.monotonic_ns() - started_ns) // 1000)
        self.health.run_max_us = max(self.times)
        self.health.frames_in, self.health.frames_out = self.health.frames_in + 1, self.health.frames_out + 1

    def leave(self, reason=""):
        if not self.lock.closed:
            self.say(STOPPING, reason)
            super().leave()


class Source(Stage):
    """This process as the source of scans, in ingest's place."""

    def __init__(self):
        self.begun_ns, self.sequence, self.status, self.behind = 0, None, None, {}
        super().__init__("ingest", INGEST, ("points",))
        self.statuses = self.input("status")
        self.healths = {stage: self.input("health/" + stage) for stage in ("backbone", "head", "refiner")}

    def begin(self):
        self.begun_ns, self.sequence = time.monotonic_ns(), None

    def missing(self):
        """What the first scan of a run still waits for. A source that is started again goes on after the scans that the supervisor has
        counted; the supervisor publishes its count twice a second."""
        if self.run.run_id == 0:
            return ["the run"]
        now_ns, missing = time.monotonic_ns(), []
        for stage, port in self.healths.items():
            if (told := newest(port, Health)) is not None:
                self.behind[stage] = told, now_ns
            told, heard_ns = self.behind.get(stage, (Health(), 0))
            if now_ns - heard_ns > SILENCE_NS or told.run_id != self.run.run_id or told.state not in (1, 2, 3):
                missing.append(stage)
        self.status = newest(self.statuses, Status) or self.status
        if self.status is None or self.status.run_id != self.run.run_id or self.status.judged_ns < self.begun_ns:
            missing.append("the supervisor")
        return missing

    def wait(self, seconds=0):
        """Sleeps for `seconds` and sends heartbeats; before the first scan of a run it also waits until a scan can be taken. False: this
        process was asked to end. Call it at least twice a second."""
        until_ns = time.monotonic_ns() + int(seconds * 1e9)
        while not self.is_stopping:
            self.follow()
            if self.sequence is None:
                missing = self.missing()
                if missing:
                    reason = "waiting for " + ", ".join(missing)
                    if self.state != (WAITING_INPUT, reason):
                        self.say(WAITING_INPUT, reason)
                        print(reason, file=sys.stderr)
                else:
                    self.sequence = self.status.frames_in
                    self.say(RUNNING)
            self.tick()
            left_ns = until_ns - time.monotonic_ns()
            if self.sequence is not None and left_ns <= 0:
                return True
            time.sleep(min(max(left_ns, 2_000_000), 20_000_000) / 1e9)
        return False

    def publish(self, points, stamp_ns=None, name=""):
        """Publishes a scan: N rows of x, y, z (m; forward, left, up) and intensity (0 to 1). `stamp_ns`: the sensor's time, ns since 1970.
        Of `name` the last 48 bytes are used. Rows whose coordinates are not finite, or beyond the limit, are left out, counted and flagged.
        An intensity that is not finite becomes 0."""
        started_ns, points = time.monotonic_ns(), np.array(points, np.float32)
        if points.ndim != 2 or points.shape[1] != 4 or self.sequence is None:
            raise ValueError(f"expected an array of N rows and 4 columns after wait() was true, found {points.shape} and sequence {self.sequence}")
        points[~np.isfinite(points[:, 3]), 3] = 0
        finite = points[np.isfinite(points).all(1)]
        kept = np.ascontiguousarray(finite[:POINTS_MAX])
        beyond = len(finite) - len(kept)
        flags = NOT_FINITE * (len(finite) < len(points)) | TRUNCATED * (beyond > 0) | EMPTY * (not len(kept))
        header = FrameHeader(wire_version=WIRE_VERSION, flags=flags, run_id=self.run.run_id, sequence=self.sequence,
                             sensor_stamp_ns=time.time_ns() if stamp_ns is None else stamp_ns, points_in=len(points),
                             points_dropped=len(points) - len(kept), limit_dropped=beyond,
                             model_fingerprint=self.run.model_fingerprint)
        header.stages[0:2] = started_ns, started_ns
        # Of a long name its end, which tells scans apart.
        name = name.encode(errors="replace")[-48:].decode(errors="ignore")
        header.name[:] = text(name or f"{self.sequence:06}", 48)
        self.send("points", header, kept)
        self.sequence += 1
        self.health.bytes_written = kept.nbytes
        self.done(started_ns)
        self.tick()

    def finish(self, seconds=5):
        """Waits until the last scan has passed, at most `seconds`, and leaves. This ends the run, unless this process was asked to end."""
        until = time.monotonic() + seconds
        while self.sequence and time.monotonic() < until and self.wait(0.02):
            self.status = newest(self.statuses, Status) or self.status
            if self.status.run_id == self.run.run_id and self.status.sequence == self.sequence - 1:
                break
        self.leave("asked to end" if self.is_stopping else "")


class Refiner(Stage):
    """This process as the refiner."""

    def __init__(self):
        self.classes = 8
        super().__init__("refiner", REFINER, ("objects", "object_points"))
        self.points, self.detections, self.listener = self.input("points"), self.input("detections"), self.listen("detections")
        self.follow()

    def begin(self):
        self.classes = self.run.classes_count
        if self.state[0] != STARTING:
            self.say(WAITING_INPUT, "waiting for detections")

    def refuse(self, reason):
        self.health.messages_refused += 1
        print(f"message refused: {reason}", file=sys.stderr)
        self.say(BAD, reason)

    def frames(self):
        """Yields frame after frame, always the newest, until this process is asked to end. `points` and `detections` lie in shared memory, with numbers
        that nobody has checked, until `publish` or the loop goes on: copy what you keep."""
        heard_ns = time.monotonic_ns()
        self.say(WAITING_INPUT, "waiting for detections")
        while not self.is_stopping:
            try:
                self.listener.timed_wait(iox.Duration.from_millis(50))
            except iox.ListenerWaitError:  # a signal came
                continue
            detections, self.received_ns = newest_sample(self.detections), time.monotonic_ns()
            self.follow()
            self.take_scans()
            if detections is not None:
                frame, heard_ns = self.frame(detections), time.monotonic_ns()
                if frame is not None:
                    self.note(frame.header.sequence)
                    yield frame
                    self.note()
                detections.delete()
            silence_ns = time.monotonic_ns() - heard_ns
            if silence_ns > SILENCE_NS and self.state[0] != WAITING_INPUT:
                self.say(WAITING_INPUT, "waiting for detections: their producer is silent or gone")
            else:
                self.tick()
        self.leave()

    def frame(self, sample):
        """Header, points and detections of a sample; None: refused."""
        header = header_of(sample)
        header.stages[3 * REFINER : 3 * REFINER + 2] = self.received_ns, time.monotonic_ns()
        # While the run changes its model, frames of two models come.
        model, own = header.model_fingerprint, self.run.model_fingerprint
        is_ours = not own or model == own or (model and model == self.run.other_model_fingerprint)
        for what, found, expected in (
            ("wire version of the sender", header.wire_version, WIRE_VERSION),
            ("run", header.run_id, self.run.run_id),
            ("model", model, model if is_ours else own),
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
        points = self.points_of(header.sequence)
        if points is None:
            points, header.flags = np.zeros((0, 4), np.float32), header.flags | POINTS_GONE | DEGRADED
        return SimpleNamespace(header=header, points=points, detections=view(sample, Detection, count))

    def count(self, unknown):
        """Counts the candidates in the health message: by disposition, then by flag."""
        counts = np.ctypeslib.as_array(self.health.candidates)
        counts[:9] += np.bincount(unknown["disposition"], minlength=9)[:9].astype(np.uint64)
        counts[9:] += (unknown["flags"][:, None] >> np.arange(3) & 1).sum(0).astype(np.uint64)

    def thin(self, header, objects, indices):
        """Keeps every second point of each object, or fewer, if all points are more than the topic takes."""
        step, first, count = 1, objects["points_first"].astype(int), objects["points_count"].astype(int)
        while (-(-count // step)).sum() > OBJECT_POINTS_MAX:
            step += 1
        objects["flags"] |= np.where(count > 1, THINNED, 0).astype(np.uint32)
        objects["points_count"] = -(-count // step)
        objects["points_first"] = np.cumsum(objects["points_count"]) - objects["points_count"]
        header.flags |= LIMIT_HIT | LIMIT_OBJECT_POINTS
        return np.concatenate([indices[f : f + n : step] for f, n in zip(first, count)])

    def publish(self, frame, objects, indices):
        """Publishes the objects (an array of dtype Object) and their points: indices into the frame's points."""
        header = frame.header
        objects = np.ascontiguousarray(objects, Object)  # what is sent is its memory
        if len(indices) > OBJECT_POINTS_MAX:
            indices = self.thin(header, objects, indices)
        self.send("object_points", header, np.ascontiguousarray(indices, np.uint32))
        self.send("objects", header, objects)
        self.done(header.stages[3 * REFINER + 1])
        self.health.bytes_read = frame.points.nbytes + frame.detections.nbytes
        self.health.bytes_written = objects.nbytes + 4 * len(indices)
        self.count(objects[objects["kind"] == 1])
        self.let_scans_go()
        if self.state[0] != RUNNING:
            self.say(RUNNING)
