// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/labels/clean_labels.h"

#include "cvmesh/core/error.h"
#include "cvmesh/core/parallel.h"
#include "cvmesh/labels/lattice_components.h"

#include <spdlog/spdlog.h>

#include <algorithm>
#include <limits>
#include <utility>

namespace cvmesh {
namespace {

constexpr char kStage[] = "labels";
constexpr std::size_t kMaxLabels = std::numeric_limits<MaterialId>::max() - 1;

using Counts = std::map<Label, std::size_t>;

// Voxels of each label, ascending.
Counts count_labels(const InputVolume& input) {
  const std::size_t slice = static_cast<std::size_t>(input.frame.dims[0]) * input.frame.dims[1];
  return deterministic_reduce(
      0, static_cast<std::size_t>(input.frame.dims[2]), Counts{},
      [&](std::size_t k) {
        Counts counts;
        const Label* voxel = input.values.data() + k * slice;
        for (std::size_t i = 0; i < slice;) {
          const std::size_t begin = i;
          while (i < slice && voxel[i] == voxel[begin])
            ++i;
          counts[voxel[begin]] += i - begin;
        }
        return counts;
      },
      [](Counts a, const Counts& b) {
        for (const auto& [label, count] : b)
          a[label] += count;
        return a;
      },
      8);
}

// A box of voxels, both ends included.
struct VoxelBox {
  std::array<int, 3> lo{std::numeric_limits<int>::max(), std::numeric_limits<int>::max(),
                        std::numeric_limits<int>::max()};
  std::array<int, 3> hi{-1, -1, -1};

  void add(const VoxelBox& b) {
    for (int axis = 0; axis < 3; ++axis) {
      lo[axis] = std::min(lo[axis], b.lo[axis]);
      hi[axis] = std::max(hi[axis], b.hi[axis]);
    }
  }

  [[nodiscard]] bool is_empty() const { return hi[0] < 0; }

  [[nodiscard]] std::array<int, 3> dims() const {
    return {hi[0] - lo[0] + 1, hi[1] - lo[1] + 1, hi[2] - lo[2] + 1};
  }
};

// The box of all voxels that `is_content`, with one more layer on each side where the grid has it:
// the layer keeps the exterior's nodes that the interface is interpolated against.
template <typename Value, typename IsContent>
VoxelBox padded_content(const Grid<Value>& grid, const IsContent& is_content) {
  const auto [nx, ny, nz] = grid.frame.dims;
  const auto box_of_slice = [&, nx = nx, ny = ny](std::size_t slice) {
    VoxelBox box;
    const int k = static_cast<int>(slice);
    for (int j = 0; j < ny; ++j) {
      const Value* row = grid.values.data() + grid.frame.linear(0, j, k);
      int first = 0;
      while (first < nx && !is_content(row[first]))
        ++first;
      if (first == nx) continue;
      int last = nx - 1;
      while (!is_content(row[last]))
        --last;
      box.add({{first, j, k}, {last, j, k}});
    }
    return box;
  };
  const auto join = [](VoxelBox a, const VoxelBox& b) {
    a.add(b);
    return a;
  };
  VoxelBox box =
      deterministic_reduce(0, static_cast<std::size_t>(nz), VoxelBox{}, box_of_slice, join, 8);
  if (box.is_empty()) return box;
  for (int axis = 0; axis < 3; ++axis) {
    box.lo[axis] = std::max(box.lo[axis] - 1, 0);
    box.hi[axis] = std::min(box.hi[axis] + 1, grid.frame.dims[axis] - 1);
  }
  return box;
}

// The part of `grid` inside `box`, each value passed through `convert`, whose calls for the voxels
// of one row come in order.
template <typename Value, typename MakeConvert>
Grid<MaterialId> cut_out(const Grid<Value>& grid,
                         const VoxelBox& box,
                         const MakeConvert& make_convert) {
  Grid<MaterialId> result(cropped(grid.frame, box.lo, box.dims()));
  const auto [nx, ny, nz] = result.frame.dims;
  parallel_for_each_index(
      0, static_cast<std::size_t>(ny) * nz,
      [&, nx = nx, ny = ny](std::size_t row) {
        const int j = static_cast<int>(row % ny), k = static_cast<int>(row / ny);
        const Value* from =
            grid.values.data() + grid.frame.linear(box.lo[0], box.lo[1] + j, box.lo[2] + k);
        MaterialId* to = result.values.data() + row * nx;
        auto convert = make_convert();
        for (int i = 0; i < nx; ++i)
          to[i] = convert(from[i]);
      },
      64);
  return result;
}

// From a label to its id, remembering the last answer: neighbouring voxels mostly agree.
class IdLookup {
 public:
  explicit IdLookup(const std::vector<Label>& label_of) : label_of_(&label_of) {}

