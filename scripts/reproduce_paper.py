#!/usr/bin/env python3
# SPDX-License-Identifier: AGPL-3.0-or-later
"""Runs the settings of the paper's Tables 7.1, 7.2 and 7.3 and puts the results beside the published
values; and the Delaunay baseline beside the method at a series of epsilons.

    scripts/reproduce_paper.py --cvmesh build/release/bin/cvmesh --out /tmp/paper

Every column of the tables is run twice, by the published epsilon and by the published number of
surface vertices, on bunny.nii.gz, tooth.nii.gz and femur_phantom.nii.gz of a folder or on files
that --bunny, --tooth and --femur name. r is 0.8; the paper gives no delta, so the default rules.
The distance to the surface that the bunny was voxelised from is told where --truth (default:
bunny_truth.off of the folder) and --surfdist, a program that prints the two-sided distance of two
surfaces as JSON, are there.

Writes OUT/tables.md, OUT/tables.csv, OUT/delaunay.md, OUT/delaunay.csv and, in OUT/runs, every
mesh and report. A run whose report exists is not repeated. Exits with 1 when a run of the method
itself fails; what becomes of the baseline is a result. Needs nothing but Python 3.
"""

import argparse
import csv
import json
import pathlib
import subprocess
import sys

# As printed in the paper. "Materials" of Table 7.2 count the background.
PUBLISHED = {
    "bunny, epsilon 0.5 (Delaunay)": dict(
        vertices=25109, triangles=50258, tets=202219, max=0.896, mean=0.104, tri=0.79, tri_sd=0.21,
        tet=0.64, tet_sd=0.19),
    "bunny, epsilon 1": dict(
        vertices=15361, triangles=30718, tets=177552, max=0.874, mean=0.0938, tri=0.70, tri_sd=0.26,
        tet=0.66, tet_sd=0.22, seconds=18 * 60),
    "bunny, epsilon 5": dict(
        vertices=558, triangles=1170, tets=43596, max=3.75, mean=0.496, tri=0.78, tri_sd=0.22,
        tet=0.73, tet_sd=0.18),
    "tooth, epsilon 3": dict(
        vertices=3981, triangles=10124, tets=65442, max=1.83, mean=0.117, tri=0.83, tet=0.72,
        seconds=43 * 60),
    "femur, epsilon 4": dict(
        vertices=21393, triangles=45694, tets=182493, max=3.81, mean=0.085, tri=0.71, tet=0.65,
        seconds=640 * 60),
}
R = 0.8

# The rows of Table 7.3 and the stages that do that work.
STAGES = [
    ("smoothing (tightening)", ["level sets", "tightening"]),
    ("medial axis", ["medial axis"]),
    ("sizing field", ["sizing field"]),
    ("particle optimisation", ["seed particles", "particle optimisation"]),
    ("vertex insertion", ["insertion"]),
    ("vertex decimation", ["decimation"]),
    ("edge flipping", ["edge flipping"]),
]
PUBLISHED_STAGES = {  # seconds
    "bunny, epsilon 1": [41, 18, 105, 840, 4.8, 87.7, 2.2],
    "tooth, epsilon 3": [77, 13, 35, 2220, 31, 184, 9.7],
    "femur, epsilon 4": [7 * 60, 72 * 60, 21 * 60, 483 * 60, 16 * 60, 38 * 60, 3 * 60],
}

# Key of a row, heading, format.
ROWS = [
    ("vertices", "surface vertices", "{:,.0f}"),
    ("triangles", "surface triangles", "{:,.0f}"),
    ("tets", "tetrahedra", "{:,.0f}"),
    ("max", "largest distance to the dense surface, voxels", "{:.3g}"),
    ("mean", "mean distance to the dense surface, voxels", "{:.3g}"),
    ("labels_max", "largest distance to the voxel faces, voxels", "{:.3g}"),
    ("labels_mean", "mean distance to the voxel faces, voxels", "{:.3g}"),
    ("truth_max", "largest distance to the true surface", "{:.3g}"),
    ("truth_mean", "mean distance to the true surface", "{:.3g}"),
    ("tri", "triangle quality 2r/R, mean", "{:.2f}"),
    ("tri_sd", "triangle quality, standard deviation", "{:.2f}"),
    ("tet", "tetrahedron quality 3r/R, mean", "{:.2f}"),
    ("tet_sd", "tetrahedron quality, standard deviation", "{:.2f}"),
    ("seconds", "seconds", "{:,.0f}"),
]


