#!/bin/sh
# SPDX-License-Identifier: AGPL-3.0-or-later
#
# Stores the results of the golden phantoms (tests/golden/) anew, after a change of the meshes or of
# the report that is intended. Commit the files together with that change and a CHANGELOG line.
#
# usage: update_golden.sh [BUILD_FOLDER]   (default: build/release, which is built if needed)
set -eu
cd "$(dirname "$0")/.."

build=${1:-build/release}
cmake --build "$build" --target cvmesh_app --target cvmesh_tests
CVMESH_UPDATE_GOLDEN=1 "$build/bin/cvmesh_tests" "[golden]"
git --no-pager diff --stat -- tests/golden
