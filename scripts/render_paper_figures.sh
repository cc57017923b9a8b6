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

# mesh VOLUME NAME SETTING...: WORK/NAME, with the stages; the volume is in one of the two folders
mesh() {
  volume=$1 name=$2
  shift 2
  [ -f "$work/$name/$volume.metrics.json" ] && [ -d "$work/$name/$volume.stages" ] && return
  path="$data/$volume.nii.gz"
  [ -f "$path" ] || path="$work/$volume.nii.gz"
  settings=""
  for setting in "$@"; do settings="$settings --set $setting"; done
  # shellcheck disable=SC2086  # settings hold no spaces
  "$cvmesh" mesh "$path" --out "$work/$name" --keep-stages --quiet --force $settings
}

# A ball of two materials, for Figures 7.1 and 7.2, and a hollow one, its wall 2.6 voxels thick, for
# Figure 7.9.
/usr/bin/python3 - "$work" << 'EOF'
import sys
import nibabel
import numpy
n = 45
x = numpy.indices((n, n, n)) - (n - 1) / 2
r = numpy.linalg.norm(x, axis=0)
for name, labels in (("halves", (r < 18) * numpy.where(x[0] + x[2] / 3 > 0, 1, 2)),
                     ("shell", (r > 16.6) & (r < 19.2))):
    image = nibabel.Nifti1Image(labels.astype(numpy.uint8), numpy.eye(4))
    nibabel.save(image, f"{sys.argv[1]}/{name}.nii.gz")
EOF

surfaces() { "$scripts/render_surfaces.py" "$@"; }

mesh halves halves epsilon=0.8
mesh bunny bunny05d epsilon=0.5 surface=delaunay
mesh bunny bunny05r15 epsilon=0.5 r=15 surface=delaunay
mesh bunny bunny1 epsilon=1
mesh bunny bunny5 epsilon=5
mesh bunny bunny5d epsilon=5 surface=delaunay
mesh tooth tooth3 epsilon=3
mesh tooth tooth3d epsilon=3 surface=delaunay
mesh femur_phantom femur epsilon=4
for epsilon in 8 25; do
  mesh shell "shell${epsilon}d" "epsilon=$epsilon" surface=delaunay
  mesh shell "shell$epsilon" "epsilon=$epsilon"
done

"$scripts/render_mesh.py" "$work/halves/halves.vtu" "$images/paper_7_1.png" --size 480x440
surfaces "$work/halves/halves.stages/dense.off" "$work/halves/halves.stages/augmented.off" \
  "$work/halves/halves.stages/sparse.off" "$images/paper_7_2.png" --edges --size 340x240 \
  --part 0.8 1 --lift 35 --captions "dense" "augmented" "decimated, flipped"
surfaces "$data/bunny.nii.gz" "$work/bunny1/bunny.stages/dense.off" "$images/paper_7_3.png" \
  --captions "voxels" "dense surface, r 0.8" --size 420x400
surfaces "$work/bunny05d/bunny.stages/sparse.off" "$work/bunny1/bunny.stages/sparse.off" \
  "$images/paper_7_4.png" --edges --size 340x330 \
  --captions "Delaunay, epsilon 0.5" "decimation, epsilon 1"
surfaces "$work/bunny05r15/bunny.stages/sparse.off" "$work/bunny5d/bunny.stages/sparse.off" \
  "$work/bunny5/bunny.stages/sparse.off" "$images/paper_7_5_7_6.png" --edges --size 340x330 \
  --captions "Delaunay, r 15, epsilon 0.5" "Delaunay, epsilon 5" "decimation, epsilon 5"
"$scripts/render_mesh.py" "$work/bunny5/bunny.vtu" "$images/paper_7_6b.png" --size 480x460
surfaces "$work/tooth3d/tooth.stages/sparse.off" "$work/tooth3/tooth.stages/sparse.off" \
  "$images/paper_7_7.png" --edges --size 340x480 \
  --captions "Delaunay, epsilon 3" "decimation, epsilon 3"
"$scripts/render_mesh.py" "$work/femur/femur_phantom.vtu" "$images/paper_7_8.png" --lie \
  --size 960x360
surfaces "$work/shell8d/shell.stages/sparse.off" "$work/shell8/shell.stages/sparse.off" \
  "$work/shell25d/shell.stages/sparse.off" "$work/shell25/shell.stages/sparse.off" \
  "$images/paper_7_9.png" --section "$work/shell8/shell.stages/dense.off" --size 260x290 \
  --normal z --turn 0 --lift 0 --captions "Delaunay, epsilon 8" "decimation, epsilon 8" \
  "Delaunay, epsilon 25" "decimation, epsilon 25"
