// SPDX-License-Identifier: AGPL-3.0-or-later
#include "surface/dense_phantoms.h"

#include "cvmesh/core/random.h"
#include "cvmesh/labels/clean_labels.h"
#include "cvmesh/levelset/build_level_sets.h"
#include "cvmesh/levelset/tighten.h"
#include "cvmesh/mesh/validate.h"
#include "cvmesh/pipeline/dense_surfaces.h"

#include "support/catch.h"
#include <cmath>
#include <memory>
#include <utility>

namespace cvmesh::dense_phantoms {

DensePhantom make(const InputVolume& volume) {
  const StageContext context = silent_context();
  LabelVolume labels = clean_labels(volume, {}, context).labels;
  DensePhantom phantom;
  phantom.material_count = labels.material_count();
  phantom.voxel_mm = labels.frame().voxel_mm();
  const auto ids = std::make_shared<const Grid<MaterialId>>(std::move(labels.ids));
  LevelSets level_sets = build_level_sets(ids, phantom.material_count, context).level_sets;
  level_sets = tighten(std::move(level_sets), {}, context).level_sets;
  Dense dense = make_dense_surfaces(level_sets, context);
  phantom.mesh = std::move(dense.mesh);
  phantom.strata = std::move(dense.strata);
  return phantom;
}

std::vector<bool> random_choice(const Strata& strata, double share, std::uint64_t seed) {
  const CounterRandom random(seed, "test");
  std::vector<bool> keep(strata.dimension.size());
  for (std::size_t v = 0; v < keep.size(); ++v) {
    const double chance = strata.dimension[v] == 2 ? share : std::sqrt(share);
    keep[v] = strata.dimension[v] == 0 || random.uniform(v) < chance;
  }
  return keep;
}

void require_same_topology(const InterfaceMesh& mesh, const DensePhantom& dense) {
  const Validation validation = validate(mesh, dense.material_count);
  INFO(validation.summary());
  REQUIRE(validation.is_valid());
  REQUIRE(find_intersections(mesh).empty());
  const auto is = boundary_topology(mesh, dense.material_count);
  const auto was = boundary_topology(dense.mesh, dense.material_count);
  for (std::size_t m = 0; m < dense.material_count; ++m) {
    CAPTURE(m);
    REQUIRE(is[m].components == was[m].components);
    REQUIRE(is[m].euler == was[m].euler);
  }
}

}  // namespace cvmesh::dense_phantoms
