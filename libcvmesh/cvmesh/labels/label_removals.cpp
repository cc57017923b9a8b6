// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/labels/label_removals.h"

#include "cvmesh/core/parallel.h"
#include "cvmesh/labels/lattice_components.h"

#include <algorithm>
#include <map>
#include <utility>

namespace cvmesh {
namespace {

// Some components with the runs of each, so that their voxels can be visited.
class ChosenComponents {
 public:
  ChosenComponents(const LatticeComponents& components,
                   const std::vector<std::uint32_t>& chosen,
                   int ny)
      : components_(components), ny_(ny), rows_(chosen.size()), runs_(chosen.size()) {
    std::vector<std::int64_t> slot(components.component_count(), -1);
    for (std::size_t n = 0; n < chosen.size(); ++n)
      slot[chosen[n]] = std::int64_t(n);
    for (std::size_t row = 0; row + 1 < components.first_of_row.size(); ++row) {
      for (std::size_t r = components.first_of_row[row]; r < components.first_of_row[row + 1];
           ++r) {
        const std::int64_t n = slot[components.component_of[r]];
        if (n < 0) continue;
        rows_[n].push_back(row);
        runs_[n].push_back(static_cast<std::uint32_t>(r));
      }
    }
  }

  [[nodiscard]] std::size_t size() const { return runs_.size(); }

  // Calls body(i, j, k) for every voxel of the n-th chosen component, x fastest.
  template <typename Body>
  void for_each_voxel(std::size_t n, const Body& body) const {
    for (std::size_t r = 0; r < runs_[n].size(); ++r) {
      const auto& run = components_.runs[runs_[n][r]];
      const int j = static_cast<int>(rows_[n][r] % ny_), k = static_cast<int>(rows_[n][r] / ny_);
      for (int i = run.begin; i < run.end; ++i)
        body(i, j, k);
    }
  }

  [[nodiscard]] std::array<int, 3> first_voxel(std::size_t n) const {
    const std::size_t row = rows_[n].front();
    return {components_.runs[runs_[n].front()].begin, static_cast<int>(row % ny_),
            static_cast<int>(row / ny_)};
  }

 private:
  const LatticeComponents& components_;
  int ny_;
  std::vector<std::vector<std::size_t>> rows_;
  std::vector<std::vector<std::uint32_t>> runs_;
};

// The material that most of the component's faces touch now; the smaller label breaks ties.
MaterialId best_neighbour(const LabelVolume& labels,
                          const ChosenComponents& chosen,
                          std::size_t n,
                          MaterialId own) {
  static constexpr std::array<std::array<int, 3>, 6> kFaces{
      {{-1, 0, 0}, {1, 0, 0}, {0, -1, 0}, {0, 1, 0}, {0, 0, -1}, {0, 0, 1}}};
  const Grid<MaterialId>& ids = labels.ids;
  std::map<MaterialId, std::size_t> faces;
  chosen.for_each_voxel(n, [&](int i, int j, int k) {
    for (const auto& d : kFaces) {
      const int x = i + d[0], y = j + d[1], z = k + d[2];
      if (ids.frame.contains(x, y, z) && ids(x, y, z) != own) ++faces[ids(x, y, z)];
    }
  });
  MaterialId best = own;
  std::size_t best_count = 0;
  for (const auto& [material, count] : faces) {
    const bool is_smaller = labels.label_of[material] < labels.label_of[best];
    if (count > best_count || (count == best_count && is_smaller)) {
      best = material;
      best_count = count;
    }
  }
  return best;
}

RemovedComponent give_away(LabelVolume& labels, const ChosenComponents& chosen, std::size_t n) {
  const auto [i0, j0, k0] = chosen.first_voxel(n);
  const MaterialId own = labels.ids(i0, j0, k0);
  const MaterialId heir = best_neighbour(labels, chosen, n, own);
  RemovedComponent removed{.label = labels.label_of[own],
                           .given_to = labels.label_of[heir],
                           .first_voxel = {labels.first_voxel[0] + i0, labels.first_voxel[1] + j0,
                                           labels.first_voxel[2] + k0}};
  chosen.for_each_voxel(n, [&](int i, int j, int k) {
    labels.ids(i, j, k) = heir;
    ++removed.voxels;
  });
  return removed;
}

// Components below the bound, smallest first; never the largest of a material.
std::vector<std::uint32_t> find_islands(const LatticeComponents& components,
                                        std::size_t min_voxels) {
  std::map<MaterialId, std::uint32_t> largest;
  const auto count = static_cast<std::uint32_t>(components.component_count());
  for (std::uint32_t c = 0; c < count; ++c) {
    const auto [entry, is_new] = largest.try_emplace(components.material_of[c], c);
    if (components.voxels_of[c] > components.voxels_of[entry->second]) entry->second = c;
  }
  std::vector<std::uint32_t> islands;
  for (std::uint32_t c = 0; c < count; ++c) {
    if (components.voxels_of[c] < min_voxels && largest.at(components.material_of[c]) != c) {
      islands.push_back(c);
    }
  }
  std::sort(islands.begin(), islands.end(), [&](std::uint32_t a, std::uint32_t b) {
    return std::pair(components.voxels_of[a], a) < std::pair(components.voxels_of[b], b);
  });
  return islands;
}

// Gives islands away, one pass; an island that grew on the way is left to the next pass.
class IslandPass {
 public:
  IslandPass(LabelVolume& labels, const LatticeComponents& components, std::size_t min_voxels)
      : labels_(labels),
        components_(components),
        islands_(find_islands(components, min_voxels)),
        chosen_(components, islands_, labels.frame().dims[1]),
        is_touched_(components.component_count(), false) {}

