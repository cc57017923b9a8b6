#!/usr/bin/python3
# SPDX-License-Identifier: AGPL-3.0-or-later
"""Meshes volumes several times and compares what was written, byte for byte.

    same_bytes.py --cvmesh build/release/bin/cvmesh [--other build/dev/bin/cvmesh] \\
                  --out /tmp/same [--set KEY=VALUE] ../shared/data/tooth.nii.gz ...

Each volume is meshed with 1, 2 and 4 threads, a second time with 2, and where --other names another
build, once with that. All files must be those of the first run; of NAME.metrics.json, which holds
times, all but `timings`. Prints one row per volume; the exit status is 0 when nothing differs.
Needs nothing but Python 3.
"""

import argparse
import hashlib
import json
import shutil
import subprocess
import sys
import time
from pathlib import Path

THREADS = (1, 2, 4, 2)


def parse_arguments():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--cvmesh", required=True, type=Path, help="the binary under test")
    parser.add_argument("--other", type=Path, help="another build of it")
    parser.add_argument("--out", required=True, type=Path, help="folder for results")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE")
    parser.add_argument("volumes", nargs="+", type=Path, help="label volumes")
    return parser.parse_args()


def comparable(path):
    """The bytes of a file that equal runs must share."""
    if not path.name.endswith(".metrics.json"):
        return path.read_bytes()
    report = json.loads(path.read_text())
    del report["timings"]
    return json.dumps(report).encode()


def digests(folder):
    """Name -> digest of every file."""
    return {
        path.name: hashlib.sha256(comparable(path)).hexdigest()
        for path in sorted(folder.iterdir())
    }


def run(binary, volume, folder, threads, settings):
    """Files of one run, or None where it failed."""
    shutil.rmtree(folder, ignore_errors=True)
    command = [binary, "mesh", volume, "--out", folder, "--quiet", "--threads", str(threads)]
    for setting in settings:
        command += ["--set", setting]
    result = subprocess.run(command, stderr=subprocess.PIPE, text=True, check=False)
    if result.returncode != 0:
        print(f"{volume}: exit code {result.returncode}: {result.stderr[-300:]}", file=sys.stderr)
        return None
    return digests(folder)


def compare(arguments, volume):
    """What differs between the runs of one volume, as names with their run; and the files."""
    runs = [(arguments.cvmesh, threads) for threads in THREADS]
    if arguments.other:
        runs.append((arguments.other, 2))
    first, differing = None, []
    for number, (binary, threads) in enumerate(runs):
        name = f"run {number + 1} ({threads} threads{', other build' if number >= len(THREADS) else ''})"
        found = run(binary, volume, arguments.out / "run", threads, arguments.set)
        if found is None:
            return first or {}, [f"{name} failed"]
        first = first or found
        differing += [
            f"{file} of {name}"
            for file in sorted(first.keys() | found.keys())
            if first.get(file) != found.get(file)
        ]
    return first, differing


def main():
    arguments = parse_arguments()
    arguments.out.mkdir(parents=True, exist_ok=True)
    print("| volume | files | seconds of all runs | verdict |\n|---|---|---|---|")
    is_same = True
    for volume in arguments.volumes:
        begin = time.monotonic()
        files, differing = compare(arguments, volume)
        is_same = is_same and not differing
        verdict = "differs: " + ", ".join(differing) if differing else "same"
        print(f"| {volume.name} | {len(files)} | {time.monotonic() - begin:.0f} | {verdict} |",
              flush=True)
    shutil.rmtree(arguments.out / "run", ignore_errors=True)
    return 0 if is_same else 1


if __name__ == "__main__":
    sys.exit(main())
