// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/core/label.h"
#include "cvmesh/grid/grid.h"
#include "cvmesh/levelset/level_sets.h"

#include <array>
#include <cstdint>
#include <vector>

namespace cvmesh {

/// Where a grid edge between nodes of different labels crosses their interface.
struct InterfaceSite {
  std::array<float, 3> position_mm;
  std::array<float, 3> normal;  ///< unit, points into `a`; zero where the field is flat
  MaterialId a = 0, b = 0;      ///< labels of the lower and the upper node of the edge

  [[nodiscard]] Vec3 point() const { return {position_mm[0], position_mm[1], position_mm[2]}; }

  /// Unit normal into material `m`; zero when the site does not bound it.
  [[nodiscard]] Vec3 normal_into(MaterialId m) const {
    const double sign = m == a ? 1 : m == b ? -1 : 0;
    return {sign * normal[0], sign * normal[1], sign * normal[2]};
  }
};

/// All sites of a grid: first those on x edges, then y, then z. The sites on the edges of one grid
/// line along an axis lie together, in ascending order along it.
struct InterfaceSites {
  std::vector<InterfaceSite> sites;
  /// Per axis: the sites of line n are `first[n] .. first[n + 1] - 1`; lines along x are numbered
  /// k ny + j, along y k nx + i, along z j nx + i.
  std::array<std::vector<std::int32_t>, 3> first;
};

/// The sub-voxel sites of the smoothed zero sets, between grid nodes only: the faces of the box
/// have none. Linear in the number of voxels.
InterfaceSites find_interface_sites(const LevelSets& level_sets);

/// The nearest site of every voxel centre, as an index into `sites.sites` (-1 if there is none).
///
/// Exact for these sites, linear in the number of voxels: sites on edges of one axis lie on lattice
/// planes of the two others, so each of the three families is separable, with a lower envelope of
/// parabolas per line [Meijster 2000, Felzenszwalb 2012].
/// @note  4 bytes per voxel, plus two slices per thread
Grid<std::int32_t> nearest_sites(const GridFrame& frame, const InterfaceSites& sites);

}  // namespace cvmesh
