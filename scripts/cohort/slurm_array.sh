#!/bin/sh
# SPDX-License-Identifier: AGPL-3.0-or-later
#
# One task of a SLURM array: meshes the subject whose line in the list is the task's number. Threads
# are as many as --cpus-per-task gives. slurm_cohort.sh submits it; by hand:
#
#   sbatch --array=1-20 slurm_array.sh CVMESH LIST OUT [option of cvmesh mesh]...
set -eu
cvmesh=$1
list=$2
out=$3
shift 3
input=$(grep -v -e '^[[:space:]]*#' -e '^[[:space:]]*$' "$list" | sed -n "${SLURM_ARRAY_TASK_ID}p")
name=$(basename "$input" .gz)
exec "$cvmesh" mesh "$input" --out "$out/${name%.*}" --resume --force --quiet "$@"
