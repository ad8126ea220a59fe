#!/usr/bin/env python3
"""What scans are made of, without labels: simulated ones versus recorded ones.

    bench/realism/compare_scans.py NAME=FOLDER [NAME=FOLDER ..] [--ahead] [--scans 40]

FOLDER holds scans (x, y, z, intensity as little-endian f32) or `velodyne/`. Points from 3 to 40 m away count; with --ahead those with
x > |y| alone, as a camera's view. Ground is what lies less than 0.25 m above the lowest point within 1.5 m. What stands on it is divided
into clusters: points whose cells of 0.4 m touch. Printed is a table, a column a folder, means over scans:

    ground           share of the points
    standing points  by height above the ground, shares
    clusters         of 10 points and more, a scan
    linear, surface, scattered   share of the standing points in clusters whose eigenvalues a >= b >= c of the covariance say so: the
                     largest of (a - b) / a, (b - c) / a, c / a
    tall and thin    clusters higher than 1.5 m and narrower than 0.8 m, a scan
    person's size, car's size    clusters of 0.3 to 1.2 m and 1.2 to 2.1 m height, of 1.5 to 5.5 m and 0.8 to 2.2 m height, a scan
    free-standing    share of the clusters with no other standing point within 1 m
    shines through   of the returns within a cluster's angles, the share that comes from more than 0.5 m behind it
"""

import argparse
import pathlib
import numpy as np

CELL_M = 0.4


def standing(points):
    """Height above the local ground of each point, m."""
    cell = np.floor(points[:, :2]).astype(int)
    low = cell.min(axis=0)
    lowest = np.full(cell.max(axis=0) - low + 3, np.inf)
    np.minimum.at(lowest, tuple((cell - low + 1).T), points[:, 2])
    around = [np.roll(lowest, shift, (0, 1)) for shift in np.ndindex(3, 3)]
    ground = np.roll(np.minimum.reduce(around), (-1, -1), (0, 1))
    return points[:, 2] - ground[tuple((cell - low + 1).T)]


def clusters(points):
    """Number of the cluster of each point."""
    cells, of_point = np.unique(np.floor(points / CELL_M).astype(int), axis=0, return_inverse=True)
    number = {tuple(cell): -1 for cell in cells}
    count = 0
    for cell in number:
        if number[cell] < 0:
            number[cell], front = count, [cell]
            while front:
                x, y, z = front.pop()
                for dx, dy, dz in np.ndindex(3, 3, 3):
                    other = (x + dx - 1, y + dy - 1, z + dz - 1)
                    if number.get(other) == -1:
                        number[other] = count
                        front.append(other)
            count += 1
    return np.array([number[tuple(cell)] for cell in cells])[of_point.ravel()]


def angles(points):
    return np.stack([np.arctan2(points[:, 1], points[:, 0]), points[:, 2] / np.hypot(points[:, 0], points[:, 1])], axis=1)


def look(points):
    """The figures of one scan."""
    height = standing(points)
    up = points[height > 0.25]
    bands = np.histogram(height[height > 0.25], [0.25, 1, 2, 4, np.inf])[0] / max(len(up), 1)
    of = clusters(up)
    ranges, seen, all_seen = np.hypot(points[:, 0], points[:, 1]), angles(up), angles(points)
    kind, counts, free, through = np.zeros(3), np.zeros(4), [], []
    for index in range(of.max() + 1 if len(of) else 0):
        mine = of == index
        own = up[mine]
        if len(own) < 10:
            continue
        c, b, a = np.linalg.eigvalsh(np.cov(own.T))
        kind[np.argmax([a - b, b - c, c])] += len(own)
        tall = np.ptp(own[:, 2])
        level = np.sqrt(np.maximum(np.linalg.eigvalsh(np.cov(own[:, :2].T)), 0)) * 3.5
        width = level[1]
        counts += [1, tall > 1.5 and width < 0.8, 1.2 < tall < 2.1 and 0.3 < width < 1.2, 0.8 < tall < 2.2 and 1.5 < width < 5.5]
        low, high = own[:, :2].min(axis=0) - 1, own[:, :2].max(axis=0) + 1
        others = up[~mine][:, :2]
        free.append(not ((others > low) & (others < high)).all(axis=1).any())
        low, high = seen[mine].min(axis=0), seen[mine].max(axis=0)
        within = ((all_seen >= low) & (all_seen <= high)).all(axis=1)
        through.append((ranges[within] > np.hypot(own[:, 0], own[:, 1]).max() + 0.5).mean())
    shares = kind / max(kind.sum(), 1)
    return [1 - len(up) / len(points), *bands, counts[0], *shares, *counts[1:], np.mean(free or [0]), np.mean(through or [0])]


ROWS = (
    "ground, %", "standing: 0.25 to 1 m, %", "1 to 2 m, %", "2 to 4 m, %", "above, %", "clusters", "linear, %", "surface, %", "scattered, %",
    "tall and thin", "person's size", "car's size", "free-standing, %", "shines through, %",
)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", nargs="+", metavar="NAME=FOLDER")
    parser.add_argument("--ahead", action="store_true")
    parser.add_argument("--scans", type=int, default=40)
    arguments = parser.parse_args()
    columns = []
    for name, _, folder in (given.partition("=") for given in arguments.folder):
        path = pathlib.Path(folder)
        path = path / "velodyne" if (path / "velodyne").is_dir() else path
        figures = []
        files = sorted(path.glob("*.bin"))
        for file in files[:: max(1, len(files) // arguments.scans)][: arguments.scans]:
            points = np.fromfile(file, "<f4").reshape(-1, 4)[:, :3].astype(float)
            away = np.hypot(points[:, 0], points[:, 1])
            kept = (away > 3) & (away < 40)
            if arguments.ahead:
                kept &= points[:, 0] > np.abs(points[:, 1])
            if kept.sum() > 100:
                figures.append(look(points[kept]))
        if not figures:
            parser.error(f"{path}: no scan *.bin with points 3 to 40 m away")
        columns.append((f"{name} ({len(figures)})", np.mean(figures, axis=0)))
    print("| | " + " | ".join(name for name, _ in columns) + " |")
    print("|---|" + "---|" * len(columns))
    for row, title in enumerate(ROWS):
        scale = 100 if title.endswith("%") else 1
        print(f"| {title} | " + " | ".join(f"{scale * values[row]:.1f}" for _, values in columns) + " |")


if __name__ == "__main__":
    main()
