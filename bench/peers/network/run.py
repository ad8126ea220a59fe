"""Our network beside its peers, on the same scans and threads, alternating: one table, one record.

    target/peers/venv/bin/python bench/peers/network/run.py [--scans 9] [--rounds 7] [--threads 2] [--only f32,bf16,sparse]

Scans: MLUC_KITTI/object/training (full, and cropped to what the camera sees), or simulated ones where it is not set.
Parts compared: `second`, bird's-eye part from the map to the feature rows against PyTorch (channels_last, batch norm
folded) and ONNX Runtime; sparse part with index building, one thread, against spconv (wrong with more). Every figure
is a median over rounds that alternate between the programs; a ratio is the peer's median over ours.
"""

import argparse
import json
import os
import statistics
import subprocess
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[2]
# Rounds of one program at a time: the others wait.
TURN = 2
PARTS = "f32,bf16,sparse"


def arguments():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scans", type=int, default=9, help="first so many scans")
    parser.add_argument("--rounds", type=int, default=7, help="turns of each program on each scan")
    parser.add_argument("--threads", type=int, default=2, help="of the bird's-eye part")
    parser.add_argument("--only", default=PARTS)
    parser.add_argument("--program", type=Path, default=ROOT / "target/release/network")
    parser.add_argument("--out", type=Path, default=ROOT / "bench/record")
    return parser.parse_args()


class Peer:
    """A worker that waits for work."""

    def __init__(self, kind, threads, worker=HERE / "worker.py"):
        command = [sys.executable, "-W", "ignore", worker, kind, str(threads)]
        pipe = subprocess.PIPE
        self.process = subprocess.Popen(command, stdin=pipe, stdout=pipe, stderr=subprocess.DEVNULL, text=True)
        self.read()

    def read(self):
        line = self.process.stdout.readline()
        if not line:
            raise SystemExit(f"{self.process.args[3:]} ended: run it by hand to see why")
        return json.loads(line)

    def milliseconds(self, points):
        self.process.stdin.write(f"{points} {TURN}\n")
        self.process.stdin.flush()
        return self.read()

    def close(self):
        self.process.stdin.close()
        self.process.wait()


class Ours:
    def __init__(self, program, part, precision, threads):
        self.part = part
        self.command = [program, "--profile", "second", "--precision", precision, "--threads", str(threads)]

    def milliseconds(self, points):
        """The median of a few frames."""
        command = self.command + ["--rounds", str(2 * TURN), "--scan", points]
        answer = json.loads(subprocess.check_output(command))
        return [answer["ms_p50"][self.part]]

    def close(self):
        pass


def scans(count):
    """Points of each case: (name, view, file)."""
    made = ROOT / "target/peers/scans"
    made.mkdir(parents=True, exist_ok=True)
    folder = os.environ.get("MLUC_KITTI")
    if folder:
        folder, source = Path(folder) / "object/training", "KITTI"
    else:
        folder, source = ROOT / "target/peers/simulated", "simulated"
        if not folder.exists():
            simulate = [ROOT / "target/release/mluc-lab", "simulate", "--family", "sim-kitti", "--split", "test"]
            subprocess.check_call(simulate + ["--frames", "9", "--out", folder])
    files = sorted((folder / "velodyne").glob("*.bin"))[:count]
    if not files:
        raise SystemExit(f"{folder} holds no scan")
    cases = []
    for file in files:
        cases.append((file.stem, "full", file))
        cases.append((file.stem, "crop", crop(file, made / f"{source}-{file.stem}-crop.bin")))
    return source, cases


def crop(scan, target):
    """What KITTI's left colour camera sees."""
    import numpy as np

    lines = (scan.parents[1] / "calib" / scan.stem).with_suffix(".txt").read_text().splitlines()
    rows = {key: np.array(values.split(), float) for key, _, values in (line.partition(":") for line in lines) if key}
    turned = rows["R0_rect"].reshape(3, 3) @ rows["Tr_velo_to_cam"].reshape(3, 4)
    points = np.fromfile(scan, np.float32).reshape(-1, 4)
    rect = np.c_[points[:, :3], np.ones(len(points))] @ turned.T
    u, v, depth = (np.c_[rect, np.ones(len(points))] @ rows["P2"].reshape(3, 4).T).T
    seen = (depth > 0) & (u >= 0) & (u < 1242 * depth) & (v >= 0) & (v < 375 * depth)
    points[seen].tofile(target)
    return target


