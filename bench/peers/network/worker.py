"""One peer in a process of its own: reads a line `FILE ROUNDS`, answers with milliseconds as JSON, waits for the next.

    worker.py torch|torch-bf16|onnx|spconv THREADS

FILE holds points (f32 x, y, z, intensity). torch and onnx time the bird's-eye part, from the dense map to the 512 feature
channels, batch norms folded; spconv the sparse part with its index building. Nothing else is timed.
"""

import json
import os
import sys
import time

KIND, THREADS = sys.argv[1], int(sys.argv[2])
os.environ["OMP_NUM_THREADS"] = str(THREADS)
os.environ["MKL_NUM_THREADS"] = str(THREADS)

import numpy as np
import torch

from second import fused_2d, random_second, to_map, voxelize

torch.set_num_threads(THREADS)
MODEL = random_second()
ROWS, COLUMNS = 200, 176


def sparse_inputs(path):
    features, sites = voxelize(np.fromfile(path, np.float32).reshape(-1, 4))
    return torch.from_numpy(features), torch.from_numpy(sites)


def dense_map(path):
    """Time of dense layers does not hang on values: the sites are the scan's, and the channels random where spconv with
    several threads would be wrong."""
    _, sites = sparse_inputs(path)
    bev = torch.zeros(1, 256, ROWS, COLUMNS)
    rows, columns = (sites[:, 1] // 8).long(), (sites[:, 2] // 8).long()
    bev[0, :, rows, columns] = torch.rand(256, len(sites), generator=torch.Generator().manual_seed(1))
    return bev


def torch_runner(kind):
    part = fused_2d(MODEL).to(memory_format=torch.channels_last)
    wanted = torch.bfloat16 if kind == torch.bfloat16 else torch.float32
    part = part.to(wanted)

    def prepare(path):
        bev = dense_map(path).to(wanted).to(memory_format=torch.channels_last)
        return lambda: part(bev)

    return prepare


def spconv_runner():
    def prepare(path):
        features, sites = sparse_inputs(path)
        return lambda: MODEL.backbone_3d(features, sites)

    return prepare


def onnx_runner():
    import onnxruntime

    from graph import bytes_of

    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = THREADS
    options.inter_op_num_threads = 1
    options.graph_optimization_level = onnxruntime.GraphOptimizationLevel.ORT_ENABLE_ALL
    session = onnxruntime.InferenceSession(bytes_of(fused_2d(MODEL)), options, providers=["CPUExecutionProvider"])
    check(session)

    def prepare(path):
        bev = dense_map(path).numpy()
        return lambda: session.run(None, {"bev": bev})

    return prepare


def check(session):
    """The graph computes what PyTorch computes."""
    bev = torch.rand(1, 256, ROWS, COLUMNS)
    expected = fused_2d(MODEL)(bev).numpy()
    (found,) = session.run(None, {"bev": bev.numpy()})
    worst = np.abs(found - expected).max() / np.sqrt(np.square(expected).mean())
    if worst > 1e-3:
        raise SystemExit(f"the ONNX graph differs from PyTorch by {worst} of the rms")


def main():
    runners = {
        "torch": lambda: torch_runner(torch.float32),
        "torch-bf16": lambda: torch_runner(torch.bfloat16),
        "onnx": onnx_runner,
        "spconv": spconv_runner,
    }
    with torch.inference_mode():
        prepare = runners[KIND]()
        cases = {}
        print(json.dumps("ready"), flush=True)
        for line in sys.stdin:
            path, rounds = line.rsplit(" ", 1)
            if path not in cases:
                cases = {path: prepare(path)}
                cases[path]()  # not timed
            times = []
            for _ in range(int(rounds)):
                start = time.perf_counter()
                cases[path]()
                times.append(1e3 * (time.perf_counter() - start))
            print(json.dumps(times), flush=True)


main()
