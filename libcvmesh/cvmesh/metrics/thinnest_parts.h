// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/labels/label_volume.h"

#include <vector>

namespace cvmesh {

/// Per material the thickness, in mm, that 1 % of its boundary does not exceed, from the voxels
/// alone; 0 where it has no boundary.
///
/// From each boundary voxel the distance transform of its own material is climbed up to its ridge:
/// the distance there is the radius of the ball that touches the boundary on both sides, a poor
/// man's medial axis [Hesselink 2008]. Stairs count as flat.
/// @note  linear in the voxels of all materials' boxes, times the thickness in voxels; 4 bytes per
///        voxel, and per voxel of the largest box 5 more
std::vector<double> thinnest_parts_mm(const LabelVolume& labels);

}  // namespace cvmesh
