#!/usr/bin/env python3
"""What each kind of background in simulated scans is worth: false objects on recorded scans, where the score of clusters never saw it.

    cargo build --release -p mluc-lab -p mluc
    python3 bench/realism/false_objects.py --real DIR/object/training --real DIR/drive_0005 --out runs/false-objects [--model FILE --family sim-any]

The weights of the network stay. Its score of clusters is fitted anew to scans with synthetic unknown objects: in the first row with every kind of background, in
each further row without one (`mluc-lab simulate --without`). Each row is judged on the folders of --real, with everything published; nothing is chosen on them.
What is done already is kept. A folder in OUT, of model, family and frames, gets `results.json` and `table.md`. Needs nothing but Python.
"""

import argparse
import json
import os
import shutil
import subprocess
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
KINDS = {"sim-kitti": ["confusers", "frontage", "furniture", "vegetation"]}
KINDS["sim-any"] = [*KINDS["sim-kitti"], "street", "weather"]
RATES = ["at most 1", "at most 0.5", "at most 0.3", "at most 0.1"]


def arguments():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--real", type=Path, action="append", required=True, help="recorded scans")
    parser.add_argument("--model", type=Path, default=ROOT / "weights/paper/kitti-open.safetensors")
    parser.add_argument("--family", choices=KINDS, default="sim-kitti")
    parser.add_argument("--out", type=Path, default=ROOT / "runs/false-objects")
    parser.add_argument("--frames", type=int, default=1200)
    parser.add_argument("--unknown", default="van,truck")
    parser.add_argument("--lab", type=lambda path: Path(path).resolve(), default=ROOT / "target/release/mluc-lab")
    parser.add_argument("--mluc", type=lambda path: Path(path).resolve(), default=ROOT / "target/release/mluc")
    return parser.parse_args()


def scored(options, kind):
    """The model with a score of clusters that never saw a kind of background."""
    folder = options.out / (kind or "all")
    shutil.rmtree(folder / "partial", ignore_errors=True)
    model = folder / "model.safetensors"
    if not (folder / "train").exists():
        command = [options.lab, "simulate", "--family", options.family, "--split", "train", "--synthetic-unknown", "--seed", "1977"]
        command += ["--frames", str(options.frames), "--out", folder / "partial"] + (["--without", kind] if kind else [])
        subprocess.check_call(command)
        (folder / "partial").rename(folder / "train")
    subprocess.check_call([options.lab, "score-clusters", "--model", options.model, "--data", folder / "train", "--out", model])
    return model


def judged(options, model):
    """AP of the unknown over all points, and recall, %, at so many unknown objects a scan on no label."""
    where = []
    for at, folder in enumerate(options.real):
        lines = model.with_name(f"objects-{at}.jsonl")
        with open(lines, "wb") as file:
            subprocess.check_call([options.mluc, "up", "--input", folder, "--model", model, "--pace", "complete", "--profile", "all", "--instance", f"false-objects-{os.getpid()}"], stdout=file)
        where += ["--labels", folder / "label_2", "--calib", folder / "calib", "--detections", lines]
    where += ["--classes", "car,pedestrian,cyclist", "--iou", "car=0.5,pedestrian=0.25,cyclist=0.25", "--unknown", options.unknown, "--json"]
    report = json.loads(subprocess.check_output([options.lab, "evaluate", "operating", *where]))
    ap = json.loads(subprocess.check_output([options.lab, "evaluate", "ap", *where, "--unknown-iou", "0.1"]))
    recall = {row["name"]: row["recall"][0] for row in report["unknown"]}
    return {"ap": ap["unknown/3d/moderate"]["ap_all"], "recall": recall}


def table(results):
    head = ["", "AP unknown", *(f"found, %, {rate}" for rate in RATES)]
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    for name, found in results.items():
        cells = [found["ap"], *(found["recall"][rate] for rate in RATES)]
        lines.append(f"| {name} | " + " | ".join(f"{cell:.1f}" for cell in cells) + " |")
    return "\n".join(lines) + "\n"


def main():
    options = arguments()
    # Rows of another model or family are others.
    options.out = options.out / f"{options.model.stem}-{options.family}-{options.frames}"
    options.out.mkdir(parents=True, exist_ok=True)
    path = options.out / "results.json"
    results = json.loads(path.read_text()) if path.exists() else {}
    for kind in [None, *KINDS[options.family]]:
        name = f"without {kind}" if kind else "every kind"
        if name not in results:
            results[name] = judged(options, scored(options, kind))
            path.write_text(json.dumps(results, indent=1))
            (options.out / "table.md").write_text(table(results))
    print(table(results))


if __name__ == "__main__":
    main()
