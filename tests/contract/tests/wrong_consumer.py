"""A consumer with one fault, named by its argument: the contract suite must find it. `sound` has none."""
import json
import os
import sys
import time

import numpy as np

import mluc

FAULT = sys.argv[1]


class Wrong(mluc.Consumer):
    def join(self):
        if FAULT == "any_version":
            self.lock = open(self.root + "/.lock")
            mluc.fcntl.flock(self.lock, mluc.fcntl.LOCK_SH)
            return
        super().join()
        if FAULT == "takes_a_place":
            self.claim = open(self.root + "/refiner.pid", "w")
            mluc.fcntl.flock(self.claim, mluc.fcntl.LOCK_EX)
            self.claim.write(f"{os.getpid():10} {'-':>20}\n")
            self.claim.flush()

    def end_on_signals(self):
        if FAULT == "deaf":
            mluc.signal.signal(mluc.signal.SIGTERM, mluc.signal.SIG_IGN)
        else:
            super().end_on_signals()

    def follow(self):
        if FAULT != "first_run" or not self.run.run_id:
            super().follow()

    def check(self, objects):
        if FAULT == "passes_on":
            for name in mluc.FINITE:
                objects[name] = np.nan_to_num(objects[name])
        if FAULT in ("believes", "passes_on"):
            return objects
        if FAULT == "brittle":
            assert (objects["class_id"] < 8).all()
        return super().check(objects)

    def frame(self, sample):
        if FAULT in ("any_run", "goes_back"):
            header = mluc.header_of(sample)
            if FAULT == "any_run" and header.run_id != self.run.run_id:
                print(json.dumps({"sequence": header.sequence}), flush=True)
            if FAULT == "goes_back" and self.last is not None and header.sequence < self.last:
                self.last = None
        return super().frame(sample)


if FAULT == "greedy":
    hoard = mluc.Consumer()
consumer, heard = Wrong(), time.monotonic()
if FAULT == "impatient":
    def watch():
        while time.monotonic() - heard < 1.5:
            time.sleep(0.1)
        os._exit(0)
    import threading
    threading.Thread(target=watch, daemon=True).start()
for frame in consumer.frames():
    heard = time.monotonic()
    if FAULT == "gapless" and consumer.dropped:
        sys.exit("a frame is missing")
    published = frame.objects[frame.objects["disposition"] == mluc.PUBLISHED]
    objects = [{"score": float(o["score"]), "x_m": float(o["center_m"][0]), "points": len(frame.points_of(o))} for o in published]
    if FAULT == "forgets":
        objects = objects[:1]
    if FAULT == "miscounts":
        objects[0]["points"] += 1
    if FAULT == "counts_blindly":
        objects = [{**line, "points": int(o["points_count"])} for line, o in zip(objects, published)]
    line = {"sequence": frame.header.sequence, "objects": objects}
    if FAULT != "mute":
        print(json.dumps(line), flush=True)
