#!/usr/bin/env python3
# SPDX-License-Identifier: AGPL-3.0-or-later
"""What the cohort scripts share: the list of subjects, and the table at the end.

    cohort.py check LIST
    cohort.py summarize CVMESH LIST OUT

LIST has one label volume per line; blank lines and those that begin with # are left out. The results
of a/b/NAME.nii.gz are in OUT/NAME. `summarize` writes a NAME.failed.json for every subject whose job
left nothing behind (killed, never started), and then the table OUT/summary.csv.
"""

import json
import pathlib
import subprocess
import sys

# cvmesh summary says so where a run of the cohort failed.
SOME_FAILED = 5


def stem(path):
    """The name that cvmesh gives to the results of a volume."""
    name = pathlib.Path(path).name
    if name.endswith(".gz"):
        name = name[:-len(".gz")]
    return pathlib.Path(name).stem


def read_subjects(path):
    """Name -> label volume, in the order of the list."""
    subjects = {}
    for number, line in enumerate(pathlib.Path(path).read_text().splitlines(), 1):
        line = line.strip()
        if not line or line.startswith("#"):
            continue
        name = stem(line)
        if name in subjects:
            sys.exit(f"{path}, line {number}: {line} and {subjects[name]} would both be called "
                     f"{name}; rename one of them")
        subjects[name] = line
    if not subjects:
        sys.exit(f"{path}: no subjects; give one label volume per line")
    return subjects


def output_of(*command):
    return subprocess.run(command, capture_output=True, text=True, check=False).stdout


def record_lost(cvmesh, subjects, out):
    """Names the subjects whose job ended without a word of its own."""
    said = output_of(cvmesh, "--version").split()
    schema = json.loads(output_of(cvmesh, "schema", "--metrics"))
    version = schema["properties"]["schema_version"]["const"]
    for name in subjects:
        folder = out / name
        if any((folder / (name + suffix)).exists() for suffix in (".metrics.json", ".failed.json")):
            continue
        folder.mkdir(parents=True, exist_ok=True)
        record = {"cvmesh": said[-1] if said else "", "schema_version": version,
                  "status": "failed", "stage": "job", "code": "killed", "exit_code": 137,
                  "message": "the job ended without a result: killed, out of memory or time, or "
                             "never started",
                  "input": {"file": pathlib.Path(subjects[name]).name}}
        (folder / (name + ".failed.json")).write_text(json.dumps(record, indent=2) + "\n")


def summarize(cvmesh, subjects, out):
    record_lost(cvmesh, subjects, out)
    done = subprocess.run([cvmesh, "summary", *(str(out / name) for name in subjects), "--out",
                           str(out / "summary.csv")])
    return 0 if done.returncode == SOME_FAILED else done.returncode


def main():
    if sys.argv[1:2] == ["check"] and len(sys.argv) == 3:
        print(len(read_subjects(sys.argv[2])))
        return 0
    if sys.argv[1:2] == ["summarize"] and len(sys.argv) == 5:
        return summarize(sys.argv[2], read_subjects(sys.argv[3]), pathlib.Path(sys.argv[4]))
    sys.exit(__doc__)


if __name__ == "__main__":
    sys.exit(main())
