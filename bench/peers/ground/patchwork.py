#!/usr/bin/env python3
"""Ground labels of Patchwork++ (Lee et al., IROS 2022; package pypatchworkpp) for a folder of scans in KITTI's layout.

Writes OUT/NNNNNN.ground: one byte a point, 1 ground, 0 not, in the order of the scan. Prints its time per scan.

    python3 -m venv venv && venv/bin/pip install numpy pypatchworkpp
    venv/bin/python bench/peers/ground/patchwork.py DIR/velodyne OUT
    cargo run --release -p mluc-bench --bin refine -- --dataset DIR --ground OUT
"""
import pathlib
import sys
import time

import numpy as np
import pypatchworkpp

SENSOR_HEIGHT_M = 1.73


def main(scans: pathlib.Path, out: pathlib.Path) -> None:
    parameters = pypatchworkpp.Parameters()
    parameters.sensor_height = SENSOR_HEIGHT_M
    parameters.verbose = False
    out.mkdir(parents=True, exist_ok=True)
    times_ms = []
    for path in sorted(scans.glob("*.bin")):
        points = np.fromfile(path, np.float32).reshape(-1, 4)
        # A new one for each scan: it adapts its thresholds from scan to scan, and the scans here are no sequence.
        peer = pypatchworkpp.patchworkpp(parameters)
        start = time.perf_counter()
        peer.estimateGround(points)
        times_ms.append((time.perf_counter() - start) * 1e3)
        labels = np.zeros(len(points), np.uint8)
        labels[peer.getGroundIndices()] = 1
        labels.tofile(out / f"{path.stem}.ground")
    times_ms.sort()
    if times_ms:
        print(f"{len(times_ms)} scans: p50 {times_ms[len(times_ms) // 2]:.2f} ms, max {times_ms[-1]:.2f} ms")


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    main(pathlib.Path(sys.argv[1]), pathlib.Path(sys.argv[2]))
