#!/bin/sh
# SPDX-License-Identifier: AGPL-3.0-or-later
#
# Installs what cvmesh needs from Debian 12's own packages. Safe to run again: when everything is
# there it only looks and ends at once.
#
# usage: install_dependencies.sh [--no-tests] [--rendering] [--cohort]
#   --no-tests    leave out what only the tests need
#   --cohort      also snakemake (700 MB installed), for scripts/cohort/Snakefile and its test
#   --rendering   also what scripts/render_mesh.py needs
set -eu

build="build-essential cmake ninja-build libboost-dev libcgal-dev libtet1.5-dev
  libinsighttoolkit5-dev libcli11-dev nlohmann-json3-dev libspdlog-dev libfmt-dev libtbb-dev
  libeigen3-dev libnanoflann-dev zlib1g-dev libssl-dev libgmp-dev libmpfr-dev libjs-three"
tests="catch2 python3-minimal python3-numpy python3-meshio python3-nibabel python3-jsonschema
  calculix-ccx python3-gmsh python3-getfem++ python3-vtk9 slurm-wlm munge chromium chromium-driver"
cohort="snakemake"
rendering="python3-vtk9 python3-nibabel xvfb xauth"

packages="$build $tests"
for argument in "$@"; do
  case $argument in
    --no-tests) packages=$build ;;
    --cohort) packages="$packages $cohort" ;;
    --rendering) packages="$packages $rendering" ;;
    *)
      echo "install_dependencies.sh: unknown argument '$argument'" >&2
      exit 2
      ;;
  esac
done

# shellcheck disable=SC2086  # the lists are split into words on purpose
if ! command -v dpkg-query > /dev/null; then
  echo "install_dependencies.sh: no dpkg here; install these by hand:" $packages >&2
  exit 1
fi

missing=""
for package in $packages; do
  # "ok installed" and not merely known: a removed package keeps its configuration files.
  if ! dpkg-query -W -f '${Status}' "$package" 2> /dev/null | grep -q "ok installed"; then
    missing="$missing $package"
  fi
done
[ -z "$missing" ] && exit 0

as_root=""
if [ "$(id -u)" -ne 0 ]; then
  if ! command -v sudo > /dev/null; then
    echo "install_dependencies.sh: not root and no sudo; as root run: apt-get install$missing" >&2
    exit 1
  fi
  as_root="sudo"
fi

echo "installing:$missing"
# shellcheck disable=SC2086
# A machine without package lists, or with old ones, needs the update; others can do without.
$as_root env DEBIAN_FRONTEND=noninteractive apt-get install -y -q --no-install-recommends $missing ||
  {
    $as_root apt-get update -q
    $as_root env DEBIAN_FRONTEND=noninteractive \
      apt-get install -y -q --no-install-recommends $missing
  }
