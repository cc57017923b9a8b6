#!/usr/bin/python3
# SPDX-License-Identifier: AGPL-3.0-or-later
"""Stops and kills runs at random moments and looks at what is left.

    kill_runs.py --cvmesh build/release/bin/cvmesh --volume ../shared/data/tooth.nii.gz \\
                 --out /tmp/kills --moments 50

A first run goes to its end and tells how long one takes. Then, for each moment, a run gets SIGTERM,
SIGINT or SIGKILL in turn. After that no process of it may run two seconds later, no file may lie
under a final name that is not whole, and (but for SIGKILL) no temporary file may be left; a signal
that can be caught must end the run within two seconds with exit code 128 + n and a failure file.
Prints one line per moment; the exit status is 0 when nothing was found. Needs nothing but Python 3.
"""

import argparse
import json
import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

SECONDS_TO_END = 2.0
MARK = "CVMESH_KILL_MARK"


def parse_arguments():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--cvmesh", required=True, type=Path, help="the binary under test")
    parser.add_argument("--volume", required=True, type=Path, help="label volume")
    parser.add_argument("--out", required=True, type=Path, help="folder for results")
    parser.add_argument("--moments", type=int, default=50, help="runs to stop")
    parser.add_argument("--seed", type=int, default=1, help="of the moments")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE")
    return parser.parse_args()


def start(arguments, folder, mark):
    command = [arguments.cvmesh, "mesh", arguments.volume, "--out", folder, "--force", "--quiet"]
    for setting in arguments.set:
        command += ["--set", setting]
    return subprocess.Popen(
        command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True,
        env={**os.environ, MARK: mark},
    )


def marked(mark):
    """Process ids with the mark in their environment."""
    found = []
    for entry in Path("/proc").iterdir():
        try:
            if entry.name.isdigit() and f"{MARK}={mark}".encode() in (entry / "environ").read_bytes():
                found.append(int(entry.name))
        except OSError:
            continue
    return found


def is_whole(path):
    """Whether a file of results is complete, judged by its end."""
    try:
        if path.suffix == ".json":
            json.loads(path.read_text())
        elif path.suffix == ".mesh":
            return path.read_text().rstrip().endswith("End")
        elif path.suffix in (".vtp", ".vtu"):
            return path.read_bytes().rstrip().endswith(b"</VTKFile>")
    except ValueError:
        return False
    return True


def faults_of(arguments, folder, number, process, mark, name):
    faults = []
    begin = time.monotonic()
    _, errors = process.communicate()
    seconds = time.monotonic() - begin
    while marked(mark) and time.monotonic() - begin < SECONDS_TO_END:
        time.sleep(0.02)
    if marked(mark):
        faults.append(f"processes {marked(mark)} still run")
    files = sorted(p for p in folder.rglob("*") if p.is_file()) if folder.exists() else []
    finals = [p for p in files if not p.name.startswith(".")]
    faults += [f"{p.name} is not whole" for p in finals if not is_whole(p)]
    code = process.returncode
    if code == 0:  # over before the signal came
        return faults, seconds, "complete"
    if number == signal.SIGKILL:
        if (folder / f"{name}.metrics.json").exists():
            faults.append("metrics of a run that was killed")
        return faults, seconds, "killed"
    stopped_early = code == -number and not files  # before the handlers stood
    if code != 128 + number and not stopped_early:
        faults.append(f"exit code {code}: {errors[-300:]}")
    if seconds > SECONDS_TO_END:
        faults.append(f"took {seconds:.2f} s to end")
    if not stopped_early and [p.name for p in files] not in ([f"{name}.failed.json"], []):
        faults.append(f"left {[p.name for p in files]}")
    failed = folder / f"{name}.failed.json"
    stage = json.loads(failed.read_text())["stage"] if failed.exists() else "before the first stage"
    return faults, seconds, stage


def main():
    arguments = parse_arguments()
    name = arguments.volume.name.removesuffix(".gz").rsplit(".", 1)[0]
    begin = time.monotonic()
    if start(arguments, arguments.out / "whole", "whole").wait() != 0:
        sys.exit("kill_runs: the run that nobody disturbed failed")
    whole = time.monotonic() - begin
    draws = random.Random(arguments.seed)
    slowest = found = 0
    for moment in range(arguments.moments):
        number = (signal.SIGTERM, signal.SIGINT, signal.SIGKILL)[moment % 3]
        folder = arguments.out / str(moment)
        mark = f"{os.getpid()}-{moment}"
        process = start(arguments, folder, mark)
        delay = draws.uniform(0, whole)
        time.sleep(delay)
        process.send_signal(number)
        faults, seconds, stage = faults_of(arguments, folder, number, process, mark, name)
        if number != signal.SIGKILL:
            slowest = max(slowest, seconds)
        found += len(faults)
        print(f"{moment}: {number.name} at {delay:.2f} of {whole:.2f} s, {stage}, ended in "
              f"{seconds:.2f} s: {'; '.join(faults) or 'nothing left'}", flush=True)
    print(f"{arguments.moments} moments, {found} faults, slowest end {slowest:.2f} s")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
