"""What each step towards recorded scans is worth: networks trained on scans without it, judged on recorded ones.

    cargo build --release -p mluc-lab -p mluc
    python3 bench/realism/run.py --real DIR/object/training --real DIR/drive_0005 --val data/sim-kitti/val --out runs/realism [--seeds 1,2]

One row leaves out every step of `mluc-lab simulate --without`, each further row takes one step more, the last is the full simulator. A row is simulated
(`sim-kitti`, training split), trained from nothing and judged on the folders of --real and on --val; nothing is chosen on any of them. What is done already is
kept: the same command goes on where it stopped. OUT gets `results.json` and `table.md`. Needs nothing but Python.
"""

import argparse
import json
import math
import random
import shutil
import statistics
import struct
import subprocess
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
STEPS = ["rings", "noise", "drop", "sizes", "confusers"]
# By name of the row: what it takes.
ROWS = {"plain": []} | {step: STEPS[: at + 1] for at, step in enumerate(STEPS)}
# Overlaps on recorded scans; see docs/results.md.
IOU = {"0.5": "car=0.5,pedestrian=0.25,cyclist=0.25", "0.7": "car=0.7,pedestrian=0.5,cyclist=0.5"}
CLASSES = ["car", "pedestrian", "cyclist"]
# Below the horizon, degrees: the part of the field that cars beyond 8 m lie in.
BAND_DEG = [2.0, 8.9]
SCANS = 20


def arguments():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--real", type=Path, action="append", required=True, help="recorded scans; the first folder alone, then all pooled")
    parser.add_argument("--val", type=Path, default=ROOT / "data/sim-kitti/val", help="scans of the full simulator")
    parser.add_argument("--out", type=Path, default=ROOT / "runs/realism")
    parser.add_argument("--frames", type=int, default=800)
    parser.add_argument("--steps", type=int, default=800)
    parser.add_argument("--seeds", default="1", help="of the training, comma separated; the scans stay")
    parser.add_argument("--draws", type=int, default=50, help="of the recorded scans: what the figures of so few cars are worth")
    parser.add_argument("--rows", default=",".join(ROWS), help="in this order")
    parser.add_argument("--lab", type=Path, default=ROOT / "target/release/mluc-lab")
    parser.add_argument("--mluc", type=Path, default=ROOT / "target/release/mluc")
    return parser.parse_args()


def simulate(options, row):
    folder = options.out / "data" / row / "train"
    if not folder.exists():
        partial = folder.with_name("partial")
        shutil.rmtree(partial, ignore_errors=True)
        command = [options.lab, "simulate", "--family", "sim-kitti", "--split", "train", "--seed", "1"]
        command += ["--frames", str(options.frames), "--out", partial]
        left_out = [step for step in STEPS if step not in ROWS[row]]
        subprocess.check_call(command + (["--without", ",".join(left_out)] if left_out else []))
        partial.rename(folder)
    return folder


def train(options, row, seed):
    run = options.out / "runs" / f"{row}-{seed}"
    command = [options.lab, "train", "--setting", "kitti", "--network", "metric", "--data", options.out / "data" / row, "--out", run]
    command += ["--steps", str(options.steps), "--batch", "2", "--seed", str(seed), "--bf16", "--validate-frames", "0"]
    subprocess.check_call(command)
    return run / "model.safetensors"


def judged_real(options, model):
    """Average precision over all points, volumes, moderate: by folders and overlap."""
    lines = []
    for at, folder in enumerate(options.real):
        lines.append(model.with_name(f"objects-{at}.jsonl"))
        with open(lines[-1], "wb") as file:
            subprocess.check_call([options.mluc, "up", "--input", folder, "--model", model, "--pace", "complete", "--profile", "all"], stdout=file)
    figures = {}
    for name, count in {"first": 1, "pooled": len(options.real)}.items():
        for overlap, iou in IOU.items():
            command = [options.lab, "evaluate", "ap", "--json", "--iou", iou, "--classes", ",".join(CLASSES)]
            for folder, file in list(zip(options.real, lines))[:count]:
                command += ["--labels", folder / "label_2", "--calib", folder / "calib", "--detections", file]
            report = json.loads(subprocess.check_output(command))
            figures[f"{name} {overlap}"] = {c: report[f"{c}/3d/moderate"]["ap_all"] for c in CLASSES}
    return figures


