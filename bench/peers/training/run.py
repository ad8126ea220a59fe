"""A training step of `compact` beside PyTorch's, same weights, voxels, gradient and threads, alternating: one record.

    bench/peers/network/install
    cargo build --release -p mluc-bench --bin train_step -p mluc-lab --bin mluc-lab
    target/peers/venv/bin/python bench/peers/training/run.py [--settings kitti,udi] [--rounds 7] [--threads 2] [--frame 0]

Forward, and backward from a fixed random gradient of the outputs: no losses, no optimiser, no preparation of the batch
(`plan_ms`; the trainer does it on another thread). Scans: data/sim-SETTING/val, or simulated where it is not there.
Ours: `mluc` as it trains (the halo; heads at labelled cells), `mluc every cell` (what PyTorch computes, cell for cell).
PyTorch: see network.py. Before anything is timed, our outputs (1e-4 of the largest) and the gradients of every tensor
(3 % of its norm) must be those of PyTorch in double precision; `difference` has both sides' distance from it. A ratio is PyTorch's median over ours; `cpu` is the time that a program's threads had a processor, which other
programs on the machine change less than `wall`.
"""

import argparse
import importlib.util
import json
import os
import statistics
import subprocess
from pathlib import Path

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[2]
OUTPUTS_MAX, GRADIENTS_MAX = 1e-4, 0.03
# What a careful user of PyTorch sets: large maps are kept, not given back to the system after each step.
os.environ.update(MALLOC_MMAP_THRESHOLD_=str(1 << 30), MALLOC_TRIM_THRESHOLD_=str(1 << 40), MALLOC_TOP_PAD_=str(1 << 28))

spec = importlib.util.spec_from_file_location("network_run", HERE.parent / "network" / "run.py")
network_run = importlib.util.module_from_spec(spec)
spec.loader.exec_module(network_run)


def arguments():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--settings", default="kitti,udi")
    parser.add_argument("--frame", type=int, default=0)
    parser.add_argument("--rounds", type=int, default=7, help="turns of each program, two steps each")
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--program", type=Path, default=ROOT / "target/release/train_step")
    parser.add_argument("--out", type=Path, default=ROOT / "bench/record/training.json")
    return parser.parse_args()


def scans(setting):
    folder = ROOT / f"data/sim-{setting}/val"
    if not folder.exists():
        folder = ROOT / f"target/peers/training/sim-{setting}"
    if not folder.exists():
        simulate = [ROOT / "target/release/mluc-lab", "simulate", "--family", f"sim-{setting}", "--split", "val"]
        subprocess.check_call(simulate + ["--frames", "4", "--out", folder])
    return folder


class Ours:
    def __init__(self, options, setting, *more):
        self.command = [options.program, "--setting", setting, "--data", scans(setting), "--frame", str(options.frame)]
        self.command += ["--threads", str(options.threads), *more]

    def run(self, *more):
        return json.loads(subprocess.check_output(self.command + list(more)))

    def milliseconds(self, _folder):
        return self.run("--rounds", str(network_run.TURN))["steps_ms"]

    def close(self):
        pass


def parts(steps):
    """Medians over steps, both passes of a part together."""
    table = {}
    for part, names in {"sparse": ["sparse"], "map": ["map"], "all": ["sparse", "map"]}.items():
        laps = [name + way for name in names for way in ("_forward", "_backward")]
        for clock in ("cpu", "wall"):
            sums = [sum(step[lap][clock] for lap in laps) for step in steps]
            table.setdefault(part, {})[clock] = round(statistics.median(sums), 1)
            table[part][clock + "_least"] = round(min(sums), 1)
    return table


def ratios(ours, peer):
    return {part: {clock: round(peer[part][clock] / ours[part][clock], 2) for clock in ours[part]} for part in ours}


def compare(options, setting):
    folder = ROOT / f"target/peers/training/{setting}"
    folder.parent.mkdir(parents=True, exist_ok=True)
    shape = Ours(options, setting).run("--rounds", "0", "--write", str(folder))
    del shape["steps_ms"]
    worker = HERE / "worker.py"
    check = network_run.Peer("check", options.threads, worker)
    agreement = check.milliseconds(folder)
    check.close()
    print(setting, shape, agreement, flush=True)
    if agreement["mluc"]["outputs"] > OUTPUTS_MAX or agreement["mluc"]["gradients"] > GRADIENTS_MAX:
        raise SystemExit("not the same step")
    programs = {
        "mluc": Ours(options, setting),
        "mluc every cell": Ours(options, setting, "--every-cell"),
        "pytorch": network_run.Peer("f32", options.threads, worker),
        "mluc bf16": Ours(options, setting, "--bf16"),
        "pytorch bf16": network_run.Peer("bf16", options.threads, worker),
    }
    steps = {name: [] for name in programs}
    for _ in range(options.rounds):
        for name, program in programs.items():
            steps[name] += program.milliseconds(folder)
    for program in programs.values():
        program.close()
    ms = {name: parts(found) for name, found in steps.items()}
    return {
        "step": shape,
        "difference": agreement,
        "ms": ms,
        "ratio": {
            "as trained": ratios(ms["mluc"], ms["pytorch"]),
            "every cell": ratios(ms["mluc every cell"], ms["pytorch"]),
            "as trained, bf16": ratios(ms["mluc bf16"], ms["pytorch bf16"]),
        },
    }


def main():
    options = arguments()
    record = {
        "what": "compact, one training step of one scan, ms by part; ratio: PyTorch's over ours",
        "threads": options.threads,
        "steps": options.rounds * network_run.TURN,
        "machine": network_run.machine(),
        "settings": {},
    }
    for setting in options.settings.split(","):
        found = record["settings"][setting] = compare(options, setting)
        record["machine"]["load_average_after"] = os.getloadavg()
        options.out.write_text(json.dumps(record, indent=1) + "\n")
        for name, table in found["ms"].items():
            print(setting, name, {part: (row["cpu"], row["wall"]) for part, row in table.items()})
        for name, table in found["ratio"].items():
            print(setting, name, {part: (row["cpu"], row["wall"]) for part, row in table.items()}, flush=True)


if __name__ == "__main__":
    main()
