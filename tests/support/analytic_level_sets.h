// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/levelset/level_sets.h"

#include <array>
#include <cstddef>
#include <functional>
#include <memory>

namespace cvmesh::test_support {

/// Signed distance (mm, positive inside) of material m at a point (grid mm).
using SignedDistance = std::function<double(MaterialId m, const Vec3& p)>;

/// A frame of `dims` voxels at the origin of grid mm.
GridFrame plain_frame(const std::array<int, 3>& dims, const Vec3& spacing_mm = {1, 1, 1});

/// Middle of a frame, in grid mm.
Vec3 middle_of(const GridFrame& frame);

/// Level sets that store every block of every material; a node's values are `value(m, i, j, k)`.
LevelSets store_everywhere(std::shared_ptr<const Grid<MaterialId>> labels,
                           std::size_t material_count,
                           const std::function<double(MaterialId m, int i, int j, int k)>& value);

/// Level sets of known shapes: each node belongs to the material of the largest distance, its
/// values are the distances over 1.5 voxels (in index space), clamped to [-1, 1] and at least 0.05
/// from zero on the side of the node's label.
LevelSets analytic_level_sets(const GridFrame& frame,
                              std::size_t material_count,
                              const SignedDistance& signed_distance_mm);

/// The same for one material (id 1) in the exterior.
LevelSets analytic_level_sets(const GridFrame& frame,
                              const std::function<double(const Vec3&)>& signed_distance_mm);

}  // namespace cvmesh::test_support
