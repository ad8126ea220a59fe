"""A source in Python: numpy arrays into the pipeline, at about 10 Hz, here from a folder of KITTI's .bin or of .npy files.

    mluc up --config mluc.toml      # [stages.ingest] command = ["python3", "examples/source-python/source.py", "DIR"]
    mluc up --without ingest        # or started by hand: then python3 examples/source-python/source.py DIR
"""
import pathlib
import sys

import numpy as np

import mluc

PERIOD_S = 0.1


def scans(folder):
    """Paths, in order."""
    return sorted(path for path in pathlib.Path(folder).iterdir() if path.suffix in (".bin", ".npy"))


def read(path):
    """N rows of x, y, z (m; forward, left, up), intensity (0 to 1). Yours come from a sensor."""
    return np.fromfile(path, np.float32, path.stat().st_size // 16 * 4).reshape(-1, 4) if path.suffix == ".bin" else np.load(path)[:, :4]


if len(sys.argv) != 2 or not scans(sys.argv[1]):
    sys.exit("usage: source.py DIR, a folder that holds .bin or .npy files itself")
paths, source = scans(sys.argv[1]), mluc.Source()
if source.wait():  # false: asked to end
    # One that was started again after a fault goes on behind its predecessor's scans.
    while source.sequence < len(paths) and source.wait(PERIOD_S):
        path = paths[source.sequence]
        source.publish(read(path), name=path.stem)
source.finish()
