// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/interfaces/extract_interfaces.h"
#include "cvmesh/io/volume_reader.h"
#include "cvmesh/labels/clean_labels.h"
#include "cvmesh/labels/lattice_topology.h"
#include "cvmesh/levelset/build_level_sets.h"
#include "cvmesh/levelset/distance_transform.h"
#include "cvmesh/levelset/tighten.h"
#include "cvmesh/mesh/validate.h"

#include "support/catch.h"
#include "support/test_data.h"
#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <string>
#include <utility>
#include <vector>

using namespace cvmesh;

namespace {

std::optional<LabelVolume> labels_of(const std::string& name) {
  const auto input = test_data::file(name);
  if (!input) {
    WARN("skipped: " << name << " is not there; set CVMESH_TEST_DATA");
    return std::nullopt;
  }
  return clean_labels(read_label_volume(*input), {}, silent_context()).labels;
}

TightenResult tightened(const LabelVolume& labels, double r_vox) {
  auto built = build_level_sets(std::make_shared<const Grid<MaterialId>>(labels.ids),
                                labels.material_count(), silent_context());
  TightenOptions options;
  options.r_vox = r_vox;
  return tighten(std::move(built.level_sets), options, silent_context());
}

/// Every label there, its dense boundary a closed manifold with the topology of its voxels.
void check_topology(const std::string& name, double r_vox) {
  const auto labels = labels_of(name);
  if (!labels) return;
  INFO(name << ", r = " << r_vox);
  const TightenResult result = tightened(*labels, r_vox);
  const InterfaceMesh mesh = extract_interfaces(result.level_sets, silent_context());
  const Validation validation = validate(mesh, labels->material_count());
  INFO(validation.summary());
  CHECK(validation.is_valid());
  const auto voxels = lattice_topology(labels->ids, labels->material_count());
  const auto nodes = lattice_topology(*result.level_sets.labels, labels->material_count());
  const auto boundary = boundary_topology(mesh, labels->material_count());
  for (std::size_t m = 1; m < labels->material_count(); ++m) {
    INFO("label " << labels->label_of[m]);
    CHECK(nodes[m].components == voxels[m].components);
    CHECK(nodes[m].euler == voxels[m].euler);
    CHECK(boundary[m].euler == 2 * voxels[m].euler);
    CHECK(boundary[m].is_closed_manifold);
  }
}

/// Largest distance from a node of material 1 in a box of input indices to the other side, voxels:
/// the radius of the largest inscribed ball.
double inscribed_radius(const Grid<MaterialId>& ids,
                        const LabelVolume& labels,
                        const std::array<int, 3>& lo,
                        const std::array<int, 3>& hi) {
  std::vector<std::uint8_t> outside(ids.values.size());
  for (std::size_t n = 0; n < outside.size(); ++n)
    outside[n] = ids.values[n] == 1 ? 0 : 1;
  const auto d2 = squared_distances(ids.frame.dims, {1, 1, 1}, outside);
  float largest = 0;
  for (int k = lo[2]; k <= hi[2]; ++k)
    for (int j = lo[1]; j <= hi[1]; ++j)
      for (int i = lo[0]; i <= hi[0]; ++i)
        largest = std::max(largest,
                           d2[ids.frame.linear(i - labels.first_voxel[0], j - labels.first_voxel[1],
                                               k - labels.first_voxel[2])]);
  return std::sqrt(largest) - 0.5;
}

}  // namespace

TEST_CASE("tighten: real volumes keep the topology of every label", "[levelset][slow]") {
  // The larger volumes of the folder: scripts/bench_level_sets.py.
  for (const char* name :
       {"cgal_tiny_420.nii.gz", "cgal_tiny_12323.nii.gz", "cleaver_spheres.nii.gz",
        "cleaver_mickey.nii.gz", "rat_head.nii.gz", "totalseg_example.nii.gz", "tooth.nii.gz",
        "bunny.nii.gz", "spine_verse004.nii.gz", "torso_niivue.nii.gz", "cgal_liver.nii.gz",
        "brain_aal116.nii.gz"})
    for (const double r : {0.8, 2.0})
      check_topology(name, r);
}

TEST_CASE("tighten: the bunny at r = 15 is smooth, and keeps its ears", "[levelset][slow]") {
  const auto labels = labels_of("bunny.nii.gz");
  if (!labels) return;
  const TightenResult result = tightened(*labels, 15);
  const Grid<MaterialId>& after = *result.level_sets.labels;
  const InterfaceMesh mesh = extract_interfaces(result.level_sets, silent_context());
  const auto boundary = boundary_topology(mesh, 2);
  CHECK(validate(mesh, 2).is_valid());
  CHECK(boundary[1].components == 1);
  CHECK(boundary[1].euler == 2);

  double before_count = 0, after_count = 0, both = 0;
  for (std::size_t n = 0; n < after.values.size(); ++n) {
    before_count += labels->ids.values[n];
    after_count += after.values[n];
    both += labels->ids.values[n] * after.values[n];
  }
  CHECK(after_count == Approx(before_count).epsilon(0.06));
  CHECK(2 * both / (before_count + after_count) >= 0.90);
  CHECK(result.stats.nodes_changed > 10000);  // strongly smoothed: 1 % of its voxels and more

  // The ears above their roots, by input index.
  const std::array<std::array<std::array<int, 3>, 2>, 2> ears = {
      {{{{24, 86, 130}, {41, 146, 161}}}, {{{45, 75, 130}, {94, 114, 167}}}}};
  for (const auto& [lo, hi] : ears)
    CHECK(inscribed_radius(after, *labels, lo, hi) >=
          0.8 * inscribed_radius(labels->ids, *labels, lo, hi));
}
