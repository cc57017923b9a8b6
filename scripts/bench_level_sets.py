#!/usr/bin/python3
# SPDX-License-Identifier: AGPL-3.0-or-later
"""Measures level sets, tightening and dense surfaces, and writes the tables as Markdown.

    scripts/bench_level_sets.py --bench build/release/bin/bench_level_sets \\
        --phantom build/release/bin/cvmesh-phantom --data ../shared/data --out /tmp/level_sets

Shapes with a known surface, every volume of a folder at each r (seconds, peak memory, topology and
volumes of all labels), and the example femur at growing sizes, whose times and memory are fitted
by a power of voxels + interface faces. Where VOLUME_truth.off lies beside VOLUME.nii.gz and
--surfdist is given, the dense surface is compared with it. Times are the medians of --runs runs.
Needs nothing but Python 3; the exit status says whether all labels kept their topology.
"""

import argparse
import json
import math
import subprocess
import sys
from pathlib import Path

SIZES = [0.5, 0.7, 1.0, 1.4]  # of the femur: 125 x 125 x 250 voxels up to 350 x 350 x 700


def parse_arguments():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--bench", required=True, type=Path, help="bench_level_sets")
    parser.add_argument("--phantom", type=Path, help="cvmesh-phantom; no growth without it")
    parser.add_argument("--data", type=Path, help="folder of *.nii.gz volumes")
    parser.add_argument("--volumes", nargs="+", metavar="NAME", help="default: all of the folder")
    parser.add_argument("--surfdist", type=Path, help="compares with VOLUME_truth.off")
    parser.add_argument("--out", required=True, type=Path, help="folder for the tables")
    parser.add_argument("--r", nargs="+", type=float, default=[0.8, 2], metavar="R")
    parser.add_argument("--threads", type=int, default=0, help="0: all")
    parser.add_argument("--runs", type=int, default=1, help="of each volume")
    return parser.parse_args()


def run(command):
    result = subprocess.run([str(c) for c in command], capture_output=True, text=True, check=False)
    if result.returncode != 0:
        sys.exit(f"bench_level_sets.py: {command[0]} ended with {result.returncode}: {result.stderr}")
    return result.stdout


def measure(arguments, path, r, dense=None):
    """The row of one volume; of several runs the one with the median time."""
    command = [arguments.bench, "volume", path, "--r", r, "--threads", arguments.threads]
    if dense:
        command += ["--dense", dense]
    rows = [json.loads(run(command)) for _ in range(arguments.runs)]
    return sorted(rows, key=lambda row: row["seconds"])[len(rows) // 2]


VOLUME_HEAD = (
    "| volume | labels | voxels, 10^6 | faces, 10^3 | r | level sets, s | tightening, s | "
    "extraction, s | all, s | peak MiB | allowed MiB | nodes moved | nodes held | other topology | "
    "worst volume |\n" + "|---" * 15 + "|"
)


def volume_line(name, row):
    return (
        f"| {name} | {row['labels']} | {row['voxels'] / 1e6:.2f} "
        f"| {row['interface_faces'] / 1e3:.0f} | {row['r']:g} | {row['build_s']:.2f} "
        f"| {row['tighten_s']:.2f} | {row['extract_s']:.2f} | {row['seconds']:.2f} "
        f"| {row['peak_mb']:.0f} | {row['bound_mb']:.0f} | {row['nodes_changed']} "
        f"| {row['nodes_guarded']} | {row['labels_with_other_topology']} "
        f"| {100 * row['worst_volume_error']:+.1f} % (label {row['worst_volume_label']}) |"
    )


def measure_folder(arguments, lines):
    """Appends the table of all volumes; returns whether all kept their topology."""
    names = arguments.volumes or sorted(
        p.name[: -len(".nii.gz")] for p in arguments.data.glob("*.nii.gz")
    )
    is_kept = True
    distances = []
    lines += ["## Volumes", "", VOLUME_HEAD]
    for name in names:
        truth = arguments.data / f"{name}_truth.off"
        for r in arguments.r:
            is_compared = arguments.surfdist and truth.exists()
            dense = arguments.out / f"{name}_r{r:g}.off" if is_compared else None
            row = measure(arguments, arguments.data / f"{name}.nii.gz", r, dense)
            is_kept = is_kept and row["is_valid"] and row["labels_with_other_topology"] == 0
            lines.append(volume_line(name, row))
            print(lines[-1], flush=True)
            if dense:
                found = json.loads(run([arguments.surfdist, dense, truth]))
                distances.append(
                    f"{name}, r {r:g}: dense surface to the truth, mean "
                    f"{found['mean_symmetric']:.4f}, max {found['hausdorff']:.2f}"
                )
    lines += [""] + distances + [""]
    return is_kept


def exponent(xs, ys):
    """Slope of the line through (log x, log y), least squares."""
    lx, ly = [math.log(x) for x in xs], [math.log(y) for y in ys]
    mx, my = sum(lx) / len(lx), sum(ly) / len(ly)
    return sum((a - mx) * (b - my) for a, b in zip(lx, ly)) / sum((a - mx) ** 2 for a in lx)


def measure_growth(arguments, lines):
    lines += ["## Growth: the example femur", "", VOLUME_HEAD]
    rows = []
    for size in SIZES:
        path = arguments.out / f"femur_{size:g}.nii.gz"
        run([arguments.phantom, "femur", "--size", size, "--out", path])
        row = measure(arguments, path, 0.8)
        rows.append(row)
        lines.append(volume_line(f"femur {size:g}", row))
        print(lines[-1], flush=True)
        path.unlink()
    work = [row["voxels"] + row["interface_faces"] for row in rows]
    lines += [
        "",
        "Exponents over voxels + interface faces: seconds "
        f"{exponent(work, [row['seconds'] for row in rows]):.2f}, peak memory "
        f"{exponent(work, [row['peak_mb'] for row in rows]):.2f}.",
        "",
    ]


def main():
    arguments = parse_arguments()
    arguments.out.mkdir(parents=True, exist_ok=True)
    lines = ["## Shapes", "", run([arguments.bench, "shapes"])]
    is_kept = measure_folder(arguments, lines) if arguments.data else True
    if arguments.phantom:
        measure_growth(arguments, lines)
    (arguments.out / "level_sets.md").write_text("\n".join(lines))
    print(f"wrote {arguments.out / 'level_sets.md'}")
    return 0 if is_kept else 1


if __name__ == "__main__":
    sys.exit(main())
