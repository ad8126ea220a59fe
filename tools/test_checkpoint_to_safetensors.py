"""Tests checkpoint_to_safetensors.py on checkpoints that PyTorch writes here; says `skipped` where torch is missing."""

import subprocess
import sys
import tempfile
from pathlib import Path

try:
    import numpy as np
    import torch
    from safetensors.torch import load_file
except ImportError as missing:
    sys.exit(print(f"skipped: {missing}; checkpoint_to_safetensors.py was not tested"))

TOOL = Path(__file__).with_name("checkpoint_to_safetensors.py")
STATE = {"a.weight": torch.arange(6.0).reshape(2, 3).t(), "a.half": torch.ones(2).half(), "a.count": torch.tensor(7)}


class Hostile:
    def __reduce__(self):
        return print, ("run by a pickle",)


def convert(checkpoint, **options):
    with tempfile.TemporaryDirectory() as folder:
        source, out = Path(folder, "c.pth"), Path(folder, "c.safetensors")
        torch.save(checkpoint, source, **options)
        done = subprocess.run([sys.executable, TOOL, source, out], capture_output=True, text=True)
        return (load_file(out) if done.returncode == 0 else None), done.stdout + done.stderr


def same(found):
    return found.keys() == STATE.keys() and all(torch.equal(found[name], STATE[name]) for name in STATE)


learning_rate = {"param_groups": [{"lr": np.float64(3e-8), "betas": (0.95, 0.99)}]}
whole = {"epoch": 80, "model_state": STATE, "optimizer_state": learning_rate, "version": "pcdet+0.6.0"}
for options in ({}, {"_use_new_zipfile_serialization": False}):
    parallel = {"state_dict": {f"module.{name}": value for name, value in STATE.items()}}
    for checkpoint in (STATE, whole, parallel):
        found, said = convert(checkpoint, **options)
        assert found is not None and same(found), said
    found, said = convert({**whole, "hook": Hostile()}, **options)
    assert found is None and "weights_only" in said and "run by a pickle" not in said, said
    found, said = convert({"epoch": 80}, **options)
    assert found is None and "expected a dictionary with model_state" in said, said
print("checkpoint_to_safetensors.py: 10 checkpoints converted or refused as they should")
