// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/labels/label_volume.h"

#include <cstddef>
#include <vector>

namespace cvmesh {

/// A face between two voxels of different materials.
struct VoxelFace {
  MaterialId low = kExterior, high = kExterior;  ///< the two materials, the smaller id first
  float area_mm2 = 0;
  float feature_mm = 0;  ///< the smaller feature size of its two voxels
};

/// What the voxels alone tell about the surfaces to come, before any level set: what a forecast is
/// made from.
struct VoxelFeatures {
  std::vector<VoxelFace> faces;       ///< those on the border of a volume are not among them
  std::size_t dense_facets = 0;       ///< of label marching tetrahedra, up to a few percent
  std::vector<double> thinnest_mm{};  ///< per material: no thicker is 1 % of its boundary
};

/// Feature sizes of all boundary voxels, by climbing the distance transform of their own material
/// up to its ridge: the distance there is the radius of the ball that touches the boundary on both
/// sides, a poor man's medial axis [Hesselink 2008]. Stairs count as flat.
/// @note  linear in the voxels of all materials' boxes, times the thickness in voxels; 4 bytes per
///        voxel, and per voxel of the largest box 5 more
VoxelFeatures measure_voxel_features(const LabelVolume& labels);

}  // namespace cvmesh
