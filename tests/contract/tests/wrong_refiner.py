"""A refiner with one fault, named by its argument: the contract suite must find it. `sound` has none.

It refines nothing: each candidate is published with its proposal box."""
import sys
import time

import numpy as np

import mluc

FAULT = sys.argv[1]
SAME = ("kind", "class_id", "gate", "score", "center_m", "size_m", "yaw_rad", "eds", "eds_normalised", "unknown_probability", "threshold")


class Wrong(mluc.Refiner):
    def end_on_signals(self):
        if FAULT == "deaf":
            mluc.signal.signal(mluc.signal.SIGTERM, mluc.signal.SIG_IGN)
        else:
            super().end_on_signals()

    def tick(self):
        if FAULT != "silent":
            super().tick()

    def points_of(self, sequence):
        return None if FAULT == "no_points" else super().points_of(sequence)

    def count(self, unknown):
        super().count(unknown)
        if FAULT == "miscounts":
            self.health.candidates[0] += 77

    def frame(self, sample):
        header, version, run_id, last = mluc.header_of(sample), mluc.WIRE_VERSION, self.run.run_id, self.last
        if FAULT == "any_version":
            mluc.WIRE_VERSION = header.wire_version
        elif FAULT == "any_run":
            self.run.run_id = header.run_id
        elif FAULT == "any_sequence":
            self.last, self.sent = None, 2**64
        frame = super().frame(sample)
        mluc.WIRE_VERSION, self.run.run_id = version, run_id
        if FAULT == "uncounted":
            self.health.frames_dropped = 0
        if frame is None or FAULT == "answers_once" and last is not None and header.sequence <= last:
            return None
        if FAULT == "unflagged":
            frame.header.flags &= ~(mluc.POINTS_GONE | mluc.DEGRADED)
        boxes = frame.detections
        sound = all((np.abs(boxes[name]) < 1e4).all() for name in SAME[3:])  # false for NaN
        sound &= (boxes["size_m"] > 0).all() and (boxes["class_id"] < self.classes).all() and (boxes["kind"] < 2).all()
        sound &= mluc.is_probability(boxes["unknown_probability"]).all() and (FAULT == "any_gate" or (boxes["gate"] < mluc.GATES).all())
        assert sound or FAULT != "brittle"
        return frame if sound else self.refuse("detections that make no sense")

    def send(self, name, header, data):
        if FAULT == "no_health" and name == "health/refiner":
            return
        if FAULT == "hostile" and name == "objects":
            # Sequences that never were and that go back, messages of another run, model and version.
            for field, value in (("sequence", 2**64 - 2), ("sequence", 2**64 - 1), ("sequence", header.sequence + 1), ("sequence", 0),
                                 ("run_id", header.run_id ^ 1), ("model_fingerprint", header.model_fingerprint ^ 1),
                                 ("wire_version", header.wire_version + 1)):
                wrong = mluc.FrameHeader.from_buffer_copy(header)
                setattr(wrong, field, value)
                super().send(name, wrong, data[:0])
                time.sleep(0.03)  # the queue of a topic holds two: each is to be read
        super().send(name, header, data)


stage = Wrong()
for frame in stage.frames():
    header, boxes, indices = frame.header, frame.detections, np.arange(min(len(frame.points), 3))
    if not np.isfinite(frame.points).all():
        header.flags |= mluc.NOT_FINITE
    objects = np.zeros(len(boxes), mluc.Object)
    for name in SAME:
        objects[name] = boxes[name]
    objects["suppressed_by"], objects["track_id"], objects["points_count"] = mluc.NONE, mluc.NONE, len(indices)
    (x, y, _), (l, w, _) = boxes["center_m"].T, boxes["size_m"].T / 2
    corners = np.stack([x + l, y + w, x - l, y + w, x - l, y - w, x + l, y - w], 1)
    objects["footprint_m"][:, :8], objects["footprint_count"] = corners, 4
    if FAULT == "moves_known":
        objects["center_m"][objects["kind"] == 0, 0] += 0.01
    elif FAULT == "forgets":
        objects = objects[:-1]
    elif FAULT == "renumbers":
        header.sequence += 1
    elif FAULT == "forgets_run":
        header.run_id = 0
    elif FAULT == "not_finite":
        objects["yaw_rad"] = np.nan
    elif FAULT == "clockwise":
        objects["footprint_m"][:, :8] = np.roll(corners.reshape(-1, 4, 2)[:, ::-1], 1, 1).reshape(-1, 8)
    elif FAULT == "bad_index":
        indices[:1] = 1 << 20
    elif FAULT == "no_stamps":
        header.stages[9:11] = 0, 0
    stage.publish(frame, objects, indices)
