#!/usr/bin/python3
# SPDX-License-Identifier: AGPL-3.0-or-later
"""Times cvmesh, stage by stage, against CGAL's Mesh_3 in the same run, and writes the tables.

    scripts/bench.py --build build/release --data ../shared/data --out /tmp/bench

Each volume is meshed at three numbers of surface vertices (`target_vertices`), --runs times; the
rows are medians. Unless --no-peer is given, bench_cgal_mesh3 then meshes the same volume with as
many surface triangles (perturb and exude), sequentially and in parallel, in turn with cvmesh, so
that both see the same machine. With --evalmesh both meshes are judged: largest distance to the raw
labels, labels that got lost, boundaries that are no manifold.

--growth times the example femur at four sizes instead, and fits time and memory of every stage by a
power of voxels + interface facets. --compare OTHER_BUILD times two builds of cvmesh in turn.

Writes OUT/bench.json (all runs), OUT/bench.md and, where python3-matplotlib is installed,
OUT/bench.png. Needs nothing else but Python 3. The exit status is 1 when a run fails.
"""

import argparse
import json
import math
import os
import statistics
import subprocess
import sys
import time
from pathlib import Path

# Volume, wanted surface vertices, smallest first.
VOLUMES = {
    "bunny": (558, 4000, 15361),
    "tooth": (1000, 3981, 10000),
    "cgal_liver": (5000, 15000, 50000),
    "femur_phantom": (10000, 21393, 60000),
    "head_synthseg03": (30000, 60000, 125000),
    "pelvis_ref004": (30000, 60000, 120000),
}
GROWTH_SIZES = (0.5, 0.7, 1.0, 1.4)  # of the femur: 125 x 125 x 250 voxels up to 350 x 350 x 700


def parse_arguments():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--build", required=True, type=Path, help="build folder of cvmesh")
    parser.add_argument("--data", type=Path, help="folder of *.nii.gz volumes")
    parser.add_argument("--out", required=True, type=Path, help="folder for results")
    parser.add_argument("--volumes", nargs="+", metavar="NAME", choices=VOLUMES, default=list(VOLUMES))
    parser.add_argument("--sizes", nargs="+", type=int, metavar="N", help="vertices, instead of three")
    parser.add_argument("--runs", type=int, default=3, help="of each; medians are reported")
    parser.add_argument("--threads", type=int, default=0, help="0: all")
    parser.add_argument("--no-peer", action="store_true", help="cvmesh alone")
    parser.add_argument("--evalmesh", type=Path, help="the independent evaluator")
    parser.add_argument("--growth", action="store_true", help="the example femur at four sizes")
    parser.add_argument("--compare", type=Path, metavar="BUILD", help="a second build of cvmesh")
    arguments = parser.parse_args()
    if not arguments.growth and arguments.data is None:
        parser.error("--data is needed, except with --growth")
    return arguments


class Failed(Exception):
    """A program that did not end as it should."""


def run(command):
    """Output and seconds of a program."""
    begin = time.monotonic()
    result = subprocess.run([str(c) for c in command], capture_output=True, text=True, check=False)
    if result.returncode != 0:
        raise Failed(f"{command[0]} ended with {result.returncode}: {result.stderr.strip()[-400:]}")
    return result.stdout, time.monotonic() - begin


def run_cvmesh(build, volume, settings, threads, out):
    """One run: its stages, counts, wall time; the mesh stays in `out`."""
    command = [build / "bin" / "cvmesh", "mesh", volume, "--out", out, "--quiet", "--force"]
    if threads:
        command += ["--threads", threads]
    for key, value in settings.items():
        command += ["--set", f"{key}={value}"]
    stem = volume.name.removesuffix(".gz").removesuffix(".nii")
    _, seconds = run(command)
    with open(out / f"{stem}.metrics.json", encoding="utf-8") as file:
        report = json.load(file)
    stages = report["timings"]["stages"]
    mesh = report["results"]["mesh"]
    return {
        "seconds": seconds,
        "peak_mb": max(stage["peak_mb"] for stage in stages),
        "stages": {stage["stage"]: stage["seconds"] for stage in stages},
        "stage_peaks_mb": {stage["stage"]: stage["peak_mb"] for stage in stages},
        "vertices": mesh["surface_vertices"],
        "facets": mesh["surface_triangles"],
        "tets": mesh["tets"],
        "mesh": str(out / f"{stem}.mesh"),
    }


