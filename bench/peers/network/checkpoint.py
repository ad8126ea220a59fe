"""Writes a checkpoint as OpenPCDet saves them, and what PyTorch and spconv answer with it on one scan.

    OMP_NUM_THREADS=1 python checkpoint.py FOLDER [SCAN.bin]

FOLDER gets checkpoint.pth (zip) and legacy.pth (the format before 1.6), both also as safetensors, points.bin (x, y, z,
intensity) and, for each of conv_cls, conv_box and conv_dir_cls, NAME.bin: f32, cell after cell, channels together.
lab/mluc-lab/tests/lab/exchange_torch.rs reads them where MLUC_PEERS_CHECKPOINT names the folder. Without a scan, points are made up.
"""

import os
import subprocess
import sys
from pathlib import Path

os.environ["OMP_NUM_THREADS"] = "1"  # spconv's sums are wrong with more

import numpy as np
import torch

from second import random_second, to_map, voxelize


def synthetic_unknown_points(count=30_000):
    """A floor and some walls."""
    random = np.random.default_rng(1)
    x, y = random.uniform(1, 60, count), random.uniform(-30, 30, count)
    walls = random.integers(0, 20, count)
    z = np.where(walls < 12, -1.7, random.uniform(-1.7, 0.8, count))
    x = np.where(walls >= 12, 3.0 * walls - 30.0, x)
    return np.stack([x, y, z, random.uniform(0, 1, count)], 1).astype(np.float32)


def main():
    folder = Path(sys.argv[1])
    folder.mkdir(parents=True, exist_ok=True)
    points = synthetic_unknown_points()
    if len(sys.argv) > 2:
        points = np.fromfile(sys.argv[2], np.float32).reshape(-1, 4)
    torch.set_num_threads(1)
    model = random_second()
    # One weight in each other floating type would do; what matters is what trainers really store beside the weights.
    state = {
        "epoch": 80,
        "it": 74240,
        "model_state": model.state_dict(),
        "optimizer_state": {"state": {}, "param_groups": [{"lr": np.float64(3e-8), "betas": (0.95, 0.99)}]},
        "version": "pcdet+0.6.0",
    }
    torch.save(state, folder / "checkpoint.pth")
    torch.save(state, folder / "legacy.pth", _use_new_zipfile_serialization=False)
    tool = Path(__file__).parents[3] / "tools/checkpoint_to_safetensors.py"
    for name in ("checkpoint", "legacy"):
        command = [sys.executable, tool, folder / f"{name}.pth", folder / f"{name}.safetensors"]
        subprocess.run(command, check=True)
    points.tofile(folder / "points.bin")
    features, sites = voxelize(points)
    with torch.inference_mode():
        bev = to_map(model.backbone_3d(torch.from_numpy(features), torch.from_numpy(sites)))
        outputs = model.dense_head(model.backbone_2d(bev))
    for name, output in zip(("conv_cls", "conv_box", "conv_dir_cls"), outputs):
        output[0].permute(1, 2, 0).contiguous().numpy().tofile(folder / f"{name}.bin")
        print(name, tuple(output.shape), "rms", float(output.square().mean().sqrt()))


main()
