// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/grid/grid_frame.h"

namespace cvmesh {

/// Shear that passes for none: rounding and registration stay well below, and so does what it
/// changes in a distance.
inline constexpr double kMostShear = 0.01;

/// How far the axes are off right angles: the largest cosine between two of them.
double shear_of(const Affine& index_to_world);

/// Whether lengths in grid mm, which know no shear, differ from those in the world.
inline bool is_sheared(const GridFrame& frame) {
  return shear_of(frame.index_to_world) > kMostShear;
}

/// The world's vector of a vector in grid mm; its offset is 0, since lengths know no place.
Affine mm_to_world_vector(const GridFrame& frame);

}  // namespace cvmesh
