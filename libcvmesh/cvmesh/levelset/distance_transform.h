// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/core/vec3.h"

#include <array>
#include <cstdint>
#include <limits>
#include <vector>

namespace cvmesh {

/// What `squared_distances` gives where no site is within reach.
inline constexpr float kNoSite = std::numeric_limits<float>::infinity();

/// Squared Euclidean distance from every node of a box to the nearest site, exact up to rounding.
///
/// One scan along x, then the lower envelope of parabolas along y and z [Meijster 2000,
/// Felzenszwalb 2012]; each pass is linear and parallel over lines. Distances above `reach` come
/// back as `kNoSite`, which saves most of the work where sites are far.
///
/// @param dims    nodes along x, y, z; x fastest
/// @param step    distance of neighbouring nodes along each axis
/// @param sites   nonzero at sites, one entry per node
/// @param reach   largest distance of interest, in the units of `step`
std::vector<float> squared_distances(const std::array<int, 3>& dims,
                                     const Vec3& step,
                                     const std::vector<std::uint8_t>& sites,
                                     double reach = std::numeric_limits<double>::infinity());

}  // namespace cvmesh
