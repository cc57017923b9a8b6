// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/labels/label_volume.h"

#include <cstdint>
#include <vector>

namespace cvmesh {

/// Connected components of all materials (the exterior left out) on the 14-neighbour lattice, held
/// as runs of equal voxels along x: memory follows the number of runs, not of voxels.
struct LatticeComponents {
  /// Voxels [begin, end) of one row, all of `material`.
  struct Run {
    std::int32_t begin = 0, end = 0;
    MaterialId material = kExterior;
  };

  std::vector<Run> runs;                    ///< row after row, x ascending inside each
  std::vector<std::size_t> first_of_row;    ///< row k * ny + j -> its first run; one entry more
  std::vector<std::uint32_t> component_of;  ///< per run; components are numbered by first voxel
  std::vector<MaterialId> material_of;      ///< per component
  std::vector<std::size_t> voxels_of;       ///< per component

  [[nodiscard]] std::size_t component_count() const { return material_of.size(); }

  /// The run that holds voxel (x, row), or -1 where the voxel is exterior.
  [[nodiscard]] std::int64_t run_at(std::size_t row, std::int32_t x) const;
};

/// Labels the components of `ids` by runs and union-find. Linear in the number of voxels.
LatticeComponents find_lattice_components(const Grid<MaterialId>& ids);

}  // namespace cvmesh