  void run(std::vector<RemovedComponent>& removed) {
    for (std::size_t n = 0; n < islands_.size(); ++n) {
      if (is_touched_[islands_[n]]) {
        needs_another_pass_ = true;
        continue;
      }
      removed.push_back(give_away(labels_, chosen_, n));
      const auto [i0, j0, k0] = chosen_.first_voxel(n);
      const MaterialId heir = labels_.ids(i0, j0, k0);
      if (heir == kExterior) continue;
      chosen_.for_each_voxel(n, [&](int i, int j, int k) { touch_neighbours(i, j, k, heir); });
    }
  }

  [[nodiscard]] bool needs_another_pass() const { return needs_another_pass_; }

 private:
  // Marks the components of `material` that a voxel joins on the 14-neighbour lattice.
  void touch_neighbours(int i, int j, int k, MaterialId material) {
    const Grid<MaterialId>& ids = labels_.ids;
    for (int corner = 1; corner < 8; ++corner) {
      for (const int sign : {-1, 1}) {
        const int x = i + sign * (corner & 1), y = j + sign * (corner >> 1 & 1),
                  z = k + sign * (corner >> 2);
        if (!ids.frame.contains(x, y, z) || ids(x, y, z) != material) continue;
        const std::size_t row = static_cast<std::size_t>(z) * ids.frame.dims[1] + y;
        const std::int64_t run = components_.run_at(row, x);
        if (run >= 0) is_touched_[components_.component_of[run]] = true;
      }
    }
  }

  LabelVolume& labels_;
  const LatticeComponents& components_;
  std::vector<std::uint32_t> islands_;
  ChosenComponents chosen_;
  std::vector<bool> is_touched_;
  bool needs_another_pass_ = false;
};

// The components of one material, which may be the exterior.
LatticeComponents components_of(const Grid<MaterialId>& ids, MaterialId material) {
  Grid<MaterialId> mask(ids.frame);
  parallel_for_each_index(
      0, ids.values.size(),
      [&](std::size_t i) { mask.values[i] = ids.values[i] == material ? 1 : kExterior; }, 65536);
  return find_lattice_components(mask);
}

// Per component: has it a voxel in the outermost layer of the grid?
std::vector<bool> touches_border(const LatticeComponents& components,
                                 const std::array<int, 3>& dims) {
  const auto [nx, ny, nz] = dims;
  std::vector<bool> result(components.component_count(), false);
  for (std::size_t row = 0; row + 1 < components.first_of_row.size(); ++row) {
    const int j = static_cast<int>(row % ny), k = static_cast<int>(row / ny);
    const bool is_outer_row = j == 0 || k == 0 || j + 1 == ny || k + 1 == nz;
    for (std::size_t r = components.first_of_row[row]; r < components.first_of_row[row + 1]; ++r) {
      const auto& run = components.runs[r];
      if (is_outer_row || run.begin == 0 || run.end == nx)
        result[components.component_of[r]] = true;
    }
  }
  return result;
}

}  // namespace

std::vector<RemovedComponent> remove_islands(LabelVolume& labels, std::size_t min_voxels) {
  std::vector<RemovedComponent> removed;
  bool needs_pass = min_voxels > 1;
  while (needs_pass) {
    const LatticeComponents components = find_lattice_components(labels.ids);
    IslandPass pass(labels, components, min_voxels);
    pass.run(removed);
    needs_pass = pass.needs_another_pass();
  }
  return removed;
}

std::vector<RemovedComponent> fill_holes(LabelVolume& labels,
                                         MaterialId background,
                                         std::size_t min_voxels) {
  if (min_voxels <= 1) return {};
  const LatticeComponents components = components_of(labels.ids, background);
  const std::vector<bool> is_open = touches_border(components, labels.frame().dims);
  std::vector<std::uint32_t> holes;
  for (std::uint32_t c = 0; c < components.component_count(); ++c) {
    if (!is_open[c] && components.voxels_of[c] < min_voxels) holes.push_back(c);
  }
  const ChosenComponents chosen(components, holes, labels.frame().dims[1]);
  std::vector<RemovedComponent> filled;
  for (std::size_t n = 0; n < chosen.size(); ++n)
    filled.push_back(give_away(labels, chosen, n));
  return filled;
}

}  // namespace cvmesh