  MaterialId operator()(Label label) {
    if (!is_known_ || label != last_label_) {
      const auto found = std::lower_bound(label_of_->begin() + 1, label_of_->end(), label);
      const bool is_material = found != label_of_->end() && *found == label;
      last_id_ = is_material ? static_cast<MaterialId>(found - label_of_->begin()) : kExterior;
      last_label_ = label;
      is_known_ = true;
    }
    return last_id_;
  }

 private:
  const std::vector<Label>* label_of_;
  Label last_label_ = 0;
  MaterialId last_id_ = kExterior;
  bool is_known_ = false;
};

// Replaces ids by `new_id[id]` in place.
void renumber(Grid<MaterialId>& ids, const std::vector<MaterialId>& new_id) {
  parallel_for_each_index(
      0, ids.values.size(), [&](std::size_t i) { ids.values[i] = new_id[ids.values[i]]; }, 65536);
}

// Calls body(i, j, k) for every voxel of the runs listed.
template <typename Body>
void for_each_voxel(const LatticeComponents& components,
                    const std::vector<std::size_t>& rows,
                    const std::vector<std::uint32_t>& runs,
                    int ny,
                    const Body& body) {
  for (std::size_t n = 0; n < runs.size(); ++n) {
    const auto& run = components.runs[runs[n]];
    const int j = static_cast<int>(rows[n] % ny), k = static_cast<int>(rows[n] / ny);
    for (int i = run.begin; i < run.end; ++i)
      body(i, j, k);
  }
}

// Gives islands away, one pass; an island that grew on the way is left to the next pass.
class IslandPass {
 public:
  IslandPass(Grid<MaterialId>& ids,
             const LatticeComponents& components,
             const std::vector<Label>& label_of,
             std::size_t min_voxels)
      : ids_(ids),
        components_(components),
        label_of_(label_of),
        is_touched_(components.component_count(), false) {
    find_islands(min_voxels);
    list_runs();
  }

  void run(CleanLabelsStats& stats) {
    for (std::size_t n = 0; n < islands_.size(); ++n) {
      if (is_touched_[islands_[n]]) {
        needs_another_pass_ = true;
        continue;
      }
      give_away(n);
      ++stats.islands_removed;
      stats.island_voxels += components_.voxels_of[islands_[n]];
    }
  }

  [[nodiscard]] bool needs_another_pass() const { return needs_another_pass_; }

  [[nodiscard]] bool is_empty() const { return islands_.empty(); }

 private:
  // Components below the bound, smallest first; never the largest of a material.
  void find_islands(std::size_t min_voxels) {
    std::map<MaterialId, std::uint32_t> largest;
    const auto count = static_cast<std::uint32_t>(components_.component_count());
    for (std::uint32_t c = 0; c < count; ++c) {
      const auto [entry, is_new] = largest.try_emplace(components_.material_of[c], c);
      if (components_.voxels_of[c] > components_.voxels_of[entry->second]) entry->second = c;
    }
    for (std::uint32_t c = 0; c < count; ++c) {
      if (components_.voxels_of[c] < min_voxels && largest.at(components_.material_of[c]) != c) {
        islands_.push_back(c);
      }
    }
    std::sort(islands_.begin(), islands_.end(), [&](std::uint32_t a, std::uint32_t b) {
      return std::pair(components_.voxels_of[a], a) < std::pair(components_.voxels_of[b], b);
    });
  }

  void list_runs() {
    std::vector<std::int64_t> slot(components_.component_count(), -1);
    for (std::size_t n = 0; n < islands_.size(); ++n)
      slot[islands_[n]] = std::int64_t(n);
    rows_.resize(islands_.size());
    runs_.resize(islands_.size());
    for (std::size_t row = 0; row + 1 < components_.first_of_row.size(); ++row) {
      for (std::size_t r = components_.first_of_row[row]; r < components_.first_of_row[row + 1];
           ++r) {
        const std::int64_t n = slot[components_.component_of[r]];
        if (n < 0) continue;
        rows_[n].push_back(row);
        runs_[n].push_back(static_cast<std::uint32_t>(r));
      }
    }
  }

  // The material that most of the island's faces touch now; the smaller label breaks ties.
  MaterialId best_neighbour(std::size_t n, MaterialId own) const {
    static constexpr std::array<std::array<int, 3>, 6> kFaces{
        {{-1, 0, 0}, {1, 0, 0}, {0, -1, 0}, {0, 1, 0}, {0, 0, -1}, {0, 0, 1}}};
    std::map<MaterialId, std::size_t> faces;
    for_each_voxel(components_, rows_[n], runs_[n], ids_.frame.dims[1], [&](int i, int j, int k) {
      for (const auto& d : kFaces) {
        const int x = i + d[0], y = j + d[1], z = k + d[2];
        if (ids_.frame.contains(x, y, z) && ids_(x, y, z) != own) ++faces[ids_(x, y, z)];
      }
    });
    MaterialId best = own;
    std::size_t best_count = 0;
    for (const auto& [material, count] : faces) {
      const bool is_smaller = label_of_[material] < label_of_[best];
      if (count > best_count || (count == best_count && is_smaller)) {
        best = material;
        best_count = count;
      }
    }
    return best;
  }

