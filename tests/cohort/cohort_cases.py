# SPDX-License-Identifier: AGPL-3.0-or-later
"""Twenty small subjects for the cohort tests, one of them broken, one whose job is killed."""

import csv
import json
import pathlib
import stat
import subprocess
import sys

import nibabel
import numpy as np

COUNT = 20
BROKEN, KILLED = "subject_07", "subject_13"


def make_subjects(out):
    """The list of the volumes."""
    folder = out / "volumes"
    folder.mkdir(parents=True, exist_ok=True)
    paths = []
    for n in range(COUNT):
        x = np.indices((15, 14, 13)).transpose(1, 2, 3, 0) - (7, 6.5, 6)
        labels = ((x / (4 + 0.1 * n, 4.5, 4)) ** 2).sum(axis=3) < 1
        labels = labels * np.where(x[..., 0] > 0, 1, 2)
        path = folder / f"subject_{n:02}.nii.gz"
        nibabel.save(nibabel.Nifti1Image(labels.astype(np.uint8), np.eye(4)), path)
        if path.name.startswith(BROKEN):
            path.write_bytes(path.read_bytes()[:60])
        paths.append(path)
    listed = out / "subjects.txt"
    listed.write_text("# the cohort\n\n" + "".join(f"{path}\n" for path in paths))
    return listed


def make_killer(cvmesh, out):
    """cvmesh, but a run of one subject is killed, as the kernel does where memory runs out."""
    program = out / "cvmesh_or_killed.sh"
    program.write_text(f"""#!/bin/sh
case "$1 $2" in
  "mesh "*{KILLED}*) echo "a run of {KILLED}" >> "{out}/killed.txt"; kill -9 $$ ;;
esac
exec "{cvmesh}" "$@"
""")
    program.chmod(program.stat().st_mode | stat.S_IXUSR)
    return program


def check_results(out):
    """Eighteen are complete, the two are named, nothing else is there."""
    faults = []
    for n in range(COUNT):
        name = f"subject_{n:02}"
        folder = out / name
        found = {path.name for path in folder.iterdir()
                 if path.suffix != ".exit_code" and path.is_file()}
        if name in (BROKEN, KILLED):
            wanted = {f"{name}.failed.json"}
        else:
            wanted = {name + suffix
                      for suffix in (".vtu", ".mesh", ".surface.vtp", ".metrics.json")}
        if found != wanted:
            faults.append(f"{name}: {sorted(found)} instead of {sorted(wanted)}")
    if json.loads((out / BROKEN / f"{BROKEN}.failed.json").read_text())["code"] != "BadInput":
        faults.append("the broken file is not called bad input")
    table = list(csv.DictReader((out / "summary.csv").open()))
    text = (out / "summary.csv").read_text()
    if len(table) != COUNT:
        faults.append(f"{len(table)} rows in the summary")
    failed = [row for row in table if "failed" in row.values()]
    if len(failed) != 2 or not all(name in text for name in (BROKEN, KILLED)):
        faults.append(f"{len(failed)} rows of the summary say failed: {failed}")
    for fault in faults:
        print(f"FAILED {fault}")
    return not faults


def has_summary(cvmesh):
    return subprocess.run([cvmesh, "summary", "--help"], capture_output=True).returncode == 0


def arguments():
    return (pathlib.Path(word).absolute() for word in sys.argv[1:])
