#!/usr/bin/env python3
"""What each kind of background in simulated scans is worth: false objects on recorded scans of networks that never saw it.

    cargo build --release -p mluc-lab -p mluc
    python3 bench/realism/false_objects.py --real DIR/object/training --real DIR/drive_0005 --out runs/false-objects [--model weights/any-open.safetensors]

The first row has every kind, each further row lacks one (`mluc-lab simulate --without`). Without --model a row is a network of `mluc-full` on streets (`sim-kitti`),
trained from nothing on scans with synthetic unknown objects. With --model its weights stay and its score of clusters is fitted anew to scans by any sensor
(`sim-any`). Each row is judged on the folders of --real, with everything published; nothing is chosen on them. What is done already is kept.
OUT gets `results.json` and `table.md`. Needs nothing but Python.
"""

import argparse
import json
import subprocess
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
KINDS = {"sim-kitti": ["confusers", "frontage", "furniture", "vegetation"]}
KINDS["sim-any"] = [*KINDS["sim-kitti"], "street", "weather"]
RATES = ["at most 1", "at most 0.5", "at most 0.3", "at most 0.1"]


def arguments():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--real", type=Path, action="append", required=True, help="recorded scans")
    parser.add_argument("--model", type=Path, help="fit the score of clusters of this model in place of training")
    parser.add_argument("--out", type=Path, default=ROOT / "runs/false-objects")
    parser.add_argument("--frames", type=int, default=1200)
    parser.add_argument("--steps", type=int, default=2000)
    parser.add_argument("--seed", type=int, default=1, help="of the training and of the fit; the scans stay")
    parser.add_argument("--unknown", default="van,truck")
    parser.add_argument("--lab", type=Path, default=ROOT / "target/release/mluc-lab")
    parser.add_argument("--mluc", type=Path, default=ROOT / "target/release/mluc")
    return parser.parse_args()


def simulated(options, family, kind):
    """Scans with synthetic unknown objects, without a kind of background."""
    folder = options.out / family / (kind or "all")
    if not (folder / "train").exists():
        partial = folder / "partial"
        command = [options.lab, "simulate", "--family", family, "--split", "train", "--synthetic-unknown", "--seed", "1977"]
        command += ["--frames", str(options.frames), "--out", partial] + (["--without", kind] if kind else [])
        subprocess.check_call(command)
        partial.rename(folder / "train")
    return folder


def made(options, folder):
    """The model of a row."""
    if options.model:
        model = folder / f"scored-{options.seed}.safetensors"
        command = [options.lab, "score-clusters", "--model", options.model, "--data", folder / "train", "--out", model]
    else:
        run = folder / f"run-{options.seed}"
        model = run / "model.safetensors"
        command = [options.lab, "train", "--setting", "kitti", "--network", "mluc-full", "--data", folder, "--out", run]
        command += ["--steps", str(options.steps), "--batch", "2", "--bf16", "--validate-frames", "0"]
    subprocess.check_call([*command, "--seed", str(options.seed)])
    return model


def judged(options, model):
    """AP of the unknown over all points, and recall, %, at so many unknown objects a scan on no label; the same recall of known objects."""
    where = []
    for at, folder in enumerate(options.real):
        lines = model.with_name(f"objects-{at}.jsonl")
        with open(lines, "wb") as file:
            subprocess.check_call([options.mluc, "up", "--input", folder, "--model", model, "--pace", "complete", "--profile", "all"], stdout=file)
        where += ["--labels", folder / "label_2", "--calib", folder / "calib", "--detections", lines]
    where += ["--classes", "car,pedestrian,cyclist", "--iou", "car=0.5,pedestrian=0.25,cyclist=0.25", "--unknown", options.unknown, "--json"]
    report = json.loads(subprocess.check_output([options.lab, "evaluate", "operating", *where]))
    ap = json.loads(subprocess.check_output([options.lab, "evaluate", "ap", *where, "--unknown-iou", "0.1"]))
    recall = {kind: {row["name"]: row["recall"][0] for row in report[kind]} for kind in ("unknown", "known")}
    published = {row["name"]: row["on_no_label"][0] for row in report["unknown"]}["published"]
    return {"ap": ap["unknown/3d/moderate"]["ap_all"], "published": published, **recall}


def table(results):
    head = ["", "unknown a scan on no label, everything published", "AP unknown", *(f"unknown found, %, {rate}" for rate in RATES), "known found, %, at most 0.5"]
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    for name, found in results.items():
        cells = [found["published"], found["ap"], *(found["unknown"][rate] for rate in RATES), found["known"]["at most 0.5"]]
        lines.append(f"| {name} | " + " | ".join(f"{cell:.1f}" for cell in cells) + " |")
    return "\n".join(lines) + "\n"


def main():
    options = arguments()
    options.out.mkdir(parents=True, exist_ok=True)
    family = "sim-any" if options.model else "sim-kitti"
    path = options.out / f"results-{family}-{options.seed}.json"
    results = json.loads(path.read_text()) if path.exists() else {}
    for kind in [None, *KINDS[family]]:
        name = f"without {kind}" if kind else "every kind"
        if name not in results:
            results[name] = judged(options, made(options, simulated(options, family, kind)))
            path.write_text(json.dumps(results, indent=1))
            (options.out / f"table-{family}-{options.seed}.md").write_text(table(results))
    print(table(results))


if __name__ == "__main__":
    main()
