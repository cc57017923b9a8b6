#!/bin/sh
# SPDX-License-Identifier: AGPL-3.0-or-later
#
# Meshes a few real volumes and has the independent evaluator judge them; a test (label "slow").
#
# usage: judge.sh CVMESH SHARED TOOLS OUT
#   CVMESH  the binary under test
#   SHARED  folder with data/ and tools/; when it is not there the test is skipped (status 77)
#   TOOLS   folder for the evaluator, built where it is not there yet
#   OUT     folder for the results, made anew
set -eu
cvmesh=$1 shared=$2 tools=$3 out=$4
here=$(dirname "$0")
if ! [ -x "$shared/tools/build.sh" ] || ! [ -d "$shared/data" ]; then
  echo "judge: skipped, no evaluator or no data in $shared"
  exit 77
fi
mkdir -p "$out"
"$shared/tools/build.sh" "$tools"
judge() { # epsilon, volumes...
  epsilon=$1
  shift
  "$here/run_matrix.py" --cvmesh "$cvmesh" --evalmesh "$tools/evalmesh" \
    --surfdist "$tools/surfdist" --data "$shared/data" --out "$out/epsilon_$epsilon" --force \
    --epsilons "$epsilon" --volumes "$@"
}
status=0
judge 1 bunny cleaver_spheres cleaver_mickey cgal_tiny_420 cgal_tiny_12323 rat_head || status=1
judge 3 tooth cgal_liver || status=1
judge 5 bunny || status=1
cat "$out"/epsilon_*/matrix.md
exit $status