  void give_away(std::size_t n) {
    const MaterialId own = components_.material_of[islands_[n]];
    const MaterialId heir = best_neighbour(n, own);
    for_each_voxel(components_, rows_[n], runs_[n], ids_.frame.dims[1], [&](int i, int j, int k) {
      ids_(i, j, k) = heir;
      if (heir != kExterior) touch_neighbours(i, j, k, heir);
    });
  }

  // Marks the components of `material` that a voxel joins on the 14-neighbour lattice.
  void touch_neighbours(int i, int j, int k, MaterialId material) {
    for (int corner = 1; corner < 8; ++corner) {
      for (const int sign : {-1, 1}) {
        const int x = i + sign * (corner & 1), y = j + sign * (corner >> 1 & 1),
                  z = k + sign * (corner >> 2);
        if (!ids_.frame.contains(x, y, z) || ids_(x, y, z) != material) continue;
        const std::size_t row = static_cast<std::size_t>(z) * ids_.frame.dims[1] + y;
        const std::int64_t run = components_.run_at(row, x);
        if (run >= 0) is_touched_[components_.component_of[run]] = true;
      }
    }
  }

  Grid<MaterialId>& ids_;
  const LatticeComponents& components_;
  const std::vector<Label>& label_of_;
  std::vector<bool> is_touched_;
  std::vector<std::uint32_t> islands_;
  std::vector<std::vector<std::size_t>> rows_;
  std::vector<std::vector<std::uint32_t>> runs_;
  bool needs_another_pass_ = false;
};

std::string names_of(const std::vector<Label>& labels) {
  constexpr std::size_t kShown = 20;
  std::string text;
  for (std::size_t i = 0; i < labels.size() && i < kShown; ++i) {
    text += (i > 0 ? ", " : "") + std::to_string(labels[i]);
  }
  return labels.size() > kShown ? text + ", ..." : text;
}

void check_input(const InputVolume& input,
                 const Counts& counts,
                 const CleanLabelsOptions& options) {
  require(input.frame.size() > 0 && input.values.size() == input.frame.size(), ErrorCode::BadInput,
          kStage, "the label volume has no voxels");
  require(counts.size() >= 2, ErrorCode::BadInput, kStage,
          "all voxels have the label " + std::to_string(counts.begin()->first) +
              "; a mesh needs at least two labels (0 is the exterior)");
  require(counts.size() - counts.count(0) <= kMaxLabels, ErrorCode::BadInput, kStage,
          "the volume has " + std::to_string(counts.size()) + " labels, more than " +
              std::to_string(kMaxLabels) + "; is it an image rather than a segmentation?");
  std::vector<Label> present;
  for (const auto& [label, count] : counts)
    present.push_back(label);
  for (const Label label : options.drop_labels) {
    require(label != 0, ErrorCode::BadParameter, kStage,
            "drop_labels names label 0, which is the background already; remove it from the list");
    require(counts.count(label) > 0, ErrorCode::BadParameter, kStage,
            "drop_labels names label " + std::to_string(label) +
                ", which is not in the volume; it has " + names_of(present));
  }
}

std::string name_of(Label label, const CleanLabelsOptions& options) {
  const auto found = options.names.find(label);
  return found != options.names.end() ? found->second : "label_" + std::to_string(label);
}

// label_of for all labels of the input that may become materials: [0] is the exterior.
std::vector<Label> candidate_labels(const Counts& counts, const CleanLabelsOptions& options) {
  std::vector<Label> labels;
  for (const auto& [label, count] : counts) {
    if (label != 0) labels.push_back(label);
  }
  // Dropped labels need a background to go to, even where the input has none.
  if (options.mesh_background && (counts.count(0) > 0 || !options.drop_labels.empty())) {
    labels.insert(std::lower_bound(labels.begin(), labels.end(), 0), 0);
  }
  labels.insert(labels.begin(), 0);
  return labels;
}

// Which id each candidate has in the result; dropped ones become the background.
struct Renumbering {
  std::vector<MaterialId> new_id;
  std::vector<Label> label_of;
};

Renumbering drop(const std::vector<Label>& candidates, const CleanLabelsOptions& options) {
  Renumbering result{std::vector<MaterialId>(candidates.size(), kExterior), {0}};
  MaterialId background = kExterior;
  std::vector<std::size_t> dropped;
  for (std::size_t c = 1; c < candidates.size(); ++c) {
    const Label label = candidates[c];
    const auto& drops = options.drop_labels;
    if (std::find(drops.begin(), drops.end(), label) != drops.end()) {
      dropped.push_back(c);
      continue;
    }
    result.new_id[c] = static_cast<MaterialId>(result.label_of.size());
    if (label == 0) background = result.new_id[c];
    result.label_of.push_back(label);
  }
  for (const std::size_t c : dropped)
    result.new_id[c] = background;
  return result;
}

std::vector<std::size_t> components_per_material(const LatticeComponents& components,
                                                 std::size_t material_count) {
  std::vector<std::size_t> result(material_count, 0);
  for (const MaterialId m : components.material_of)
    ++result[m];
  return result;
}

// Gives away all islands and returns the components of what is left.
LatticeComponents remove_islands(Grid<MaterialId>& ids,
                                 const std::vector<Label>& label_of,
                                 std::size_t min_voxels,
                                 CleanLabelsStats& stats) {
  LatticeComponents components = find_lattice_components(ids);
  while (min_voxels > 1) {
    IslandPass pass(ids, components, label_of, min_voxels);
    if (pass.is_empty()) break;
    pass.run(stats);
    components = find_lattice_components(ids);
    if (!pass.needs_another_pass()) break;
  }
  return components;
}

}  // namespace

CleanLabelsResult clean_labels(const InputVolume& input,
                               const CleanLabelsOptions& options,
                               const StageContext& context) {
  CleanLabelsResult result;
  const Counts counts = count_labels(input);
  check_input(input, counts, options);
  report_progress(context, kStage, 0.2);

  const std::vector<Label> candidates = candidate_labels(counts, options);
  const bool has_exterior = counts.count(0) > 0 && !options.mesh_background;
  VoxelBox box = padded_content(input, [&](Label label) { return !has_exterior || label != 0; });
  Grid<MaterialId> ids = cut_out(input, box, [&] { return IdLookup(candidates); });
  report_progress(context, kStage, 0.4);

  std::vector<std::size_t> components_in =
      components_per_material(find_lattice_components(ids), candidates.size());
  const Renumbering renumbering = drop(candidates, options);
  require(renumbering.label_of.size() > 1, ErrorCode::BadInput, kStage,
          "drop_labels leaves no label to mesh; remove a label from it");
  if (!options.drop_labels.empty()) renumber(ids, renumbering.new_id);
  report_progress(context, kStage, 0.6);
  const LatticeComponents kept =
      remove_islands(ids, renumbering.label_of, options.min_island_voxels, result.stats);
  report_progress(context, kStage, 0.9);

  LabelVolume& labels = result.labels;
  labels.label_of = renumbering.label_of;
  for (const Label label : labels.label_of)
    labels.name_of.push_back(name_of(label, options));
  labels.name_of[kExterior] = "exterior";
  labels.input_dims = input.frame.dims;
  labels.first_voxel = box.lo;

  // Drops and islands may have emptied the rim.
  const VoxelBox rest = padded_content(ids, [](MaterialId m) { return m != kExterior; });
  if (rest.dims() != ids.frame.dims) {
    for (int axis = 0; axis < 3; ++axis)
      labels.first_voxel[axis] += rest.lo[axis];
    ids = cut_out(ids, rest, [] { return [](MaterialId m) { return m; }; });
  }
  labels.ids = std::move(ids);

  const std::size_t materials = labels.material_count();
  const std::vector<std::size_t> components_kept = components_per_material(kept, materials);
  std::vector<std::size_t> voxels_kept(materials, 0);
  for (std::size_t c = 0; c < kept.component_count(); ++c) {
    voxels_kept[kept.material_of[c]] += kept.voxels_of[c];
  }
  for (std::size_t c = 1; c < candidates.size(); ++c) {
    LabelAccount account;
    account.label = candidates[c];
    account.name = name_of(account.label, options);
    const auto count = counts.find(account.label);
    account.voxels_in = count != counts.end() ? count->second : 0;
    account.components_in = components_in[c];
    const MaterialId id = renumbering.new_id[c];
    account.is_dropped = id == kExterior || renumbering.label_of[id] != account.label;
    if (!account.is_dropped) {
      account.voxels_kept = voxels_kept[id];
      account.components_kept = components_kept[id];
    }
    result.stats.accounts.push_back(account);
  }
  context.log->debug("labels: {} of {} x {} x {} voxels, {} materials, {} islands removed",
                     labels.frame().size(), input.frame.dims[0], input.frame.dims[1],
                     input.frame.dims[2], materials - 1, result.stats.islands_removed);
  report_progress(context, kStage, 1);
  return result;
}

}  // namespace cvmesh
