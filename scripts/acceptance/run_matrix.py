#!/usr/bin/python3
# SPDX-License-Identifier: AGPL-3.0-or-later
"""Meshes every volume of a folder at every epsilon and has the results judged independently.

    run_matrix.py --cvmesh build/release/cvmesh --evalmesh .../evalmesh --surfdist .../surfdist \\
                  --data ../shared/data --out /tmp/matrix --epsilons 1 3 5 --jobs 1

Writes OUT/matrix.csv, OUT/matrix.md and, per run, OUT/VOLUME_eEPSILON.json (the measured row, the
evaluator's verdict and the end of the log). A run whose row exists is not repeated unless --force
is given, so an interrupted matrix goes on where it stopped. The exit status is 0 when every run is
valid (verdict.valid, materials_manifold and topology_as_lattice14), 1 otherwise.

A surface VOLUME_truth.off beside VOLUME.nii.gz is compared with the mesh by surfdist. Seconds are
wall time of the whole command; peak MB is the largest resident memory of one of its processes.
Needs nothing but Python 3.
"""

import argparse
import concurrent.futures
import csv
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

LOG_TAIL = 4000  # characters of a log that are kept
EVALUATOR_TIMEOUT_S = 3600

# Key in the row, heading in the table, format.
COLUMNS = [
    ("volume", "volume", "{}"),
    ("epsilon", "epsilon", "{:g}"),
    ("status", "status", "{}"),
    ("seconds", "s", "{:.1f}"),
    ("peak_mb", "peak MB", "{:.0f}"),
    ("surface_vertices", "surface vertices", "{}"),
    ("tets", "tets", "{}"),
    ("valid", "valid", "{}"),
    ("materials_manifold", "materials manifold", "{}"),
    ("topology_as_lattice14", "topology as lattice", "{}"),
    ("labels_max_vox", "to labels max, vox", "{:.3f}"),
    ("labels_mean_vox", "to labels mean, vox", "{:.3f}"),
    ("dense_max_vox", "to dense max, vox", "{:.3f}"),
    ("dense_mean_vox", "to dense mean, vox", "{:.3f}"),
    ("truth_max", "to truth max, mm", "{:.3f}"),
    ("truth_mean", "to truth mean, mm", "{:.3f}"),
    ("min_dihedral_deg", "min dihedral, deg", "{:.2f}"),
    ("triangle_mean", "2r/R mean", "{:.3f}"),
    ("triangle_min", "2r/R min", "{:.3f}"),
    ("tet_mean", "3r/R mean", "{:.3f}"),
    ("worst_volume_error", "worst volume error", "{:.3f}"),
]
MUST_HOLD = ("valid", "materials_manifold", "topology_as_lattice14")


def parse_arguments():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--cvmesh", required=True, type=Path, help="the binary under test")
    parser.add_argument("--evalmesh", required=True, type=Path, help="the independent evaluator")
    parser.add_argument("--surfdist", type=Path, help="compares with VOLUME_truth.off")
    parser.add_argument("--data", required=True, type=Path, help="folder of *.nii.gz volumes")
    parser.add_argument("--out", required=True, type=Path, help="folder for results")
    parser.add_argument("--volumes", nargs="+", metavar="NAME", help="default: all of the folder")
    parser.add_argument("--skip", nargs="+", metavar="NAME", default=[], help="volumes to leave out")
    parser.add_argument("--epsilons", nargs="+", type=float, default=[1, 3, 5], metavar="E")
    parser.add_argument("--params", type=Path, help="JSON parameters that epsilon is added to")
    parser.add_argument("--jobs", type=int, default=1, help="runs at the same time")
    parser.add_argument("--threads", type=int, default=0, help="threads of each run; 0: all")
    parser.add_argument("--timeout", type=float, default=3600, help="seconds for one run")
    parser.add_argument("--keep", action="store_true", help="keep the meshes in OUT")
    parser.add_argument("--force", action="store_true", help="repeat runs that have a result")
    return parser.parse_args()


