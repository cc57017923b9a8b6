// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/labels/label_volume.h"

#include <array>
#include <cstddef>
#include <vector>

namespace cvmesh {

/// A component of the 14-neighbour lattice that was given to a label around it.
struct RemovedComponent {
  Label label = 0;  ///< the one it had; 0 for a hole
  std::size_t voxels = 0;
  Label given_to = 0;                       ///< 0 where it became background
  std::array<int, 3> first_voxel{0, 0, 0};  ///< input index of its first voxel, x fastest
};

/// Gives each component of fewer than `min_voxels` voxels to the material it shares most voxel
/// faces with (ties: the smaller label); the largest component of a material stays.
///
/// Smallest first, ties by first voxel. An island that grew on the way by what it was given is
/// counted anew. Linear in the number of voxels per pass; one pass unless islands touch.
/// @param labels  ids, label_of and first_voxel are read, ids change
/// @return the islands in the order in which they went
std::vector<RemovedComponent> remove_islands(LabelVolume& labels, std::size_t min_voxels);

/// Gives each hole of fewer than `min_voxels` voxels to the material it shares most voxel faces
/// with (ties: the smaller label).
///
/// A hole is a component of `background` that does not touch the border of the grid. The grid must
/// hold all content, so that what touches its border is open to the border of the volume. Holes
/// share no face with each other, so their order is of no account. Linear in the number of voxels.
/// @param labels      ids, label_of and first_voxel are read, ids change
/// @param background  the exterior, or the material of label 0 where that is meshed
/// @return the holes, ascending by first voxel
std::vector<RemovedComponent> fill_holes(LabelVolume& labels,
                                         MaterialId background,
                                         std::size_t min_voxels);

}  // namespace cvmesh
