#!/bin/sh
# SPDX-License-Identifier: AGPL-3.0-or-later
#
# Submits a cohort to SLURM: an array with one task per subject, the same array once more with twice
# the memory for those that did not end well (finished subjects end at once, by --resume), and the
# table OUT/summary.csv when all tasks have ended, however. Prints the number of that last job.
#
#   slurm_cohort.sh CVMESH LIST OUT MEMORY_MB CPUS [option of cvmesh mesh]...
set -eu
if [ $# -lt 5 ]; then
  echo "usage: slurm_cohort.sh CVMESH LIST OUT MEMORY_MB CPUS [option of cvmesh mesh]..." >&2
  exit 2
fi
cvmesh=$1
list=$2
out=$3
memory=$4
cpus=$5
shift 5
here=$(cd "$(dirname "$0")" && pwd)
count=$(python3 "$here/cohort.py" check "$list")
mkdir -p "$out/logs"

submit_array() { # memory, further options of sbatch; arguments of cvmesh after "--"
  array_memory=$1
  dependency=$2
  shift 2
  # shellcheck disable=SC2086  # the dependency is one option or none
  sbatch --parsable --job-name=cvmesh --array="1-$count" --mem="${array_memory}M" \
    --cpus-per-task="$cpus" --output="$out/logs/%A_%a.log" $dependency \
    "$here/slurm_array.sh" "$cvmesh" "$list" "$out" "$@"
}

first=$(submit_array "$memory" "" "$@")
second=$(submit_array $((2 * memory)) "--dependency=afterany:$first" "$@")
sbatch --parsable --job-name=cvmesh-summary --dependency="afterany:$second" --mem=500M \
  --output="$out/logs/summary.log" \
  --wrap="python3 '$here/cohort.py' summarize '$cvmesh' '$list' '$out'"
