"""A consumer in Python: the objects of each frame and their points, a line of JSON each. It only reads: `mluc up` neither knows it nor waits for it.

    MLUC_INSTANCE=default python3 examples/consumer-python/consumer.py
"""
import json
import sys

import numpy as np
import mluc

consumer = mluc.Consumer()
for frame in consumer.frames(silence_s=1):
    state, reason, _ = consumer.status() or ("starting", "", None)
    if frame is None:
        print(f"no frame: {state} {reason}", file=sys.stderr)
        continue
    if frame.header.flags & (mluc.EMPTY | mluc.SUSPECT_UNIT | mluc.SUSPECT_AXES):
        state = "blind"  # the status of this frame may come later than its objects
    found = []
    for o in frame.objects[frame.objects["disposition"] == mluc.PUBLISHED]:
        points = frame.points[frame.points_of(o)]
        found.append({
            "class": "unknown" if o["kind"] == 1 else consumer.class_name(o["class_id"]),
            "score": float(o["score"]),
            "center_m": o["center_m"].tolist(),
            "size_m": o["size_m"].tolist(),
            "yaw_rad": float(o["yaw_rad"]),
            "points": len(points),
            "points_center_m": points[:, :3].mean(0).tolist() if len(points) else None,
        })
    line = {"sequence": frame.header.sequence, "state": state, "dropped": consumer.dropped, "objects": found}
    print(json.dumps(line), flush=True)
