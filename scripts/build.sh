#!/bin/sh
# SPDX-License-Identifier: AGPL-3.0-or-later
#
# Installs what is missing, configures and builds one preset.
#
# usage: build.sh [PRESET]     release (default), dev, asan or tsan; the result is in build/PRESET
set -eu
cd "$(dirname "$0")/.."

preset=${1:-release}
scripts/install_dependencies.sh
# In CI a warning is an error.
werror=OFF
[ -z "${CI:-}" ] || werror=ON
cmake --preset "$preset" -DCVMESH_WERROR=$werror

# CGAL's headers need up to 1.5 GB per compiler: on a small machine fewer at a time.
memory_gb=$(awk '/^MemAvailable:/ { print int($2 / 1048576) }' /proc/meminfo)
jobs=$(nproc)
[ "$jobs" -gt $((memory_gb * 2 / 3)) ] && jobs=$((memory_gb * 2 / 3))
[ "$jobs" -lt 1 ] && jobs=1
cmake --build --preset "$preset" --parallel "$jobs"
