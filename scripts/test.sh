#!/bin/sh
# SPDX-License-Identifier: AGPL-3.0-or-later
#
# Builds and runs the tests; exits non-zero when anything fails.
#
# usage: test.sh [--quick] [--sanitize]
#   (nothing)    the quick tests, then the slow set
#   --quick      the quick tests only
#   --sanitize   the quick tests, built with the address and undefined-behaviour sanitizers
set -eu
cd "$(dirname "$0")/.."

preset=release
is_quick=no
for argument in "$@"; do
  case $argument in
    --quick) is_quick=yes ;;
    --sanitize)
      preset=asan
      is_quick=yes
      ;;
    *)
      echo "test.sh: unknown argument '$argument'" >&2
      exit 2
      ;;
  esac
done

# Snakemake is left out by default for its size, 700 MB with what it draws in; where CI is set, its
# workflow is tested, too.
[ -z "${CI:-}" ] || scripts/install_dependencies.sh --cohort
scripts/build.sh "$preset"
jobs=$(nproc)
status=0
# Not "set -e" here: the slow set runs, and is summed up, also when a quick test fails.
ctest --test-dir "build/$preset" --output-on-failure --no-tests=error --parallel "$jobs" \
  --label-exclude slow || status=1
if [ "$is_quick" = no ]; then
  # Much of these is on one core: other programs, compilers. What measures time runs alone.
  ctest --test-dir "build/$preset" --output-on-failure --parallel "$jobs" --label-regex slow ||
    status=1
fi
if [ $status -eq 0 ]; then echo "tests: all passed"; else echo "tests: FAILED" >&2; fi
exit $status
