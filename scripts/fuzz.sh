#!/bin/sh
# SPDX-License-Identifier: AGPL-3.0-or-later
#
# Builds the fuzz targets with Clang and runs them.
#
# usage: fuzz.sh SECONDS [TARGET...]
#   SECONDS  for each target; 0 only replays the corpora
#   TARGET   nifti_header, parameters, vtu_mesh, ..., as in tests/fuzz/corpus; default: all
#
# What a run finds interesting goes to build/fuzz/corpus/TARGET; what it finds wrong, to
# build/fuzz/finds/TARGET, and the exit status is 1. A find that is fixed goes to
# tests/fuzz/corpus/TARGET, so that it is replayed for ever.
set -eu
cd "$(dirname "$0")/.."
if [ $# -eq 0 ]; then
  sed -n '3,13s/^# \{0,1\}//p' "$0"
  exit 2
fi
seconds=$1
shift
cmake -S tests/fuzz -B build/fuzz -G Ninja -DCMAKE_CXX_COMPILER="${CXX:-clang++}"
cmake --build build/fuzz
[ $# -gt 0 ] || set -- $(ls tests/fuzz/corpus)
status=0
for target in "$@"; do
  mkdir -p "build/fuzz/corpus/$target" "build/fuzz/finds/$target"
  echo "== $target"
  if [ "$seconds" -eq 0 ]; then
    "build/fuzz/fuzz_$target" -runs=0 "tests/fuzz/corpus/$target" || status=1
  else
    dictionary=tests/fuzz/dictionaries/$target
    "build/fuzz/fuzz_$target" -max_total_time="$seconds" -timeout=10 -rss_limit_mb=2048 \
      -print_final_stats=1 -artifact_prefix="build/fuzz/finds/$target/" \
      $([ ! -f "$dictionary" ] || echo "-dict=$dictionary") \
      "build/fuzz/corpus/$target" "tests/fuzz/corpus/$target" || status=1
  fi
done
exit $status