def drawn(options, model):
    """Average precision on draws of all recorded scans with replacement, the same draws for every model: by class and overlap."""
    frames = []
    for at, folder in enumerate(options.real):
        for line in model.with_name(f"objects-{at}.jsonl").read_text().splitlines():
            found = json.loads(line)
            files = [folder / part / f"{found['frame']}.txt" for part in ("label_2", "calib")]
            frames.append((found, [file.read_text() for file in files]))
    dice, figures = random.Random(1), {}
    for _ in range(options.draws):
        with tempfile.TemporaryDirectory() as scratch:
            scratch = Path(scratch)
            places = [scratch / "label_2", scratch / "calib"]
            for place in places:
                place.mkdir()
            lines = []
            for at, (found, texts) in enumerate(dice.choices(frames, k=len(frames))):
                lines.append(json.dumps(found | {"frame": f"{at:06}", "sequence": at}))
                for place, text in zip(places, texts):
                    (place / f"{at:06}.txt").write_text(text)
            (scratch / "objects.jsonl").write_text("\n".join(lines))
            for overlap, iou in IOU.items():
                command = [options.lab, "evaluate", "ap", "--json", "--iou", iou, "--classes", ",".join(CLASSES)]
                command += ["--labels", places[0], "--calib", places[1], "--detections", scratch / "objects.jsonl"]
                report = json.loads(subprocess.check_output(command))
                for c in CLASSES:
                    figures.setdefault(f"{c} {overlap}", []).append(report[f"{c}/3d/moderate"]["ap_all"])
    return figures


def judged_simulated(options, model):
    """R40 at the paper's overlaps on the full simulator's validation scans."""
    command = [options.lab, "evaluate", "model", "--json", "--model", model, "--data", options.val, "--refiner", "none"]
    report = json.loads(subprocess.check_output(command))["closed"]
    return {c: report[f"{c}/3d/moderate"]["ap_r40"] for c in CLASSES}


def returns(folder):
    """Means over the first scans, ahead of the sensor: all returns, and those of the band below the horizon."""
    low, high = (-math.tan(math.radians(d)) for d in reversed(BAND_DEG))
    every, band = [], []
    for path in sorted((folder / "velodyne").glob("*.bin"))[:SCANS]:
        ahead = [(x, y, z) for x, y, z, _ in struct.iter_unpack("<4f", path.read_bytes()) if x > 0]
        every.append(len(ahead))
        band.append(sum(low < z / math.hypot(x, y) < high for x, y, z in ahead))
    return {"returns": statistics.mean(every), "band": statistics.mean(band)}


def cars(folder, name):
    """Cars in full view, 6 to 30 m away, and the rotation and shift from sensor to camera: rows of [a, b, c, d]."""
    lines = (folder / "calib" / f"{name}.txt").read_text().splitlines()
    calib = {line.split(":")[0]: [float(v) for v in line.split(":")[1].split()] for line in lines if ":" in line}
    r0, tr = calib["R0_rect"], calib["Tr_velo_to_cam"]
    move = [[sum(r0[3 * i + k] * tr[4 * k + j] for k in range(3)) for j in range(4)] for i in range(3)]
    labels = [line.split() for line in (folder / "label_2" / f"{name}.txt").read_text().splitlines()]
    seen = [[float(v) for v in fields[8:15]] for fields in labels if fields[0] == "Car" and fields[2] == "0" and float(fields[1]) == 0]
    return [box for box in seen if 6 < math.hypot(box[3], box[5]) < 30], move


def inside(folder):
    """Share of the points on cars that lie within 10 cm of the label's sides."""
    near = every = 0
    for path in sorted((folder / "velodyne").glob("*.bin"))[:SCANS]:
        boxes, move = cars(folder, path.stem)
        points = struct.iter_unpack("<4f", path.read_bytes()) if boxes else []
        for p in [p for p in points if p[0] > 0]:
            x, y, z = (a * p[0] + b * p[1] + c * p[2] + d for a, b, c, d in move)
            for h, w, l, bx, by, bz, turn in boxes:
                dx, dz = x - bx, z - bz
                # The lowest 20 cm hold points on the ground.
                if abs(dx) + abs(dz) > l or not 0.2 < by - y < h:
                    continue
                along, across = dx * math.cos(turn) - dz * math.sin(turn), dx * math.sin(turn) + dz * math.cos(turn)
                depth = min(l / 2 - abs(along), w / 2 - abs(across))
                every += depth >= 0
                near += 0 <= depth < 0.1
    return 100 * near / max(every, 1)


