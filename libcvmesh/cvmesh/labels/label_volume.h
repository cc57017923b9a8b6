// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/core/label.h"
#include "cvmesh/grid/grid.h"

#include <algorithm>
#include <array>
#include <optional>
#include <string>
#include <vector>

namespace cvmesh {

/// A label volume as a file holds it: one user label per voxel.
using InputVolume = Grid<Label>;

/// Labels on the working grid, as all stages see them.
///
/// The grid is that of the input, cropped to its content plus padding; where it was resampled, a
/// finer one over the same box. Where the content reaches the border of the input or of the region
/// of interest, the crop ends there and the box face (half a voxel outside the last voxel centres)
/// becomes a plane of the mesh.
struct LabelVolume {
  Grid<MaterialId> ids;                     ///< 0 exterior; `ids.frame` is the working grid
  std::vector<Label> label_of;              ///< material id -> user label; [0] stands for exterior
  std::vector<std::string> name_of;         ///< material id -> name for files and reports
  std::array<int, 3> first_voxel{0, 0, 0};  ///< input index of the first voxel of the crop
  std::array<int, 3> input_dims{0, 0, 0};   ///< dims of the input volume

  /// Number of materials, the exterior included.
  [[nodiscard]] std::size_t material_count() const { return label_of.size(); }

  [[nodiscard]] const GridFrame& frame() const { return ids.frame; }

  /// The id of one of the user's labels; nothing where it is not among those to mesh.
  [[nodiscard]] std::optional<MaterialId> material_of(Label label) const {
    const auto found = std::find(label_of.begin() + 1, label_of.end(), label);
    if (found == label_of.end()) return std::nullopt;
    return static_cast<MaterialId>(found - label_of.begin());
  }
};

}  // namespace cvmesh
