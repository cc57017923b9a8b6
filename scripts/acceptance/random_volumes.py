#!/usr/bin/python3
# SPDX-License-Identifier: AGPL-3.0-or-later
"""Meshes random label volumes, one per seed, and has each mesh judged independently.

    random_volumes.py --cvmesh build/release/bin/cvmesh --evalmesh .../evalmesh \\
                      --generator build/release/bin/cvmesh-random-volume --out /tmp/random \\
                      --seeds 1 2000 --jobs 1

Each run must end in one of two ways: a mesh that the evaluator calls valid, with the topology of
its voxels and every label of the volume in it, or a refusal (exit code 3, 4 or 7 with a message
and a .failed.json). Everything else is a fault: another exit code, a crash, a mesh that is not
valid, a lost label, files beside a refusal. OUT/runs.jsonl gets one line per run, so that an
interrupted series goes on where it stopped; OUT/summary.md is written at the end. Volumes of
faults and refusals stay in OUT. The exit status is 0 when there is no fault and the refusals are at
most 2 %. Needs nothing but Python 3.
"""

import argparse
import collections
import concurrent.futures
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

REFUSALS = {3: "bad input", 4: "stage failed", 7: "limit"}
MOST_REFUSALS = 0.02
EPSILONS = ("1", "1", "2", "0.6", "4")
MUST_HOLD = ("valid", "materials_manifold", "topology_as_lattice14")
EVALUATOR_TIMEOUT_S = 600


def parse_arguments():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--cvmesh", required=True, type=Path, help="the binary under test")
    parser.add_argument("--generator", required=True, type=Path, help="cvmesh-random-volume")
    parser.add_argument("--evalmesh", required=True, type=Path, help="the independent evaluator")
    parser.add_argument("--out", required=True, type=Path, help="folder for results")
    parser.add_argument("--seeds", nargs=2, type=int, default=(1, 200), metavar=("FIRST", "LAST"))
    parser.add_argument("--jobs", type=int, default=1, help="runs at the same time")
    parser.add_argument("--threads", type=int, default=1, help="threads of each run")
    parser.add_argument("--timeout", type=float, default=900, help="seconds for one run")
    parser.add_argument("--until", type=float, default=0, help="start no run after so many seconds")
    return parser.parse_args()


def run(command, timeout):
    """Exit code (negative: killed by that signal; None: timed out) and standard error."""
    process = subprocess.Popen(
        command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True,
        start_new_session=True,
    )
    try:
        _, errors = process.communicate(timeout=timeout)
        return process.returncode, errors
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        process.communicate()
        return None, ""


def evaluate(evalmesh, mesh, volume):
    """The evaluator's JSON, or a dictionary that says why there is none."""
    try:
        result = subprocess.run(
            [evalmesh, mesh, volume], capture_output=True, text=True, check=False,
            timeout=EVALUATOR_TIMEOUT_S,
        )
    except subprocess.TimeoutExpired:
        return {"error": f"no answer in {EVALUATOR_TIMEOUT_S} s"}
    if result.returncode != 0:
        return {"error": result.stderr.strip()[-300:]}
    return json.loads(result.stdout)


def lost_labels(metrics):
    """Labels that the report says came in and of which no tet came out."""
    labels = metrics["results"]["labels"]
    return [row["label"] for row in labels if row["label"] != 0 and not row.get("tets")]


def judge_mesh(row, arguments, out, volume):
    mesh, metrics = out / f"{volume.stem}.mesh", out / f"{volume.stem}.metrics.json"
    if not mesh.exists() or not metrics.exists():
        row.update(ending="fault", reason="exit code 0 without its files")
        return
    evaluation = evaluate(arguments.evalmesh, mesh, volume)
    verdict = evaluation.get("verdict", {})
    failed = [key for key in MUST_HOLD if verdict.get(key) is not True]
    lost = lost_labels(json.loads(metrics.read_text()))
    if "error" in evaluation:
        row.update(ending="fault", reason="not judged: " + evaluation["error"])
    elif failed:
        row.update(ending="fault", reason="evaluator: not " + ", ".join(failed))
    elif lost:
        row.update(ending="fault", reason=f"labels without tets: {lost}")
    else:
        row.update(ending="valid", reason="", tets=evaluation["counts"]["tets"])