def compare(title, cases, rounds, programs):
    """Medians by case and program."""
    for program in programs.values():  # the first run of each is not counted
        program.milliseconds(cases[0][2])
    table = []
    for name, view, points in cases:
        times = {program: [] for program in programs}
        for _ in range(rounds):
            for label, program in programs.items():
                times[label] += program.milliseconds(points)
        medians = {label: round(statistics.median(values), 2) for label, values in times.items()}
        ratio = round(min(value for label, value in medians.items() if label != "mluc") / medians["mluc"], 2)
        table.append({"scan": name, "view": view, "ms": medians, "ratio": ratio})
        print(f"{title:8} {name} {view}: {medians}, {ratio} x", flush=True)
    for program in programs.values():
        program.close()
    return table


def summary(table):
    """Medians over the scans, by view."""
    views = {}
    for view in ("crop", "full"):
        rows = [row for row in table if row["view"] == view]
        ms = {label: round(statistics.median(row["ms"][label] for row in rows), 2) for label in rows[0]["ms"]}
        ratios = [row["ratio"] for row in rows]
        views[view] = {"ms": ms, "ratio_median": statistics.median(ratios), "ratio_min": min(ratios)}
    return views


def machine():
    text = Path("/proc/cpuinfo").read_text().splitlines()
    model = next((line.split(":")[1].strip() for line in text if line.startswith("model name")), "unknown")
    family = [next((line.split(":")[1].strip() for line in text if line.startswith(key)), "?") for key in ("cpu family", "model\t")]
    flags = next((line.split() for line in text if line.startswith("flags")), [])
    wanted = ("avx2", "fma", "avx512f", "avx512_bf16", "avx512_vnni", "amx_bf16")
    import onnxruntime
    import spconv
    import torch

    commit = subprocess.run(["git", "rev-parse", "--short=12", "HEAD"], capture_output=True, text=True, cwd=ROOT).stdout
    return {
        "processor": model,
        "family_model": "/".join(family),
        "cores": os.cpu_count(),
        "registers": [flag for flag in wanted if flag in flags],
        "system": os.uname().release,
        "load_average": os.getloadavg(),
        "commit": commit.strip(),
        "torch": torch.__version__,
        "onnxruntime": onnxruntime.__version__,
        "spconv": spconv.__version__,
    }


def main():
    options = arguments()
    source, cases = scans(options.scans)
    described = machine()
    threads = options.threads

    def ours(part, precision, threads):
        return Ours(options.program, part, precision, threads)

    comparisons = {
        "f32": lambda: {
            "mluc": ours("dense2d", "f32", threads),
            "pytorch": Peer("torch", threads),
            "onnxruntime": Peer("onnx", threads),
        },
        "bf16": lambda: {"mluc": ours("dense2d", "bf16", threads), "pytorch": Peer("torch-bf16", threads)},
        "sparse": lambda: {"mluc": ours("sparse3d", "f32", 1), "spconv": Peer("spconv", 1)},
    }
    record = {
        "what": "second: bird's-eye part (f32, bf16), sparse part with index building (one thread), ms; those under `summary`",
        "source": source,
        "threads": {"f32": threads, "bf16": threads, "sparse": 1},
        "rounds": options.rounds,
        "machine": described,
        "summary": {},
        "scans": {},
    }
    for title in options.only.split(","):
        table = compare(title, cases, options.rounds, comparisons[title]())
        record["scans"][title] = table
        record["summary"][title] = summary(table)
    record["machine"]["load_average_after"] = os.getloadavg()
    options.out.mkdir(parents=True, exist_ok=True)
    name = "+".join(record["summary"])
    path = options.out / ("network.json" if set(record["summary"]) == set(PARTS.split(",")) else f"network-{name}.json")
    path.write_text(json.dumps(record, indent=1) + "\n")
    print_table(record["summary"])
    print(path)


def print_table(parts):
    print("\n| part | view | mluc ms | peers ms | median ratio to the faster | least |\n|---|---|---|---|---|---|")
    for title, views in parts.items():
        for view, row in views.items():
            peers = ", ".join(f"{label} {value}" for label, value in row["ms"].items() if label != "mluc")
            print(f"| {title} | {view} | {row['ms']['mluc']} | {peers} | {row['ratio_median']:.2f} | {row['ratio_min']:.2f} |")


if __name__ == "__main__":
    main()
