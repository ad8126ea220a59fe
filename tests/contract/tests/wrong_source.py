"""A source with one fault, named by its argument: the contract suite must find it. `sound` has none."""
import ctypes
import os
import sys
import time

import numpy as np

import mluc

FAULT = sys.argv[1]
SCANS = 400 if FAULT == "first_run" else 20


class Wrong(mluc.Source):
    def join(self):
        if FAULT == "any_version":
            self.lock = open(self.root + "/.lock")
            mluc.fcntl.flock(self.lock, mluc.fcntl.LOCK_SH)
            self.claim = open(self.root + "/suite.tmp", "w+b", 0)
        else:
            super().join()

    def end_on_signals(self):
        if FAULT == "deaf":
            mluc.signal.signal(mluc.signal.SIGTERM, mluc.signal.SIG_IGN)
        else:
            super().end_on_signals()

    def missing(self):
        if FAULT in ("early", "from_zero") and self.run.run_id:
            self.status = self.status or mluc.Status()
        return [] if FAULT == "early" and self.run.run_id else super().missing()

    def follow(self):
        if FAULT != "first_run" or not self.run.run_id:
            super().follow()

    def tick(self):
        if FAULT != "silent":
            super().tick()

    def leave(self, reason=""):
        super().leave("" if FAULT == "no_reason" else reason)

    def send(self, name, header, data):
        if name == "points":
            if FAULT == "renumbers":
                header.sequence *= 2
            elif FAULT == "any_run":
                header.run_id ^= 1
            elif FAULT == "other_model":
                header.model_fingerprint ^= 1
            elif FAULT == "not_finite":
                data = data.copy()
                data[0, 2] = np.nan
            elif FAULT == "uncounted":
                header.points_in += 5
            elif FAULT == "unflagged":
                header.points_dropped, header.points_in = 1, header.points_in + 1
            elif FAULT == "late_stamps":
                header.stages[1] = 2**62
            elif FAULT == "stamp_stands":
                header.sensor_stamp_ns = 1
            elif FAULT == "nameless":
                ctypes.memset(ctypes.addressof(header) + mluc.FrameHeader.name.offset, 0, 48)
        super().send(name, header, data)


source = Wrong()
sent = 0
while sent < SCANS and source.wait(0.05):
    if FAULT == "from_zero" and sent == 0:
        source.sequence = 0
    if FAULT == "dies" and sent == 3:
        os._exit(7)
    source.publish(np.random.default_rng(sent).random((500, 4), np.float32), stamp_ns=time.time_ns())
    sent += 1
    while FAULT == "deaf" and source.sequence > 2:
        source.tick()
        time.sleep(0.05)
if FAULT == "fails_at_end" and not source.is_stopping:
    sys.exit(3)
source.finish()
