"""Compares train_on_gpu with `mluc-lab train` on the first step of a batch; says `skipped` where PyTorch or mluc-lab is missing."""

import json
import subprocess
import sys
import tempfile
from pathlib import Path

try:
    import torch  # noqa: F401
    from safetensors.torch import load_file
except ImportError as missing:
    sys.exit(print(f"skipped: {missing}; train_on_gpu was not tested"))

TOOL = Path(__file__).with_name("train_on_gpu")
LAB = Path(__file__).parent.parent / "target/release/mluc-lab"
if not LAB.exists():
    sys.exit(print(f"skipped: no {LAB}; train_on_gpu was not tested"))


def run(*words, **options):
    return subprocess.run([str(word) for word in words], check=True, capture_output=True, **options).stdout


def compare(folder, family, *options):
    """Losses of the first step, and the running statistics after it."""
    data, here, there = folder / family, folder / "here", folder / "there"
    run(LAB, "simulate", "--family", family, "--split", "train", "--synthetic-unknown", "--frames", 4, "--seed", 5, "--out", data / "train")
    train = [LAB, "train", *options, "--data", data, "--batch", 2, "--steps", 1, "--validate-frames", 0]
    run(*train, "--out", here)
    stream = run(*train, "--out", there, "--stream")
    first = load_file(there / "model.safetensors")
    found = json.loads(run(sys.executable, TOOL, there, "--check", input=stream))
    expected = json.loads((here / "train.jsonl").read_text())["losses"]
    expected["box"] = expected.pop("boxes")
    for name, value in found.items():
        # The cells of the background are drawn at random.
        near = 0.2 if name == "unknown" else 1e-3
        assert abs(value - expected[name]) <= near * expected[name] + 1e-6, (options, name, value, expected[name])
    run(sys.executable, TOOL, there, input=stream)
    ours, theirs = (load_file(place / "model.safetensors") for place in (here, there))
    # mluc-lab train fits it at the end; here mluc-lab score-clusters does.
    ours.pop("clusters.looks", None)
    assert ours.keys() == theirs.keys()
    for name, values in ours.items():
        if name.endswith("running_mean"):
            assert torch.allclose(values, theirs[name], rtol=1e-2, atol=1e-2), (options, name)
        if name.startswith("head") and name.endswith("weight") and "unknown" not in name:
            moved, off = (values - first[name]).norm(), (values - theirs[name]).norm()
            assert off <= 0.1 * moved, (options, name, off / moved)


with tempfile.TemporaryDirectory() as folder:
    compare(Path(folder), "sim-any", "--setting", "any", "--network", "mluc-full")
with tempfile.TemporaryDirectory() as folder:
    compare(Path(folder), "sim-kitti", "--setting", "kitti", "--network", "sigmoid", "--architecture", "second")
print("train_on_gpu: losses and steps are those of mluc-lab train")