def find_volumes(arguments):
    """The volumes to mesh, name -> path, in alphabetical order."""
    found = {p.name[: -len(".nii.gz")]: p for p in sorted(arguments.data.glob("*.nii.gz"))}
    if not found:
        sys.exit(f"run_matrix: no *.nii.gz in {arguments.data}")
    unknown = [n for n in (arguments.volumes or []) + arguments.skip if n not in found]
    if unknown:
        sys.exit(f"run_matrix: no volume {unknown[0]} in {arguments.data}; it has {', '.join(found)}")
    chosen = arguments.volumes or list(found)
    return {name: found[name] for name in chosen if name not in arguments.skip}


def run_measured(command, log_path, timeout):
    """Runs a command; returns its exit status (None: timed out), seconds and peak MB."""
    with open(log_path, "wb") as log:
        begin = time.monotonic()
        process = subprocess.Popen(
            command, stdout=log, stderr=subprocess.STDOUT, start_new_session=True
        )
        timed_out = False
        while True:
            pid, status, usage = os.wait4(process.pid, os.WNOHANG)
            if pid != 0:
                break
            if not timed_out and time.monotonic() - begin > timeout:
                os.killpg(process.pid, signal.SIGKILL)  # its own group: cvmesh and its helper
                timed_out = True
            time.sleep(0.02)
        seconds = time.monotonic() - begin
        process.returncode = os.waitstatus_to_exitcode(status)
    return None if timed_out else process.returncode, seconds, usage.ru_maxrss / 1024


def json_of(command):
    """What a judge prints, or a dictionary with its error."""
    try:
        result = subprocess.run(
            command, capture_output=True, text=True, timeout=EVALUATOR_TIMEOUT_S, check=False
        )
    except subprocess.TimeoutExpired:
        return {"error": f"{command[0]}: no answer in {EVALUATOR_TIMEOUT_S} s"}
    if result.returncode != 0:
        return {"error": f"{command[0]}: {result.stderr.strip()[-500:]}"}
    return json.loads(result.stdout)


def find(tree, *keys):
    """tree[k0][k1]..., or None where something is missing."""
    for key in keys:
        if not isinstance(tree, dict) or key not in tree:
            return None
        tree = tree[key]
    return tree


def find_deep(tree, key):
    """The first value of `key` anywhere in nested dictionaries."""
    if isinstance(tree, dict):
        if key in tree:
            return tree[key]
        for value in tree.values():
            found = find_deep(value, key)
            if found is not None:
                return found
    return None


def judge(row, evaluation):
    """Copies the evaluator's figures into a row."""
    row["surface_vertices"] = find(evaluation, "counts", "surface_vertices")
    row["tets"] = find(evaluation, "counts", "tets")
    for key in MUST_HOLD:
        row[key] = find(evaluation, "verdict", key)
    row["labels_max_vox"] = find(evaluation, "distance", "voxels", "all", "hausdorff")
    row["labels_mean_vox"] = find(evaluation, "distance", "voxels", "all", "mean_symmetric")
    row["min_dihedral_deg"] = find(evaluation, "quality", "min_dihedral_per_tet", "min")
    triangles = find(evaluation, "quality", "triangle_radius_ratio_interface")
    row["triangle_mean"] = find(triangles, "mean")
    row["triangle_min"] = find(triangles, "min")
    row["tet_mean"] = find(evaluation, "quality", "tet_radius_ratio", "mean")
    errors = [
        abs(v["relative_error"])
        for v in (find(evaluation, "volumes") or {}).values()
        if isinstance(v, dict) and v.get("relative_error") is not None
    ]
    row["worst_volume_error"] = max(errors, default=None)


def read_own_metrics(row, path):
    """Distances to the dense surface, which only cvmesh itself can measure."""
    try:
        metrics = json.loads(path.read_text())
    except (OSError, ValueError):
        return
    dense = find(find_deep(metrics, "distances"), "to_dense", "voxels")
    row["dense_max_vox"] = find(dense, "hausdorff_lower_bound")
    row["dense_mean_vox"] = find(dense, "mean_symmetric")


