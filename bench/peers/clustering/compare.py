"""Times of PCL and scikit-learn on the candidates that our `clustering` wrote, beside ours: compare.py WORK RECORD.

One thread each. What is timed is what a frame pays: the search structure is built anew for every candidate.
"""

import json
import pathlib
import platform
import statistics
import subprocess
import sys
import time

import numpy
import sklearn
from sklearn.cluster import DBSCAN

RUNS = 9


def median_us(work):
    """The middle of a few runs after one that does not count, and what the last one gave."""
    times = []
    for run in range(RUNS + 1):
        start = time.perf_counter()
        result = work()
        if run > 0:
            times.append(1e6 * (time.perf_counter() - start))
    return statistics.median(times), result


def scikit_learn(folder, about):
    """DBSCAN, and with one point a core point: Euclidean clusters."""
    settings = {
        "dbscan": (about["dbscan"]["epsilon_m"], about["dbscan"]["core_points"]),
        "euclidean": (about["euclidean"]["tolerance_m"], 1),
    }
    found = {way: {} for way in settings}
    for candidate in about["candidates"]:
        name, seed = candidate["name"], candidate["seed"]
        points = numpy.fromfile(folder / f"{name}.f32", dtype="<f4").reshape(-1, 3)
        for way, (epsilon_m, core_points) in settings.items():
            clusters = DBSCAN(eps=epsilon_m, min_samples=core_points, n_jobs=1)
            us, labels = median_us(lambda: clusters.fit_predict(points))
            # A seed that is noise is a cluster of its own for us.
            members = numpy.flatnonzero(labels == labels[seed]) if labels[seed] >= 0 else numpy.array([seed])
            ours = numpy.fromfile(folder / f"{name}.{way}.u32", dtype="<u4")
            both = len(numpy.intersect1d(members, ours))
            same = both / max(1, len(members) + len(ours) - both)
            found[way][name] = {"us": us, "members": len(members), "same": same}
    return found


def pcl(work, folder, about):
    """What the program beside this file prints; None where PCL could not be had."""
    program = work / "euclidean"
    if not program.exists():
        return None
    lines = "".join(f"{c['name']} {c['seed']}\n" for c in about["candidates"])
    arguments = [program, folder, str(about["euclidean"]["tolerance_m"]), str(RUNS)]
    out = subprocess.run(arguments, input=lines, capture_output=True, text=True, check=True).stdout
    found = {"extract": {}, "seed": {}}
    for line in out.splitlines():
        name, way, us, members, same = line.split()
        found[way][name] = {"us": float(us), "members": int(members), "same": float(same)}
    return found


def summary(about, way, theirs):
    """Medians over the candidates, the ratio of sums, and how often the members agree."""
    candidates = [c for c in about["candidates"] if c["name"] in theirs]
    ours_us = [c["ours"][way]["us"] for c in candidates]
    theirs_us = [theirs[c["name"]]["us"] for c in candidates]
    same = [theirs[c["name"]]["same"] for c in candidates]
    return {
        "candidates": len(candidates),
        "ours_us_p50": round(statistics.median(ours_us), 1),
        "theirs_us_p50": round(statistics.median(theirs_us), 1),
        "ratio_of_sums": round(sum(theirs_us) / sum(ours_us), 2),
        "members_same_mean": round(statistics.mean(same), 4),
        "members_equal_share": round(sum(s == 1.0 for s in same) / len(same), 4),
    }


def main():
    work, record = map(pathlib.Path, sys.argv[1:3])
    folder = work / "candidates"
    about = json.loads((folder / "candidates.json").read_text())
    points = [c["points"] for c in about["candidates"]]
    result = {
        "command": "bench/peers/clustering/run.sh",
        "machine": about["machine"],
        "versions": {
            "python": platform.python_version(),
            "numpy": numpy.__version__,
            "scikit_learn": sklearn.__version__,
        },
        "settings": {"euclidean": about["euclidean"], "dbscan": about["dbscan"], "runs": RUNS},
        "points_of_a_candidate": {
            "p50": statistics.median(points),
            "max": max(points),
        },
    }
    theirs = scikit_learn(folder, about)
    result["scikit_learn"] = {way: summary(about, way, found) for way, found in theirs.items()}
    theirs = pcl(work, folder, about)
    if theirs is None:
        result["pcl"] = None
    else:
        result["versions"]["pcl"] = "1.13.0"
        result["pcl"] = {way: summary(about, "euclidean", found) for way, found in theirs.items()}
    record.write_text(json.dumps(result, indent=2) + "\n")
    print(json.dumps(result, indent=2))


if __name__ == "__main__":
    main()
