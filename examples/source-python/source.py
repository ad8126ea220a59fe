"""A source in Python: numpy arrays into the pipeline, at 10 Hz, here from a folder of KITTI's .bin or of .npy files.

    mluc up --config mluc.toml      # [stages.ingest] command = ["python3", "examples/source-python/source.py", "DIR"]
    mluc up --without ingest        # or started by hand: then python3 examples/source-python/source.py DIR
"""
import pathlib
import sys

import numpy as np

import mluc

PERIOD_S = 0.1


def scans(folder):
    """Name, and N rows of x, y, z (m; forward, left, up), intensity (0 to 1). Yours come from a sensor."""
    for path in sorted(pathlib.Path(folder).iterdir()):
        if path.suffix == ".bin":
            yield path.stem, np.fromfile(path, np.float32).reshape(-1, 4)
        elif path.suffix == ".npy":
            yield path.stem, np.load(path)[:, :4]


source = mluc.Source()
if source.wait():  # false: asked to end
    for number, (name, points) in enumerate(scans(sys.argv[1])):
        # One that was started again after a fault goes on behind its predecessor's scans.
        if number < source.sequence:
            continue
        if not source.wait(PERIOD_S):
            break
        source.publish(points, name=name)
source.finish()
