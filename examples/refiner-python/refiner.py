"""A small refiner in Python: the cells above the ground that hang together with a candidate, and a box around them.
`mluc refiner-test -- python3 refiner.py` tests it; `[stages.refiner] command = ["python3", "refiner.py"]` runs it."""
import numpy as np
import mluc

CELL_M, SIDE, CLEARANCE_M, POINTS_MIN = 0.4, 24, 0.25, 10
SAME = ("kind", "class_id", "center_m", "size_m", "yaw_rad", "score", "eds", "eds_normalised", "unknown_probability",
        "gate", "threshold")

def cluster(points, around, center):
    """Indices of the points around `center` whose cells hang together with the nearest one's."""
    near = around(center[0], CELL_M * SIDE / 2)
    near = near[(np.abs(points[near, :2] - center[:2]) < CELL_M * SIDE / 2 - 0.01).all(1)]
    if len(near):
        near = near[points[near, 2] > np.percentile(points[near, 2], 10) + CLEARANCE_M]
    if not len(near):
        return near
    off = points[near, :2] - center[:2]
    x, y = (off / CELL_M + SIDE / 2 + 1).astype(int).T
    filled, grown = np.zeros((2, SIDE + 2, SIDE + 2), bool)  # an empty cell all around
    filled[x, y], seed, before = True, (off**2).sum(1).argmin(), 0
    grown[x[seed], y[seed]] = True
    while grown.sum() > before:
        before, wide = grown.sum(), grown | np.roll(grown, 1, 0) | np.roll(grown, -1, 0)
        grown = (wide | np.roll(wide, 1, 1) | np.roll(wide, -1, 1)) & filled
    return near[grown[x, y]]

def fit(points, o):
    """The box along the main axis of the points, seen from above."""
    x, y = np.linalg.eigh(np.cov(points[:, :2].T.astype(float)))[1][:, 1]
    turn = np.array([[x, -y, 0], [y, x, 0], [0, 0, 1]])
    low, high = (points @ turn).min(0), (points @ turn).max(0)
    o["center_m"], o["yaw_rad"], o["size_m"] = turn @ (low + high) / 2, np.arctan2(y, x), np.maximum(high - low, 0.1)

def inside(points, around, o):
    """Indices of the points in a known object's box."""
    c, s, near = np.cos(o["yaw_rad"]), np.sin(o["yaw_rad"]), around(o["center_m"][0], np.hypot(*o["size_m"][:2]))
    off = (points[near] - o["center_m"]) @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    return near[(np.abs(off) < o["size_m"] / 2).all(1)]

def refine(points, boxes, classes):
    """An object for each detection, and indices of their points: known ones take theirs first, then the surest."""
    numbers = np.column_stack([boxes[name] for name in SAME[2:]])
    sound = (np.abs(numbers) < 1e4).all(1) & (boxes["size_m"] > 0).all(1)  # false for NaN
    sound &= (boxes["class_id"] < classes) & (boxes["kind"] < 2) & (boxes["gate"] < mluc.GATES)
    sound &= mluc.is_probability(boxes["unknown_probability"])
    o, owner, lists = np.zeros(len(boxes), mluc.Object), np.full(len(points), -1), [[]] * len(boxes)
    for name in SAME:
        o[name] = np.where(sound, boxes[name].T, 0).T
    o["suppressed_by"], o["track_id"], o["disposition"] = mluc.NONE, mluc.NONE, np.where(sound, mluc.PUBLISHED, mluc.INVALID_BOX)
    order = np.argsort(points[:, 0], kind="stable")
    x, around = points[order, 0], lambda at, reach: order[slice(*np.searchsorted(x, (at - reach, at + reach)))]
    for i in [i for i in np.lexsort((-o["score"], o["kind"])) if sound[i]]:
        mine = cluster(points, around, o["center_m"][i]) if o["kind"][i] else inside(points, around, o[i])
        if o["kind"][i]:
            owners, votes = np.unique(owner[mine], return_counts=True)
            if len(mine) < POINTS_MIN:
                o["disposition"][i], o["flags"][i] = (mluc.TOO_FEW_POINTS, 0) if len(points) else (mluc.PUBLISHED, mluc.UNREFINED)
            elif owners[votes.argmax()] >= 0 and votes.max() > len(mine) / 2:  # most belong to another
                o["suppressed_by"][i], o["overlap"][i] = owners[votes.argmax()], votes.max() / len(mine)
                o["disposition"][i] = [mluc.OVERLAPS_KNOWN, mluc.OVERLAPS_UNKNOWN][o["kind"][o["suppressed_by"][i]]]
            else:
                fit(points[mine], o[i])
        lists[i] = mine[owner[mine] < 0] if o["disposition"][i] == mluc.PUBLISHED else []
        owner[lists[i]], o["points_count"][i] = i, len(lists[i])
    o["points_first"] = np.cumsum(o["points_count"]) - o["points_count"]
    c, s, (l, w, _), (u, v, _) = np.cos(o["yaw_rad"]), np.sin(o["yaw_rad"]), o["size_m"].T / 2, o["center_m"].T
    corners = [(u + c * a - s * b, v + s * a + c * b) for a, b in ((l, w), (-l, w), (-l, -w), (l, -w))]
    o["footprint_m"][:, :8], o["footprint_count"] = np.reshape(corners, (8, -1)).T, np.where(sound, 4, 0)
    return o, np.concatenate([*lists, []]).astype(np.uint32), 0 if sound.all() else mluc.DEGRADED

if __name__ == "__main__":
    stage = mluc.Refiner()
    for frame in stage.frames():
        near = (np.abs(frame.points) < 1e4).all(1)  # false for NaN, which ingest never sends: far away then
        points = frame.points[:, :3] if near.all() else np.where(near[:, None], frame.points[:, :3], 1e6)
        objects, indices, flags = refine(points, frame.detections, stage.classes)
        frame.header.flags |= flags | (0 if near.all() else mluc.NOT_FINITE)
        stage.publish(frame, objects, indices)