def run_one(arguments, name, path, epsilon):
    """Meshes one volume at one epsilon and measures the result."""
    result_path = arguments.out / f"{name}_e{epsilon:g}.json"
    if result_path.exists() and not arguments.force:
        return json.loads(result_path.read_text())["row"]
    row = {"volume": name, "epsilon": epsilon}
    evaluation = {}
    parameters = json.loads(arguments.params.read_text()) if arguments.params else {}
    parameters["epsilon"] = epsilon
    with tempfile.TemporaryDirectory(prefix="cvmesh-matrix-") as scratch:
        folder = arguments.out / f"{name}_e{epsilon:g}" if arguments.keep else Path(scratch) / "out"
        folder.mkdir(parents=True, exist_ok=True)
        parameter_path = Path(scratch) / "parameters.json"
        parameter_path.write_text(json.dumps(parameters))
        command = [str(arguments.cvmesh), "mesh", str(path), "--params", str(parameter_path)]
        command += ["--out", str(folder)]
        if arguments.threads > 0:
            command += ["--threads", str(arguments.threads)]
        log_path = Path(scratch) / "log.txt"
        code, row["seconds"], row["peak_mb"] = run_measured(command, log_path, arguments.timeout)
        log = log_path.read_text(errors="replace")[-LOG_TAIL:]
        mesh = folder / f"{name}.mesh"
        if code is None:
            row["status"] = f"over {arguments.timeout:g} s"
        elif code != 0:
            row["status"] = f"exit {code}"
        elif not mesh.exists():
            row["status"] = "no mesh"
        else:
            evaluation = json_of([str(arguments.evalmesh), str(mesh), str(path)])
            row["status"] = "not judged" if "error" in evaluation else "ok"
            judge(row, evaluation)
            read_own_metrics(row, folder / f"{name}.metrics.json")
            truth = arguments.data / f"{name}_truth.off"
            if arguments.surfdist and truth.exists():
                distance = json_of([str(arguments.surfdist), str(mesh), str(truth)])
                row["truth_max"] = find(distance, "hausdorff")
                row["truth_mean"] = find(distance, "mean_symmetric")
    result = {
        "row": row,
        "parameters": parameters,
        "verdict": find(evaluation, "verdict"),
        "error": find(evaluation, "error"),
        "log": log,
    }
    partial = result_path.with_suffix(".partial")
    partial.write_text(json.dumps(result, indent=1))
    partial.replace(result_path)
    return row


def text_of(row, key, form):
    value = row.get(key)
    if value is None:
        return ""
    if isinstance(value, bool):
        return "yes" if value else "NO"
    return form.format(value)


def write_tables(arguments, rows):
    with open(arguments.out / "matrix.csv", "w", newline="") as stream:
        writer = csv.writer(stream)
        writer.writerow([key for key, _, _ in COLUMNS])
        for row in rows:
            writer.writerow(["" if row.get(k) is None else row[k] for k, _, _ in COLUMNS])
    lines = ["| " + " | ".join(heading for _, heading, _ in COLUMNS) + " |"]
    lines.append("|" + "---|" * len(COLUMNS))
    for row in rows:
        lines.append("| " + " | ".join(text_of(row, k, f) for k, _, f in COLUMNS) + " |")
    (arguments.out / "matrix.md").write_text("\n".join(lines) + "\n")
    return lines


def main():
    arguments = parse_arguments()
    for tool in (arguments.cvmesh, arguments.evalmesh, arguments.surfdist):
        if tool and not os.access(tool, os.X_OK):
            sys.exit(f"run_matrix: {tool} is not an executable file")
    volumes = find_volumes(arguments)
    arguments.out.mkdir(parents=True, exist_ok=True)
    runs = [(n, p, e) for n, p in volumes.items() for e in arguments.epsilons]
    rows = [None] * len(runs)
    with concurrent.futures.ThreadPoolExecutor(max(1, arguments.jobs)) as pool:
        futures = {
            pool.submit(run_one, arguments, *run): index for index, run in enumerate(runs)
        }
        for future in concurrent.futures.as_completed(futures):
            rows[futures[future]] = future.result()
            row = future.result()
            done = sum(r is not None for r in rows)
            verdict = "valid" if all(row.get(k) for k in MUST_HOLD) else "NOT VALID"
            print(
                f"[{done}/{len(runs)}] {row['volume']} epsilon {row['epsilon']:g}: "
                f"{row['status']}, {verdict}, {row['seconds']:.1f} s, {row['peak_mb']:.0f} MB",
                flush=True,
            )
            write_tables(arguments, [r for r in rows if r is not None])
    print("\n".join(write_tables(arguments, rows)))
    return 0 if all(row.get(k) for row in rows for k in MUST_HOLD) else 1


if __name__ == "__main__":
    sys.exit(main())
