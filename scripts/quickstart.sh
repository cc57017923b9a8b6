#!/bin/sh
# SPDX-License-Identifier: AGPL-3.0-or-later
#
# From a fresh clone to a mesh: dependencies, build, the example femur, its mesh in out/.
#
# usage: quickstart.sh [SIZE]     small (default), medium or full
set -eu
cd "$(dirname "$0")/.."

scripts/build.sh release
mkdir -p out
build/release/bin/cvmesh-phantom femur --size "${1:-small}" --out out/femur.nii.gz
build/release/bin/cvmesh mesh out/femur.nii.gz --params examples/params/femur.json --out out --force
echo "the mesh: out/femur.vtu (ParaView, 3D Slicer); its report: out/femur.metrics.json"
