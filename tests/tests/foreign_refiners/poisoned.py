"""The refiner of the examples, whose path is the first argument; it dies of scan 000002."""

import os
import sys

sys.path.insert(0, os.path.dirname(sys.argv[1]))

import mluc
import refiner

stage = mluc.Refiner()
for frame in stage.frames():
    if bytes(frame.header.name).startswith(b"000002") and len(frame.points):
        os.abort()
    objects, indices, _ = refiner.refine(frame.points[:, :3], frame.detections, stage.classes)
    stage.publish(frame, objects, indices)