def judge_refusal(row, out, name, errors):
    left = sorted(p.name for p in out.iterdir()) if out.exists() else []
    message = [line for line in errors.splitlines() if line.startswith("cvmesh: error: ")]
    row["message"] = message[-1][len("cvmesh: error: "):] if message else errors[-300:]
    # Messages of one kind differ in their numbers and names only.
    row["reason"] = re.sub(r"'[^']*'|-?\d[\d.e+-]*", "#", row["message"])
    expected = [] if row["exit"] == 3 and not left else [f"{name}.failed.json"]
    if row["exit"] in REFUSALS and message and left == expected:
        row["ending"] = "refused"
    else:
        row["ending"] = "fault"
        row["reason"] += f" (exit code {row['exit']}, files {left})"


def run_seed(arguments, seed):
    """Makes, meshes and judges one volume."""
    row = {"seed": seed, "epsilon": EPSILONS[seed // 10 % len(EPSILONS)]}
    with tempfile.TemporaryDirectory(prefix="cvmesh-random-") as scratch:
        volume, out = Path(scratch) / f"seed{seed}.nii", Path(scratch) / "out"
        made = subprocess.run(
            [arguments.generator, str(seed), volume], capture_output=True, text=True, check=True
        )
        row["volume"] = made.stdout.strip()
        begin = time.monotonic()
        row["exit"], errors = run(
            [arguments.cvmesh, "mesh", volume, "--out", out, "--quiet", "--set",
             f"epsilon={row['epsilon']}", "--threads", str(arguments.threads)],
            arguments.timeout,
        )
        row["seconds"] = round(time.monotonic() - begin, 2)
        if row["exit"] is None:
            row.update(ending="fault", reason=f"over {arguments.timeout:g} s")
        elif row["exit"] == 0:
            judge_mesh(row, arguments, out, volume)
        else:
            judge_refusal(row, out, volume.stem, errors)
        if row["ending"] != "valid":
            shutil.copy(volume, arguments.out)
    return row


def summary(rows):
    endings = collections.Counter(row["ending"] for row in rows)
    seconds = sorted(row["seconds"] for row in rows)
    lines = [
        f"{len(rows)} volumes: {endings['valid']} valid, {endings['refused']} refused, "
        f"{endings['fault']} faults; seconds: median {seconds[len(seconds) // 2]}, "
        f"largest {seconds[-1]}",
        "",
        "| ending | runs | reason | seeds |",
        "|---|---|---|---|",
    ]
    reasons = collections.defaultdict(list)
    for row in rows:
        if row["ending"] != "valid":
            reasons[row["ending"], row["reason"]].append(row["seed"])
    for (ending, reason), seeds in sorted(reasons.items(), key=lambda item: -len(item[1])):
        some = ", ".join(map(str, seeds[:8])) + (", ..." if len(seeds) > 8 else "")
        lines.append(f"| {ending} | {len(seeds)} | {reason} | {some} |")
    is_good = endings["fault"] == 0 and endings["refused"] <= MOST_REFUSALS * len(rows)
    return "\n".join(lines) + "\n", is_good


def main():
    arguments = parse_arguments()
    for tool in (arguments.cvmesh, arguments.generator, arguments.evalmesh):
        if not os.access(tool, os.X_OK):
            sys.exit(f"random_volumes: {tool} is not an executable file")
    arguments.out.mkdir(parents=True, exist_ok=True)
    log = arguments.out / "runs.jsonl"
    rows = [json.loads(line) for line in log.read_text().splitlines()] if log.exists() else []
    known = {row["seed"] for row in rows}
    seeds = [s for s in range(arguments.seeds[0], arguments.seeds[1] + 1) if s not in known]
    begin = time.monotonic()

    def run_in_time(seed):
        if arguments.until and time.monotonic() - begin > arguments.until:
            return None
        return run_seed(arguments, seed)

    with concurrent.futures.ThreadPoolExecutor(max(1, arguments.jobs)) as pool, open(
        log, "a", encoding="utf-8"
    ) as stream:
        for row in pool.map(run_in_time, seeds):
            if row is None:
                continue
            rows.append(row)
            stream.write(json.dumps(row) + "\n")
            stream.flush()
            if row["ending"] != "valid":
                print(f"seed {row['seed']} ({row['volume']}): {row['ending']}: {row['reason']}",
                      flush=True)
    text, is_good = summary(rows)
    (arguments.out / "summary.md").write_text(text)
    print(text)
    return 0 if is_good else 1


if __name__ == "__main__":
    sys.exit(main())
