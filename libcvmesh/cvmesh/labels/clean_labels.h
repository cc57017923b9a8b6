// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/core/context.h"
#include "cvmesh/labels/label_volume.h"

#include <cstddef>
#include <map>
#include <string>
#include <vector>

namespace cvmesh {

struct CleanLabelsOptions {
  std::size_t min_island_voxels = 1;   ///< smaller components go to a neighbour; 1 removes nothing
  bool mesh_background = false;        ///< label 0 becomes a material like the others
  std::vector<Label> drop_labels;      ///< these become background
  std::map<Label, std::string> names;  ///< label -> name; others are called "label_<value>"
};

/// What happened to one label of the input.
struct LabelAccount {
  Label label = 0;
  std::string name;
  std::size_t voxels_in = 0, voxels_kept = 0;
  std::size_t components_in = 0, components_kept = 0;  ///< 14-neighbour components
  bool is_dropped = false;                             ///< by `drop_labels`
};

struct CleanLabelsStats {
  std::vector<LabelAccount> accounts;  ///< ascending label, label 0 only if it is meshed
  std::size_t islands_removed = 0, island_voxels = 0;
};

struct CleanLabelsResult {
  LabelVolume labels;
  CleanLabelsStats stats;
};

/// The label volume on the working grid: dropped labels and islands gone, cropped to the content
/// plus one voxel of exterior (where the input has it), values replaced by compact material ids.
///
/// Components are those of the 14-neighbour (Freudenthal) lattice, design invariant 4. Islands go,
/// smallest first, to the label they share most voxel faces with (ties: the smaller label); the
/// largest component of a label is never an island. A volume without label 0 has no exterior voxel
/// at all and is meshed to its box.
/// @throws Error BadInput when fewer than two labels are present, nothing is left to mesh, or
///         there are more than 65,534 labels; BadParameter when a label in `drop_labels` is absent
CleanLabelsResult clean_labels(const InputVolume& input,
                               const CleanLabelsOptions& options,
                               const StageContext& context);

}  // namespace cvmesh