def parse_arguments():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cvmesh", required=True, type=pathlib.Path)
    parser.add_argument("--out", required=True, type=pathlib.Path)
    parser.add_argument("--data", type=pathlib.Path,
                        default=pathlib.Path(__file__).resolve().parents[1] / ".." / "shared" / "data")
    for volume in ("bunny", "tooth", "femur"):
        parser.add_argument(f"--{volume}", type=pathlib.Path, help="instead of the folder's")
    parser.add_argument("--truth", type=pathlib.Path, help="true surface of the bunny (.off)")
    parser.add_argument("--surfdist", type=pathlib.Path, help="distance of two surfaces, as JSON")
    parser.add_argument("--only", nargs="+", metavar="VOLUME", default=["bunny", "tooth", "femur"],
                        choices=["bunny", "tooth", "femur"])
    parser.add_argument("--epsilons", nargs="*", type=float, default=[0.5, 1, 2, 3, 4, 5],
                        help="of the comparison with the Delaunay baseline")
    parser.add_argument("--baseline-volumes", nargs="*", default=["bunny", "tooth"])
    return parser.parse_args()


def volumes_of(arguments):
    """Paths of the volumes that were asked for; those that are not there are told and left out."""
    names = {"bunny": "bunny.nii.gz", "tooth": "tooth.nii.gz", "femur": "femur_phantom.nii.gz"}
    paths = {}
    for volume in arguments.only:
        path = getattr(arguments, volume) or arguments.data / names[volume]
        if path.exists():
            paths[volume] = path.resolve()
        else:
            print(f"reproduce_paper.py: '{path}' does not exist; {volume} is left out",
                  file=sys.stderr)
    return paths


def stem(path):
    name = path.name
    for suffix in (".nii.gz", ".nii", ".mha", ".mhd", ".nrrd"):
        if name.endswith(suffix):
            return name[: -len(suffix)]
    return path.stem


class Runner:
    """Meshes, and remembers what failed; a report that is there already is read."""

    def __init__(self, cvmesh, folder, options=("--formats", "vtu,mesh")):
        self.cvmesh, self.folder, self.options, self.failed = cvmesh.resolve(), folder, options, []

    def report(self, volume, settings):
        name = " ".join([volume.name] + settings)
        out = self.folder / "_".join([stem(volume)] + settings).replace("=", "").replace('"', "")
        path = out / f"{stem(volume)}.metrics.json"
        if not path.exists():
            command = [str(self.cvmesh), "mesh", str(volume), "--out", str(out), "--quiet", "--force",
                       *self.options, "--set", f"r={R}"]
            for setting in settings:
                command += ["--set", setting]
            print(f"{name} ...", file=sys.stderr, flush=True)
            run = subprocess.run(command, stderr=subprocess.PIPE, text=True, check=False)
            if run.returncode != 0:
                print(run.stderr.strip(), file=sys.stderr)
                self.failed.append(name)
                return None, out
        return json.loads(path.read_text(encoding="utf-8")), out


def distance(report, reference):
    """Largest and symmetric mean distance in voxels, all interfaces together."""
    voxels = report["results"]["distances"][reference]["voxels"]
    return voxels["hausdorff_lower_bound"], voxels["mean_symmetric"]


def row_of(report):
    """The figures of one run, by the keys of ROWS."""
    if report is None:
        return {}
    results = report["results"]
    row = {"vertices": results["mesh"]["surface_vertices"],
           "triangles": results["mesh"]["surface_triangles"],
           "tets": results["mesh"]["tets"],
           "tri": results["quality"]["triangles"]["radius_ratio"]["mean"],
           "tri_sd": results["quality"]["triangles"]["radius_ratio"]["standard_deviation"],
           "tet": results["quality"]["tets"]["radius_ratio"]["mean"],
           "tet_sd": results["quality"]["tets"]["radius_ratio"]["standard_deviation"],
           "seconds": report["timings"]["total_seconds"]}
    row["max"], row["mean"] = distance(report, "to_dense")
    row["labels_max"], row["labels_mean"] = distance(report, "to_labels")
    return row


def truth_distance(surfdist, mesh, truth):
    """Largest and mean distance between a mesh's interfaces and the true surface, by surfdist."""
    if not (surfdist and mesh.exists() and truth and truth.exists()):
        return {}
    run = subprocess.run([str(surfdist), str(mesh), str(truth)], capture_output=True, text=True,
                         check=True)
    result = json.loads(run.stdout)
    return {"truth_max": result["hausdorff"], "truth_mean": result["mean_symmetric"]}


def stage_seconds(report):
    seconds = {s["stage"]: s["seconds"] for s in report["timings"]["stages"]}
    return [sum(seconds.get(stage, 0) for stage in stages) for _, stages in STAGES]


def cell(form, value):
    return "" if value is None else form.format(value)


def markdown(header, rows):
    lines = ["| " + " | ".join(header) + " |", "|" + "---|" * len(header)]
    lines += ["| " + " | ".join(row) + " |" for row in rows]
    return "\n".join(lines) + "\n"