def run_peer(build, volume, facets, size, is_parallel, threads, out):
    """CGAL's Mesh_3 with as many facets; `size` spares the search for the facet size."""
    mesh = out / f"cgal_{'parallel' if is_parallel else 'sequential'}.mesh"
    command = [build / "bin" / "bench_cgal_mesh3", volume, mesh, "--facets", facets]
    if size:
        command += ["--facet-size", size]
    if threads:
        command += ["--threads", threads]
    if is_parallel:
        command.append("--parallel")
    row = json.loads(run(command)[0])
    row["mesh"] = str(mesh)
    return row


def judge(evalmesh, mesh, volume, is_peer):
    """What the evaluator says of a mesh, in the numbers of the table."""
    command = [evalmesh, mesh, volume] + (["--coords", "scaled"] if is_peer else [])
    result = subprocess.run([str(c) for c in command], capture_output=True, text=True, check=False)
    verdict = json.loads(result.stdout)
    boundaries = [material["boundary"] for material in verdict["materials"].values()]
    return {
        "max_vox": verdict["distance"]["voxels"]["all"]["hausdorff"],
        "mean_vox": verdict["distance"]["voxels"]["all"]["mean_symmetric"],
        "labels": len(boundaries),
        "lost": verdict["labels_missing_from_mesh"],
        "not_manifold": sum(not (b["edge_manifold"] and b["vertex_manifold"]) for b in boundaries),
        "other_topology": verdict["verdict"]["materials_with_other_topology14"],
        "valid": verdict["verdict"]["valid"],
    }


def median_of(rows, key):
    return statistics.median(row[key] for row in rows)


def summarise(rows):
    """Medians of several runs; counts are equal in all of them."""
    result = dict(rows[-1])
    for key in ("seconds", "peak_mb"):
        result[key] = median_of(rows, key)
    for part in ("stages", "stage_peaks_mb"):
        if part in result:
            result[part] = {
                name: statistics.median(row[part][name] for row in rows) for name in result[part]
            }
    result["all_seconds"] = [round(row["seconds"], 3) for row in rows]
    return result


def bench_volume(arguments, name, wanted):
    """cvmesh, a second build, and both peers, in turn."""
    volume = arguments.data / f"{name}.nii.gz"
    builds = {"cvmesh": arguments.build}
    if arguments.compare:
        builds["other"] = arguments.compare
    runs = {}
    sizes = {}
    for _ in range(arguments.runs):
        for key, build in builds.items():
            out = arguments.out / key
            out.mkdir(parents=True, exist_ok=True)
            settings = {"target_vertices": wanted}
            runs.setdefault(key, []).append(
                run_cvmesh(build, volume, settings, arguments.threads, out)
            )
        if arguments.no_peer:
            continue
        for is_parallel in (False, True):
            key = "cgal_parallel" if is_parallel else "cgal_sequential"
            row = run_peer(arguments.build, volume, runs["cvmesh"][0]["facets"], sizes.get(key),
                           is_parallel, arguments.threads, arguments.out)
            sizes[key] = row["facet_size_mm"]
            runs.setdefault(key, []).append(row)
    result = {key: summarise(rows) for key, rows in runs.items()}
    if arguments.evalmesh:
        for key, row in result.items():
            row["judged"] = judge(arguments.evalmesh, row["mesh"], volume, key.startswith("cgal"))
    return {"volume": name, "wanted": wanted, **result}


def bench_growth(arguments):
    """The example femur at growing sizes, at one epsilon."""
    rows = []
    for size in GROWTH_SIZES:
        volume = arguments.out / f"femur_{size:g}.nii.gz"
        if not volume.exists():
            run([arguments.build / "bin" / "cvmesh-phantom", "femur", "--out", volume, "--size", size])
        out = arguments.out / "growth"
        out.mkdir(parents=True, exist_ok=True)
        runs = [
            run_cvmesh(arguments.build, volume, {"epsilon": 4}, arguments.threads, out)
            for _ in range(arguments.runs)
        ]
        row = summarise(runs)
        with open(out / f"femur_{size:g}.metrics.json", encoding="utf-8") as file:
            report = json.load(file)
        row["size"] = math.prod(report["input"]["dims"]) + (
            report["results"]["stages"]["dense_surfaces"]["facets"]
        )
        rows.append(row)
    return rows


def exponent(xs, ys):
    """Slope of the line through (log x, log y)."""
    u, v = [math.log(x) for x in xs], [math.log(max(y, 1e-3)) for y in ys]
    mu, mv = statistics.fmean(u), statistics.fmean(v)
    return sum((a - mu) * (b - mv) for a, b in zip(u, v)) / sum((a - mu) ** 2 for a in u)


