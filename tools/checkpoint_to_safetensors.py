#!/usr/bin/env python3
"""Converts a PyTorch checkpoint of OpenPCDet to safetensors, which `mluc-lab import` reads.

    python tools/checkpoint_to_safetensors.py second.pth second.safetensors

Needs the packages torch (2.6 or later, which need not be the environment that wrote the file), numpy and safetensors. The file is loaded with weights_only=True: tensors and plain values are
read, and a pickle that calls anything else is refused.
"""

import sys

import numpy as np
import torch
from safetensors.torch import save_file

if not hasattr(torch.serialization, "safe_globals"):
    sys.exit(f"torch: expected 2.6 or later, found {torch.__version__}: run this in an environment of its own")
# An optimiser's state holds learning rates as numpy scalars.
scalar = (np._core if hasattr(np, "_core") else np.core).multiarray.scalar
NUMPY = [scalar, (scalar, "numpy.core.multiarray.scalar"), np.dtype, type(np.dtype("f4")), type(np.dtype("f8"))]


def weights(path):
    with torch.serialization.safe_globals(NUMPY):
        checkpoint = torch.load(path, map_location="cpu", weights_only=True)
    # Trainers keep the weights under one of these keys; `module.` precedes the names where several devices trained.
    state = next((checkpoint[key] for key in ("model_state", "state_dict") if key in checkpoint), checkpoint)
    tensors = {name: value.contiguous().clone() for name, value in state.items() if torch.is_tensor(value)}
    if not tensors:
        sys.exit(f"{path}: expected a dictionary with model_state (name -> tensor), found {list(checkpoint)[:8]}")
    parallel = all(name.startswith("module.") for name in tensors)
    return {name.removeprefix("module.") if parallel else name: value for name, value in tensors.items()}


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit("usage: checkpoint_to_safetensors.py CHECKPOINT.pth OUT.safetensors")
    save_file(weights(sys.argv[1]), sys.argv[2], metadata={"format": "pt"})
