// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/core/context.h"
#include "cvmesh/labels/label_removals.h"
#include "cvmesh/labels/label_volume.h"
#include "cvmesh/labels/voxel_box.h"

#include <cstddef>
#include <map>
#include <optional>
#include <string>
#include <vector>

namespace cvmesh {

struct CleanLabelsOptions {
  std::size_t min_island_voxels = 1;  ///< smaller components go to a neighbour; 1 removes nothing
  std::size_t min_hole_voxels = 0;    ///< smaller holes of the background are filled; 0 fills none
  bool mesh_background = false;       ///< label 0 becomes a material like the others
  std::optional<VoxelBox> region_of_interest;        ///< input indices; the rest is cut off
  std::map<Label, std::vector<Label>> merge_labels;  ///< label that stays -> labels that become it
  std::vector<Label> drop_labels;                    ///< these become background
  std::vector<Label> keep_labels;  ///< if any: all others become background, unless merged into one
  std::map<Label, std::string> names;  ///< label -> name; others are called "label_<value>"
};

/// What happened to one label. What came in is counted on the whole input, what was kept on the
/// result, under the label it has there: nothing is kept of a label that was merged or dropped.
struct LabelAccount {
  Label label = 0;
  std::string name;
  std::size_t voxels_in = 0, voxels_kept = 0;
  std::size_t components_in = 0, components_kept = 0;  ///< 14-neighbour components
  std::optional<Label> merged_into{};                  ///< by `merge_labels`
  bool is_dropped = false;                             ///< by `drop_labels`
  bool is_outside_region = false;  ///< no voxel of it is in the `region_of_interest`
};

struct CleanLabelsStats {
  /// Ascending label, label 0 only if it is meshed; labels that only merges brought included.
  std::vector<LabelAccount> accounts;
  std::size_t islands_removed = 0, island_voxels = 0;
  std::size_t holes_filled = 0, hole_voxels = 0;
  std::vector<RemovedComponent> islands;  ///< in the order in which they went
  std::vector<RemovedComponent> holes;    ///< ascending by first voxel
};

struct CleanLabelsResult {
  LabelVolume labels;
  CleanLabelsStats stats;
};

/// The label volume on the working grid: cut to the region of interest, labels merged and dropped,
/// islands gone, holes filled, in this order; cropped to the content plus one voxel of exterior
/// (where the region has it), values replaced by compact material ids.
///
/// Components are those of the 14-neighbour (Freudenthal) lattice, design invariant 4. Islands go,
/// smallest first, to the label they share most voxel faces with (ties: the smaller label); the
/// largest component of a label is never an island. A hole is a component of label 0 that does not
/// touch the border of the region; it is filled by the same rule. A volume without label 0 has no
/// exterior voxel at all and is meshed to its box; a region of interest is such a box too.
/// Linear in the number of voxels.
/// @throws Error BadInput when fewer than two labels are present or left, nothing is left to mesh,
///         or there are more than 65,534 labels; BadParameter when a label in `drop_labels` or to
///         be merged is absent, a label is named in two places, 0 is merged, or the region is not
///         inside the volume
CleanLabelsResult clean_labels(const InputVolume& input,
                               const CleanLabelsOptions& options,
                               const StageContext& context);

}  // namespace cvmesh
