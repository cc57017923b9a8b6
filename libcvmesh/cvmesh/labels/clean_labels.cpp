// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/labels/clean_labels.h"

#include "cvmesh/core/error.h"
#include "cvmesh/core/parallel.h"
#include "cvmesh/labels/lattice_components.h"

#include <spdlog/fmt/fmt.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <limits>
#include <set>
#include <utility>

namespace cvmesh {
namespace {

constexpr char kStage[] = "labels";
constexpr std::size_t kMaxLabels = std::numeric_limits<MaterialId>::max() - 1;

template <typename Value>
using Counts = std::map<Value, std::size_t>;

// Voxels of each value, ascending.
template <typename Value>
Counts<Value> count_values(const Grid<Value>& grid) {
  const std::size_t slice = static_cast<std::size_t>(grid.frame.dims[0]) * grid.frame.dims[1];
  return deterministic_reduce(
      0, static_cast<std::size_t>(grid.frame.dims[2]), Counts<Value>{},
      [&](std::size_t k) {
        Counts<Value> counts;
        const Value* voxel = grid.values.data() + k * slice;
        for (std::size_t i = 0; i < slice;) {
          const std::size_t begin = i;
          while (i < slice && voxel[i] == voxel[begin])
            ++i;
          counts[voxel[begin]] += i - begin;
        }
        return counts;
      },
      [](Counts<Value> a, const Counts<Value>& b) {
        for (const auto& [value, count] : b)
          a[value] += count;
        return a;
      },
      8);
}

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

std::string names_of(const std::vector<Label>& labels) {
  constexpr std::size_t kShown = 20;
  std::string text;
  for (std::size_t i = 0; i < labels.size() && i < kShown; ++i) {
    text += (i > 0 ? ", " : "") + std::to_string(labels[i]);
  }
  return labels.size() > kShown ? text + ", ..." : text;
}

// Refuses a label that no voxel has; `place` is the key that names it.
void require_present(Label label, const std::string& place, const Counts<Label>& counts) {
  if (counts.count(label) > 0) return;
  std::vector<Label> present;
  for (const auto& [other, count] : counts)
    present.push_back(other);
  throw Error(ErrorCode::BadParameter, kStage,
              fmt::format("{} names label {}, which is not in the volume; it has {}", place, label,
                          names_of(present)));
}

void check_region(const VoxelBox& region, const std::array<int, 3>& dims) {
  for (int axis = 0; axis < 3; ++axis) {
    const char name = "ijk"[axis];
    require(region.lo[axis] <= region.hi[axis], ErrorCode::BadParameter, kStage,
            fmt::format("region_of_interest begins at {0} = {1} and ends at {0} = {2}; give the "
                        "first voxel, then the last",
                        name, region.lo[axis], region.hi[axis]));
    const int outside = region.lo[axis] < 0 ? region.lo[axis] : region.hi[axis];
    require(outside >= 0 && outside < dims[axis], ErrorCode::BadParameter, kStage,
            fmt::format("region_of_interest reaches {0} = {1}, outside the volume of {2} x {3} x "
                        "{4} voxels; keep {0} between 0 and {5}",
                        name, outside, dims[0], dims[1], dims[2], dims[axis] - 1));
  }
}

void check_drops(const CleanLabelsOptions& options, const Counts<Label>& counts) {
  for (const Label label : options.drop_labels) {
    require(label != 0, ErrorCode::BadParameter, kStage,
            "drop_labels names label 0, which is the background already; remove it from the list");
    require_present(label, "drop_labels", counts);
  }
}

// The options with `keep_labels` turned into `drop_labels`: the labels that it does not name, nor
// merges into one that it names.
CleanLabelsOptions with_drops(const CleanLabelsOptions& given, const Counts<Label>& counts) {
  if (given.keep_labels.empty()) return given;
  require(given.drop_labels.empty(), ErrorCode::BadParameter, kStage,
          fmt::format("keep_labels ({}) and drop_labels ({}) are both given; one of them says it "
                      "all: remove the other",
                      names_of(given.keep_labels), names_of(given.drop_labels)));
  std::set<Label> kept;
  for (const Label label : given.keep_labels) {
    require(label != 0, ErrorCode::BadParameter, kStage,
            "keep_labels names label 0, the background; use mesh_background to mesh it");
    const auto merge = given.merge_labels.find(label);
    if (merge == given.merge_labels.end()) {
      require_present(label, "keep_labels", counts);
    } else {
      kept.insert(merge->second.begin(), merge->second.end());
    }
    kept.insert(label);
  }
  CleanLabelsOptions options = given;
  for (const auto& [target, sources] : given.merge_labels)
    if (kept.count(target) == 0) options.merge_labels.erase(target);
  for (const auto& [label, count] : counts)
    if (label != 0 && kept.count(label) == 0) options.drop_labels.push_back(label);
  return options;
}

void check_merges(const CleanLabelsOptions& options, const Counts<Label>& counts) {
  std::map<Label, std::string> place_of;
  for (const Label label : options.drop_labels)
    place_of[label] = "drop_labels";
  const auto name_once = [&](Label label, const std::string& place) {
    const auto [entry, is_new] = place_of.try_emplace(label, place);
    require(is_new, ErrorCode::BadParameter, kStage,
            fmt::format("label {} is named by {} and again by {}; name it in one place", label,
                        entry->second, place));
  };
  for (const auto& [target, sources] : options.merge_labels) {
    const std::string place = fmt::format("merge_labels.{}", target);
    require(
        !sources.empty(), ErrorCode::BadParameter, kStage,
        fmt::format("{} is empty; list the labels that become {}, or remove it", place, target));
    require(target != 0, ErrorCode::BadParameter, kStage,
            fmt::format("{} turns labels {} into the background; use drop_labels for that", place,
                        names_of(sources)));
    name_once(target, place);
    for (const Label source : sources) {
      require(source != 0, ErrorCode::BadParameter, kStage,
              fmt::format("{} names label 0, the background, which no label takes in; remove it, "
                          "and use drop_labels to turn labels into background",
                          place));
      require_present(source, place, counts);
      name_once(source, place);
    }
  }
}

void check_input(const InputVolume& input,
                 const Counts<Label>& counts,
                 const CleanLabelsOptions& options) {
  require(counts.size() >= 2, ErrorCode::BadInput, kStage,
          "all voxels have the label " + std::to_string(counts.begin()->first) +
              "; a mesh needs at least two labels (0 is the exterior)");
  if (options.region_of_interest) check_region(*options.region_of_interest, input.frame.dims);
  check_merges(options, counts);
  check_drops(options, counts);
}

std::string name_of(Label label, const CleanLabelsOptions& options) {
  const auto found = options.names.find(label);
  return found != options.names.end() ? found->second : "label_" + std::to_string(label);
}

// One account per label of the input and of the result, ascending, with what is to happen to it.
std::vector<LabelAccount> open_accounts(const Counts<Label>& counts,
                                        const CleanLabelsOptions& options) {
  std::map<Label, LabelAccount> accounts;
  for (const auto& [label, count] : counts)
    accounts[label].voxels_in = count;
  for (const auto& [target, sources] : options.merge_labels) {
    accounts[target];
    for (const Label source : sources)
      accounts[source].merged_into = target;
  }
  for (const Label label : options.drop_labels)
    accounts[label].is_dropped = true;
  // Dropped labels need a background to go to, even where the input has none.
  if (!options.mesh_background)
    accounts.erase(0);
  else if (!options.drop_labels.empty())
    accounts[0];

  require(accounts.size() <= kMaxLabels, ErrorCode::BadInput, kStage,
          fmt::format("the volume has {} labels, more than {}; is it an image rather than a "
                      "segmentation?",
                      accounts.size(), kMaxLabels));
  std::vector<LabelAccount> result;
  for (auto& [label, account] : accounts) {
    account.label = label;
    account.name = name_of(label, options);
    result.push_back(std::move(account));
  }
  return result;
}

// The content of the input; the id of a label is the index of its account plus one.
LabelVolume number_labels(const InputVolume& input,
                          const std::vector<LabelAccount>& accounts,
                          bool has_exterior) {
  LabelVolume labels;
  labels.label_of = {0};
  for (const LabelAccount& account : accounts)
    labels.label_of.push_back(account.label);
  const VoxelBox box =
      padded_content(input, [&](Label label) { return !has_exterior || label != 0; });
  labels.ids = cut_out(input, box, [&] { return IdLookup(labels.label_of); });
  labels.input_dims = input.frame.dims;
  labels.first_voxel = box.lo;
  return labels;
}

// Cuts off what is outside `box`, which is in indices of the working grid.
void crop(LabelVolume& labels, const VoxelBox& box) {
  if (box.dims() == labels.frame().dims) return;
  for (int axis = 0; axis < 3; ++axis)
    labels.first_voxel[axis] += box.lo[axis];
  labels.ids = cut_out(labels.ids, box, [] { return [](MaterialId m) { return m; }; });
}

// What of the options takes labels away, for messages: "region_of_interest and drop_labels".
std::string removers(const CleanLabelsOptions& options) {
  std::vector<std::string> words;
  if (options.region_of_interest) words.emplace_back("region_of_interest");
  if (!options.merge_labels.empty()) words.emplace_back("merge_labels");
  if (!options.drop_labels.empty())
    words.emplace_back(options.keep_labels.empty() ? "drop_labels" : "keep_labels");
  if (options.min_hole_voxels > 1) words.emplace_back("min_hole_voxels");
  return fmt::format("{}", fmt::join(words, " and "));
}

[[noreturn]] void refuse_empty(const CleanLabelsOptions& options) {
  throw Error(ErrorCode::BadInput, kStage,
              fmt::format("no label to mesh is left by {}; take less away", removers(options)));
}

// Cuts off what is outside the region of interest, and marks the labels that have no voxel in it.
void cut_to_region(LabelVolume& labels,
                   const CleanLabelsOptions& options,
                   std::vector<LabelAccount>& accounts,
                   const StageContext& context) {
  VoxelBox box = *options.region_of_interest;
  for (int axis = 0; axis < 3; ++axis) {
    box.lo[axis] -= labels.first_voxel[axis];
    box.hi[axis] -= labels.first_voxel[axis];
  }
  const auto& dims = labels.frame().dims;
  box = common_part(box, {{0, 0, 0}, {dims[0] - 1, dims[1] - 1, dims[2] - 1}});
  if (box.is_empty()) refuse_empty(options);
  crop(labels, box);

  const Counts<MaterialId> inside = count_values(labels.ids);
  std::vector<Label> outside;
  for (std::size_t a = 0; a < accounts.size(); ++a) {
    if (accounts[a].voxels_in == 0 || inside.count(static_cast<MaterialId>(a + 1)) > 0) continue;
    accounts[a].is_outside_region = true;
    outside.push_back(accounts[a].label);
  }
  if (!outside.empty())
    context.log->warn("labels: without a voxel inside region_of_interest: label {}",
                      names_of(outside));
}

// Gives the materials other ids in place: `label_of` is the new table, `new_id[id]` the new id.
void renumber(LabelVolume& labels,
              std::vector<Label> label_of,
              const std::vector<MaterialId>& new_id) {
  parallel_for_each_index(
      0, labels.ids.values.size(),
      [&](std::size_t i) { labels.ids.values[i] = new_id[labels.ids.values[i]]; }, 65536);
  labels.label_of = std::move(label_of);
}

// The label that the voxels of an account have after merges and drops.
Label label_after(const LabelAccount& account) {
  return account.is_dropped ? 0 : account.merged_into.value_or(account.label);
}

// Dropped labels become the background, which is the exterior unless it is meshed.
void merge_and_drop(LabelVolume& labels,
                    const std::vector<LabelAccount>& accounts,
                    bool mesh_background) {
  std::set<Label> left;
  for (const LabelAccount& account : accounts) {
    if (label_after(account) != 0 || mesh_background) left.insert(label_after(account));
  }
  if (left.size() == accounts.size()) return;
  std::vector<Label> label_of{0};
  label_of.insert(label_of.end(), left.begin(), left.end());
  IdLookup id_of(label_of);
  std::vector<MaterialId> new_id{kExterior};
  for (const LabelAccount& account : accounts)
    new_id.push_back(id_of(label_after(account)));
  renumber(labels, label_of, new_id);
}

MaterialId background_of(const LabelVolume& labels) {
  return IdLookup(labels.label_of)(0);
}

std::size_t voxels_of(const std::vector<RemovedComponent>& removed) {
  std::size_t voxels = 0;
  for (const RemovedComponent& component : removed)
    voxels += component.voxels;
  return voxels;
}

// Per material id; nothing is counted of the exterior.
struct MaterialCounts {
  std::vector<std::size_t> voxels, components;
};

MaterialCounts count_materials(const LabelVolume& labels) {
  const LatticeComponents components = find_lattice_components(labels.ids);
  MaterialCounts counts{std::vector<std::size_t>(labels.material_count(), 0),
                        std::vector<std::size_t>(labels.material_count(), 0)};
  for (std::size_t c = 0; c < components.component_count(); ++c) {
    counts.voxels[components.material_of[c]] += components.voxels_of[c];
    ++counts.components[components.material_of[c]];
  }
  return counts;
}

// Takes materials without a voxel out of the table: the region of interest or the filling of holes
// may leave such. @throws Error BadInput when less than two labels are left, the exterior included
void drop_empty_materials(LabelVolume& labels,
                          const MaterialCounts& counts,
                          const CleanLabelsOptions& options) {
  std::vector<Label> label_of{0};
  std::vector<MaterialId> new_id(labels.material_count(), kExterior);
  std::size_t meshed = 0;
  for (std::size_t m = 1; m < labels.material_count(); ++m) {
    if (counts.voxels[m] == 0) continue;
    new_id[m] = static_cast<MaterialId>(label_of.size());
    label_of.push_back(labels.label_of[m]);
    meshed += counts.voxels[m];
  }
  if (label_of.size() == 1) refuse_empty(options);
  require(label_of.size() > 2 || meshed < labels.frame().size(), ErrorCode::BadInput, kStage,
          fmt::format("only label {} is left by {}; a mesh needs at least two labels (0 is the "
                      "exterior), so take less away",
                      label_of[1], removers(options)));
  if (label_of.size() < labels.material_count()) renumber(labels, label_of, new_id);
}

}  // namespace

CleanLabelsResult clean_labels(const InputVolume& input,
                               const CleanLabelsOptions& given,
                               const StageContext& context) {
  CleanLabelsResult result;
  LabelVolume& labels = result.labels;
  CleanLabelsStats& stats = result.stats;
  require(input.frame.size() > 0 && input.values.size() == input.frame.size(), ErrorCode::BadInput,
          kStage, "the label volume has no voxels");
  const Counts<Label> counts = count_values(input);
  const CleanLabelsOptions options = with_drops(given, counts);
  check_input(input, counts, options);
  stats.accounts = open_accounts(counts, options);
  report_progress(context, kStage, 0.2);

  labels = number_labels(input, stats.accounts, counts.count(0) > 0 && !options.mesh_background);
  report_progress(context, kStage, 0.4);

  const MaterialCounts counts_in = count_materials(labels);
  for (std::size_t a = 0; a < stats.accounts.size(); ++a)
    stats.accounts[a].components_in = counts_in.components[a + 1];
  if (options.region_of_interest) cut_to_region(labels, options, stats.accounts, context);
  merge_and_drop(labels, stats.accounts, options.mesh_background);
  report_progress(context, kStage, 0.6);

  stats.islands = remove_islands(labels, options.min_island_voxels);
  stats.islands_removed = stats.islands.size();
  stats.island_voxels = voxels_of(stats.islands);
  stats.holes = fill_holes(labels, background_of(labels), options.min_hole_voxels);
  stats.holes_filled = stats.holes.size();
  stats.hole_voxels = voxels_of(stats.holes);
  report_progress(context, kStage, 0.9);

  const MaterialCounts counts_kept = count_materials(labels);
  IdLookup id_of(labels.label_of);
  for (LabelAccount& account : stats.accounts) {
    const MaterialId id = id_of(account.label);
    account.voxels_kept = counts_kept.voxels[id];
    account.components_kept = counts_kept.components[id];
  }
  drop_empty_materials(labels, counts_kept, options);
  // The region of interest, drops and islands may have emptied the rim.
  crop(labels, padded_content(labels.ids, [](MaterialId m) { return m != kExterior; }));
  for (const Label label : labels.label_of)
    labels.name_of.push_back(name_of(label, options));
  labels.name_of[kExterior] = "exterior";

  context.log->debug(
      "labels: {} of {} x {} x {} voxels, {} materials, {} islands removed, {} holes filled",
      labels.frame().size(), input.frame.dims[0], input.frame.dims[1], input.frame.dims[2],
      labels.material_count() - 1, stats.islands_removed, stats.holes_filled);
  report_progress(context, kStage, 1);
  return result;
}

}  // namespace cvmesh
