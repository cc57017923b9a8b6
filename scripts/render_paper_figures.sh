#!/bin/sh
# SPDX-License-Identifier: AGPL-3.0-or-later
#
# Draws the figures of docs/paper.md, each from meshes that this script makes.
#
# usage: render_paper_figures.sh CVMESH DATA_FOLDER WORK_FOLDER IMAGE_FOLDER
#   CVMESH        the executable
#   DATA_FOLDER   with bunny.nii.gz, tooth.nii.gz and femur_phantom.nii.gz
#   WORK_FOLDER   for the meshes, some 200 MB; one that is there already is not made again
#   IMAGE_FOLDER  for the pictures
set -eu
if [ $# -ne 4 ]; then
  echo "usage: render_paper_figures.sh CVMESH DATA_FOLDER WORK_FOLDER IMAGE_FOLDER" >&2
  exit 2
fi
cvmesh=$1 data=$2 work=$3 images=$4
scripts=$(dirname "$0")
mkdir -p "$work" "$images"

# mesh VOLUME NAME SETTING...: WORK/NAME, with the stages
mesh() {
  volume=$1 name=$2
  shift 2
  [ -f "$work/$name/$volume.metrics.json" ] && return
  settings=""
  for setting in "$@"; do settings="$settings --set $setting"; done
  # shellcheck disable=SC2086  # settings hold no spaces
  "$cvmesh" mesh "$data/$volume.nii.gz" --out "$work/$name" --keep-stages --quiet --force $settings
}

surfaces() { "$scripts/render_surfaces.py" "$@"; }

mesh bunny bunny05d epsilon=0.5 surface=delaunay
mesh bunny bunny1 epsilon=1
mesh bunny bunny5 epsilon=5
mesh bunny bunny5d epsilon=5 surface=delaunay
mesh tooth tooth3 epsilon=3
mesh tooth tooth3d epsilon=3 surface=delaunay
mesh femur_phantom femur epsilon=4

surfaces "$data/bunny.nii.gz" "$work/bunny1/stages/dense.off" "$images/paper_7_3.png" \
  --captions "voxels" "dense surface, r 0.8" --size 420x400
surfaces "$work/bunny05d/stages/sparse.off" "$work/bunny1/stages/sparse.off" \
  "$images/paper_7_4.png" --edges --size 340x330 \
  --captions "Delaunay, epsilon 0.5" "decimation, epsilon 1"
surfaces "$work/bunny5d/stages/sparse.off" "$work/bunny5/stages/sparse.off" \
  "$images/paper_7_5_7_6.png" --edges --size 480x460 \
  --captions "Delaunay, epsilon 5" "decimation, epsilon 5"
"$scripts/render_mesh.py" "$work/bunny5/bunny.vtu" "$images/paper_7_6b.png" --size 480x460
surfaces "$work/tooth3d/stages/sparse.off" "$work/tooth3/stages/sparse.off" \
  "$images/paper_7_7.png" --edges --size 340x480 \
  --captions "Delaunay, epsilon 3" "decimation, epsilon 3"
"$scripts/render_mesh.py" "$work/femur/femur_phantom.vtu" "$images/paper_7_8.png" --lie \
  --size 960x360