def table(head, rows):
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    return "\n".join(lines + ["| " + " | ".join(map(str, row)) + " |" for row in rows]) + "\n"


def volume_tables(results):
    stages = list(results[0]["cvmesh"]["stages"])
    rows = []
    for result in results:
        row = result["cvmesh"]
        rows.append(
            [result["volume"], row["vertices"], row["tets"], f"{row['seconds']:.1f}",
             f"{row['peak_mb']:.0f}"] + [f"{row['stages'].get(s, 0):.2f}" for s in stages]
        )
    text = table(["volume", "vertices", "tets", "seconds", "peak MiB"] + stages, rows)
    others = [k for k in ("other", "cgal_sequential", "cgal_parallel") if k in results[0]]
    for key in others:
        rows = []
        for result in results:
            mine, its = result["cvmesh"], result[key]
            row = [result["volume"], mine["facets"], its["facets"], f"{mine['seconds']:.1f}",
                   f"{its['seconds']:.1f}", f"{mine['seconds'] / its['seconds']:.2f}"]
            for side in (mine, its):
                judged = side.get("judged")
                row += [f"{judged['max_vox']:.2f}", judged["lost"], judged["not_manifold"],
                        judged["other_topology"]] if judged else [""] * 4
            rows.append(row)
        judgement = ["to labels, max, voxels", "labels lost", "not manifold", "other topology"]
        head = ["volume", "triangles", "its triangles", "seconds", "its seconds", "ratio"]
        head += judgement + [f"its {word}" for word in judgement]
        text += f"\nAgainst {key.replace('_', ', ')}:\n\n" + table(head, rows)
    return text


def growth_table(rows):
    stages = list(rows[0]["stages"])
    sizes = [row["size"] for row in rows]
    lines = [
        [f"{row['size'] / 1e6:.1f}", row["tets"], f"{row['seconds']:.1f}", f"{row['peak_mb']:.0f}"]
        + [f"{row['stages'][s]:.2f}" for s in stages]
        for row in rows
    ]
    lines.append(
        ["exponent", "", f"{exponent(sizes, [r['seconds'] for r in rows]):.2f}",
         f"{exponent(sizes, [r['peak_mb'] for r in rows]):.2f}"]
        + [f"{exponent(sizes, [r['stages'][s] for r in rows]):.2f}" for s in stages]
    )
    return table(["voxels + facets, 10^6", "tets", "seconds", "peak MiB"] + stages, lines)


def draw(results, path):
    """Seconds against surface triangles; nothing where there is no matplotlib."""
    try:
        import matplotlib  # pylint: disable=import-outside-toplevel

        matplotlib.use("Agg")
        from matplotlib import pyplot  # pylint: disable=import-outside-toplevel
    except ImportError:
        return
    names = list(dict.fromkeys(result["volume"] for result in results))
    figure, axes = pyplot.subplots(1, len(names), figsize=(3.2 * len(names), 3), squeeze=False)
    for axis, name in zip(axes[0], names):
        of_volume = [result for result in results if result["volume"] == name]
        for key, label in (("cvmesh", "cvmesh"), ("cgal_sequential", "CGAL"),
                           ("cgal_parallel", "CGAL, parallel")):
            points = [(r[key]["facets"], r[key]["seconds"]) for r in of_volume if key in r]
            if points:
                axis.loglog(*zip(*points), "o-", label=label)
        axis.set_title(name)
        axis.set_xlabel("surface triangles")
    axes[0][0].set_ylabel("seconds")
    axes[0][0].legend()
    figure.tight_layout()
    figure.savefig(path, dpi=110)


def main():
    arguments = parse_arguments()
    arguments.out.mkdir(parents=True, exist_ok=True)
    try:
        if arguments.growth:
            rows = bench_growth(arguments)
            text = growth_table(rows)
        else:
            rows = []
            for name in arguments.volumes:
                for wanted in arguments.sizes or VOLUMES[name]:
                    rows.append(bench_volume(arguments, name, wanted))
                    print(f"{name} {wanted}: {rows[-1]['cvmesh']['all_seconds']} s", flush=True)
            text = volume_tables(rows)
            draw(rows, arguments.out / "bench.png")
    except Failed as error:
        sys.exit(f"bench.py: {error}")
    with open(arguments.out / "bench.json", "w", encoding="utf-8") as file:
        json.dump({"cores": os.cpu_count(), "rows": rows}, file, indent=1)
    (arguments.out / "bench.md").write_text(text, encoding="utf-8")
    print(text)


if __name__ == "__main__":
    main()
