#!/usr/bin/python3
# SPDX-License-Identifier: AGPL-3.0-or-later
"""Runs the Snakemake workflow on twenty small volumes, with a broken file and a killed job among
them. A test (label "slow").

    test_snakemake.py CVMESH SCRIPTS OUT

Exits with 77 (skipped) where Snakemake or nibabel is not installed.
"""

import os
import shutil
import subprocess
import sys

SKIPPED = 77
try:
    import cohort_cases
except ImportError as missing:
    print(f"skipped: {missing}")
    sys.exit(SKIPPED)


def main():
    cvmesh, scripts, out = cohort_cases.arguments()
    if shutil.which("snakemake") is None:
        print("skipped: no snakemake here")
        return SKIPPED
    if not cohort_cases.has_summary(cvmesh):
        print("skipped: this cvmesh has no command summary")
        return SKIPPED
    shutil.rmtree(out, ignore_errors=True)
    listed = cohort_cases.make_subjects(out)
    results = out / "results"
    results.mkdir()
    command = ["snakemake", "-s", scripts / "Snakefile", "--cores", "2", "--directory", out,
               "--quiet", "--config", f"list={listed}", f"out={results}", "threads=1",
               "memory_mb=500", "options=--set epsilon=3",
               f"cvmesh={cohort_cases.make_killer(cvmesh, out)}"]
    # Its caches stay in the test's folder.
    environment = {**os.environ, "XDG_CACHE_HOME": str(out / "cache")}
    if subprocess.run(command + ["--dryrun"], env=environment).returncode != 0:
        return 1
    if subprocess.run(command, env=environment).returncode != 0:
        return 1
    well = cohort_cases.check_results(results)
    tries = len((out / "killed.txt").read_text().splitlines())
    if tries != 3:
        print(f"FAILED the killed subject was tried {tries} times instead of 3")
        well = False
    print("ok" if well else "FAILED")
    return 0 if well else 1


if __name__ == "__main__":
    sys.exit(main())
