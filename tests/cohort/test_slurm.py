#!/usr/bin/python3
# SPDX-License-Identifier: AGPL-3.0-or-later
"""Runs the SLURM array on this machine alone, with a controller, a node and a munge of the test's
own, on twenty small volumes, with a broken file and a killed job among them. A test (label "slow").

    test_slurm.py CVMESH SCRIPTS OUT

Exits with 77 (skipped) where Debian's slurm-wlm, munge or nibabel is not installed, or the test is not
root, which slurmd wants to be.
"""

import os
import pathlib
import shutil
import socket
import subprocess
import sys
import time

SKIPPED = 77
try:
    import cohort_cases
except ImportError as missing:
    print(f"skipped: {missing}")
    sys.exit(SKIPPED)

TIME_LIMIT_S = 600


class Cluster:
    """A SLURM cluster of one node, in a folder; everything it starts ends with it."""

    def __init__(self, folder):
        self.folder = folder
        self.daemons = []
        host = socket.gethostname().split(".")[0]
        folder.mkdir(parents=True)
        (folder / "state").mkdir()
        (folder / "spool").mkdir()
        # Munge refuses folders that others may write to.
        os.chmod(folder, 0o755)
        key = folder / "munge.key"
        key.write_bytes(os.urandom(1024))
        key.chmod(0o600)
        self.config = folder / "slurm.conf"
        self.config.write_text(f"""ClusterName=test
SlurmctldHost={host}(127.0.0.1)
SlurmUser=root
SlurmctldPort=16817
SlurmdPort=16818
AuthType=auth/munge
AuthInfo=socket={folder}/munge.socket
CredType=cred/munge
StateSaveLocation={folder}/state
SlurmdSpoolDir={folder}/spool
SlurmctldPidFile={folder}/slurmctld.pid
SlurmdPidFile={folder}/slurmd.pid
SlurmctldLogFile={folder}/slurmctld.log
SlurmdLogFile={folder}/slurmd.log
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
MpiDefault=none
ReturnToService=2
SchedulerType=sched/backfill
SelectType=select/cons_tres
SelectTypeParameters=CR_Core_Memory
JobAcctGatherType=jobacct_gather/none
AccountingStorageType=accounting_storage/none
NodeName={host} NodeAddr=127.0.0.1 CPUs={os.cpu_count()} RealMemory=2000 State=UNKNOWN
PartitionName=main Nodes={host} Default=YES MaxTime=60 State=UP
""")
        self.environment = {**os.environ, "SLURM_CONF": str(self.config)}

    def start(self):
        self.daemon(["munged", "--foreground", "--force", f"--key-file={self.folder}/munge.key",
                     f"--socket={self.folder}/munge.socket", f"--pid-file={self.folder}/munge.pid",
                     f"--log-file={self.folder}/munge.log", f"--seed-file={self.folder}/munge.seed"])
        time.sleep(1)
        self.daemon(["slurmctld", "-D", "-c", "-f", self.config])
        time.sleep(2)
        self.daemon(["slurmd", "-D", "-c", "-f", self.config])

    def daemon(self, command):
        path = "/usr/sbin:/sbin:" + os.environ.get("PATH", "")
        with (self.folder / (command[0] + ".out")).open("w") as log:
            self.daemons.append(subprocess.Popen(
                [str(word) for word in command], stdout=log, stderr=subprocess.STDOUT,
                env={**self.environment, "PATH": path}))

    def run(self, command):
        return subprocess.run([str(word) for word in command], env=self.environment, text=True,
                              capture_output=True)

    def stop(self):
        for daemon in reversed(self.daemons):
            daemon.terminate()
            try:
                daemon.wait(timeout=20)
            except subprocess.TimeoutExpired:
                daemon.kill()

    def logs(self):
        return "\n".join(f"--- {path.name}\n{path.read_text(errors='replace')[-2000:]}"
                         for path in sorted(self.folder.glob("*.log")) +
                         sorted(self.folder.glob("*.out")))


def wait_for(condition, limit_s):
    end = time.monotonic() + limit_s
    while time.monotonic() < end:
        if condition():
            return True
        time.sleep(1)
    return False


def run_cohort(cluster, cvmesh, scripts, out):
    if not wait_for(lambda: "idle" in cluster.run(["sinfo", "-h", "-o", "%T"]).stdout, 60):
        print("FAILED the node did not come up")
        return False
    listed = cohort_cases.make_subjects(out)
    submitted = cluster.run([scripts / "slurm_cohort.sh", cohort_cases.make_killer(cvmesh, out),
                             listed, out / "results", "400", "1", "--set", "epsilon=3"])
    if submitted.returncode != 0:
        print(f"FAILED submission: {submitted.stderr}")
        return False
    done = wait_for(lambda: cluster.run(["squeue", "-h"]).stdout == "", TIME_LIMIT_S)
    if not done:
        print("FAILED still running:\n" + cluster.run(["squeue"]).stdout)
        return False
    well = (out / "results" / "summary.csv").exists() and cohort_cases.check_results(
        (out / "results"))
    tries = len((out / "killed.txt").read_text().splitlines())
    if tries != 2:
        print(f"FAILED the killed subject was tried {tries} times instead of 2")
        well = False
    return well


def main():
    cvmesh, scripts, out = cohort_cases.arguments()
    path = "/usr/sbin:/sbin:" + os.environ.get("PATH", "")
    for program in ("munged", "slurmctld", "slurmd", "sbatch"):
        if shutil.which(program, path=path) is None:
            print(f"skipped: no {program} here")
            return SKIPPED
    if os.geteuid() != 0:
        print("skipped: not root")
        return SKIPPED
    if not cohort_cases.has_summary(cvmesh):
        print("skipped: this cvmesh has no command summary")
        return SKIPPED
    shutil.rmtree(out, ignore_errors=True)
    out.mkdir(parents=True)
    cluster = Cluster(pathlib.Path(out) / "cluster")
    try:
        cluster.start()
        well = run_cohort(cluster, cvmesh, scripts, out)
        if not well:
            print(cluster.logs())
    finally:
        cluster.stop()
    print("ok" if well else "FAILED")
    return 0 if well else 1


if __name__ == "__main__":
    sys.exit(main())