def measured(options, folder):
    """What can be compared with recorded scans: returns, cars' lengths, median of the points in a car by distance, how deep in the label they lie."""
    found = returns(folder) | {"inside": inside(folder)}
    text = subprocess.check_output([options.lab, "stats", "--dataset", folder], text=True)
    for line in text.splitlines():
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        if cells[0] == "Car" and cells[2] == "length, m":
            found["length"] = cells[3]
        elif cells[0] == "Car" and cells[1] in ("10-20", "20-30", "30-40"):
            found[cells[1]] = float(cells[3].split(",")[1])
    return found


COLUMNS = {"car 0.5": "car 0.5", "car 0.7": "car 0.7", "pedestrian 0.25": "pedestrian 0.5", "cyclist 0.25": "cyclist 0.5"}


def table_of_statistics(results):
    head = ["", "returns ahead", "of them 2 to 9 degrees down", "points in a car at 10-20, 20-30, 30-40 m", "within 10 cm of the label, %", "length of cars, m"]
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    for row in ["recorded", *ROWS]:
        if s := results.get(row, {}).get("statistics"):
            points = ", ".join(f"{s[bin]:.0f}" for bin in ("10-20", "20-30", "30-40"))
            lines.append(f"| {called(row)} | {s['returns']:.0f} | {s['band']:.0f} | {points} | {s['inside']:.0f} | {s['length']} |")
    return "\n".join(lines) + "\n"


def called(row):
    return f"+ {row}" if row in STEPS else row


def spread(draws):
    return f"{statistics.mean(draws):+.1f} ± {statistics.stdev(draws):.1f}"


def table_of_figures(results, seed):
    """AP with the deviation over draws of the recorded scans, then the difference to the row above and to the first over the same draws."""
    head = ["", *COLUMNS, *(f"simulated: {c}" for c in CLASSES)]
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    rows = [row for row in ROWS if seed in results.get(row, {})]
    for row in rows:
        found = results[row][seed]
        cells = []
        for draws in COLUMNS.values():
            c, overlap = draws.split()
            cells.append(f"{found['pooled ' + overlap][c]:.1f} ± {statistics.stdev(found['draws'][draws]):.1f}")
        cells += [f"{found['simulated'][c]:.1f}" for c in CLASSES]
        lines.append("| " + " | ".join([called(row), *cells]) + " |")
    names = list(ROWS)
    pairs = {f"{row} against {before}": (row, before) for before, row in zip(names, names[1:])} | {"all against plain": (names[-1], names[0])}
    for name, (row, before) in pairs.items():
        if row not in rows or before not in rows:
            continue
        here, there = results[row][seed]["draws"], results[before][seed]["draws"]
        cells = [spread([a - b for a, b in zip(here[draws], there[draws])]) for draws in COLUMNS.values()]
        lines.append("| " + " | ".join([name, *cells, *([""] * len(CLASSES))]) + " |")
    return "\n".join(lines) + "\n"


def main():
    options = arguments()
    options.out.mkdir(parents=True, exist_ok=True)
    path = options.out / "results.json"
    results = json.loads(path.read_text()) if path.exists() else {}

    def keep():
        path.write_text(json.dumps(results, indent=1))
        seeds = sorted({int(key) for row in results.values() for key in row if key.isdigit()})
        tables = [table_of_statistics(results), *(f"Seed {seed}\n\n" + table_of_figures(results, str(seed)) for seed in seeds)]
        (options.out / "table.md").write_text("\n".join(tables))

    results["recorded"] = {"statistics": measured(options, options.real[0])}
    for seed in options.seeds.split(","):
        for row in options.rows.split(","):
            found = results.setdefault(row, {})
            if "statistics" not in found:
                found["statistics"] = measured(options, simulate(options, row))
            if seed in found:
                continue
            simulate(options, row)
            model = train(options, row, seed)
            found[seed] = judged_real(options, model) | {"draws": drawn(options, model), "simulated": judged_simulated(options, model)}
            keep()
    print((options.out / "table.md").read_text())


if __name__ == "__main__":
    main()