def tables(arguments, volumes, runner):
    """One table of figures and one of times; (Markdown, rows of the CSV)."""
    text, records = "", []
    truth = arguments.truth or arguments.data / "bunny_truth.off"
    times = {}
    for column, published in PUBLISHED.items():
        volume, rest = column.split(", ")
        if volume not in volumes:
            continue
        epsilon = rest.split()[1]
        surface = ["surface=delaunay"] if "Delaunay" in column else []
        ours = []
        for scale in (f"epsilon={epsilon}", f"target_vertices={published['vertices']}"):
            report, out = runner.report(volumes[volume], [scale] + surface)
            row = row_of(report)
            if volume == "bunny":
                row |= truth_distance(arguments.surfdist, out / f"{stem(volumes[volume])}.mesh", truth)
            ours.append(row)
            if report and column in PUBLISHED_STAGES:
                times.setdefault(column, []).append(stage_seconds(report))
        header = [column, "published", f"cvmesh, epsilon {epsilon}",
                  f"cvmesh, {published['vertices']:,} vertices"]
        rows = []
        for key, heading, form in ROWS:
            values = [published.get(key)] + [row.get(key) for row in ours]
            if any(value is not None for value in values):
                rows.append([heading] + [cell(form, value) for value in values])
        text += markdown(header, rows) + "\n"
        for source, row in zip(header[1:], [published] + ours):
            records.append({"table": column, "source": source} | row)
    if times:
        header = ["seconds"]
        for column in times:
            header += [f"{column}, published", "cvmesh, epsilon", "cvmesh, vertices"]
        rows = []
        for n, (heading, _) in enumerate(STAGES):
            row = [heading]
            for column, runs in times.items():
                row.append(cell("{:,.1f}", PUBLISHED_STAGES[column][n]))
                row += [cell("{:,.1f}", run[n]) for run in runs] + [""] * (2 - len(runs))
            rows.append(row)
        text += markdown(header, rows)
    return text, records


def topology_row(report):
    """What a report says about the surfaces, over all labels."""
    labels = [l for l in report["results"]["labels"] if "topology" in l]
    meshes = [l["topology"]["mesh"] for l in labels]
    faulty = [l for l in labels
              if not l["topology"]["mesh"]["is_closed_manifold"]
              or l["topology"]["mesh"]["components"] != l["topology"]["voxels"]["components"]
              or l["topology"]["mesh"]["boundary_euler"] != 2 * l["topology"]["voxels"]["euler"]]
    largest, mean = distance(report, "to_dense")
    return {"vertices": report["results"]["mesh"]["surface_vertices"],
            "triangles": report["results"]["mesh"]["surface_triangles"],
            "faulty_labels": len(faulty),
            "labels": len(labels),
            "nonmanifold_edges": sum(m["nonmanifold_edges"] for m in meshes),
            "nonmanifold_vertices": sum(m["nonmanifold_vertices"] for m in meshes),
            "components": "; ".join(f"{m['components']}" for m in meshes),
            "boundary_euler": "; ".join(f"{m['boundary_euler']}" for m in meshes),
            "max": largest,
            "mean": mean}


def baseline(arguments, volumes, runner):
    """The method and the Delaunay baseline at each epsilon; (Markdown, rows of the CSV)."""
    records = []
    for volume in arguments.baseline_volumes:
        for epsilon in arguments.epsilons if volume in volumes else []:
            for surface in ("decimation", "delaunay"):
                settings = [f"epsilon={epsilon:g}"]
                if surface == "delaunay":
                    settings.append("surface=delaunay")
                report, _ = runner.report(volumes[volume], settings)
                if report:
                    records.append({"volume": volume, "epsilon": epsilon, "surface": surface}
                                   | topology_row(report))
    header = ["volume", "epsilon", "surface", "vertices", "triangles", "labels with a fault",
              "non-manifold edges", "non-manifold vertices", "components per label",
              "Euler number of the boundary per label", "distance mean / max, voxels"]
    rows = [[r["volume"], f"{r['epsilon']:g}", r["surface"], f"{r['vertices']:,}",
             f"{r['triangles']:,}", f"{r['faulty_labels']} of {r['labels']}",
             str(r["nonmanifold_edges"]), str(r["nonmanifold_vertices"]), r["components"],
             r["boundary_euler"], f"{r['mean']:.3f} / {r['max']:.2f}"] for r in records]
    return markdown(header, rows), records


def write(folder, name, text, records):
    (folder / f"{name}.md").write_text(text, encoding="utf-8")
    keys = list(dict.fromkeys(key for record in records for key in record))
    with open(folder / f"{name}.csv", "w", newline="", encoding="utf-8") as stream:
        writer = csv.DictWriter(stream, fieldnames=keys)
        writer.writeheader()
        writer.writerows(records)


def main():
    arguments = parse_arguments()
    volumes = volumes_of(arguments)
    arguments.out.mkdir(parents=True, exist_ok=True)
    runner = Runner(arguments.cvmesh, arguments.out / "runs")
    for name, make in (("tables", tables), ("delaunay", baseline)):
        text, records = make(arguments, volumes, runner)
        write(arguments.out, name, text, records)
        print(text)
    for name in runner.failed:
        print(f"failed: {name}", file=sys.stderr)
    return 1 if any("surface=delaunay" not in name for name in runner.failed) else 0


if __name__ == "__main__":
    sys.exit(main())
