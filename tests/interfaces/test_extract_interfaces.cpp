// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/interfaces/extract_interfaces.h"
#include "cvmesh/levelset/build_level_sets.h"
#include "cvmesh/levelset/tighten.h"
#include "cvmesh/mesh/validate.h"

#include <tbb/global_control.h>
#include <tbb/task_arena.h>

#include "levelset/label_grids.h"
#include "support/catch.h"
#include <algorithm>
#include <cmath>
#include <map>
#include <set>
#include <utility>

using namespace cvmesh;
using label_grids::Labels;

namespace {

InterfaceMesh dense(const Labels& labels, double r_vox = 0.8) {
  TightenOptions options;
  options.r_vox = r_vox;
  auto level_sets = build_level_sets(label_grids::shared(labels),
                                     label_grids::material_count(labels), silent_context())
                        .level_sets;
  return extract_interfaces(tighten(std::move(level_sets), options, silent_context()).level_sets,
                            silent_context());
}

// A box of `dims` nodes with random materials 1..count in its inside and label 0 around.
Labels framed_noise(std::uint64_t seed) {
  Labels labels = label_grids::noise({10, 10, 10}, 4, seed);
  for (int k = 0; k < 10; ++k)
    for (int j = 0; j < 10; ++j)
      for (int i = 0; i < 10; ++i)
        if (std::min({i, j, k}) == 0 || std::max({i, j, k}) == 9) labels(i, j, k) = 0;
  return labels;
}

void check_valid(const InterfaceMesh& mesh, const Labels& labels) {
  const std::size_t materials = label_grids::material_count(labels);
  const Validation validation = validate(mesh, materials);
  INFO(validation.summary());
  CHECK(validation.is_valid());
  const auto boundary = boundary_topology(mesh, materials);
  const auto lattice = label_grids::topology(labels);
  for (std::size_t m = 1; m < materials; ++m) {
    INFO("material " << m);
    if (lattice[m].voxels == 0) continue;
    CHECK(boundary[m].is_closed_manifold);
    CHECK(boundary[m].euler == 2 * lattice[m].euler);
    CHECK(boundary[m].components >= lattice[m].components);
  }
}

}  // namespace

TEST_CASE(
    "extract_interfaces: closed 2-manifolds with the Euler numbers of the voxels on every "
    "phantom",
    "[interfaces][property]") {
  for (const auto& [name, labels] : label_grids::phantoms())
    for (const double r : {0.0, 0.8, 2.0}) {
      INFO(name << ", r = " << r);
      check_valid(dense(labels, r), labels);
    }
}

TEST_CASE(
    "extract_interfaces: random noise of four labels gives closed 2-manifolds that do not "
    "intersect",
    "[interfaces][property]") {
  for (std::uint64_t seed = 1; seed <= 6; ++seed) {
    INFO("seed " << seed);
    for (const Labels& labels : {label_grids::noise({8, 8, 8}, 4, seed), framed_noise(seed)}) {
      const InterfaceMesh mesh = dense(labels);
      check_valid(mesh, labels);
      CHECK(find_intersections(mesh).empty());
    }
  }
}

TEST_CASE("extract_interfaces: surfaces of phantoms do not intersect", "[interfaces][property]") {
  for (const auto& [name, labels] : label_grids::phantoms()) {
    INFO(name);
    CHECK(find_intersections(dense(labels)).empty());
  }
}

TEST_CASE("extract_interfaces: a volume without label 0 is meshed to its box, exactly",
          "[interfaces][unit]") {
  // Half voxels and these spacings are exact in binary: so are the planes and, up to the sum, the
  // volume.
  const Vec3 spacing{0.5, 0.25, 2};
  Labels labels = label_grids::noise({7, 6, 5}, 3, 11);
  for (MaterialId& m : labels.values)
    ++m;
  labels.frame.spacing_mm = spacing;
  const InterfaceMesh mesh = dense(labels);
  const auto all = label_grids::volumes(mesh, 4);
  const double box = 7 * 6 * 5 * 0.5 * 0.25 * 2;
  CHECK(all[1] + all[2] + all[3] == Approx(box).epsilon(1e-12));
  CHECK(all[0] == Approx(-box).epsilon(1e-12));

  const Vec3 lo = scaled_by({-0.5, -0.5, -0.5}, spacing), hi = scaled_by({6.5, 5.5, 4.5}, spacing);
  std::array<double, 7> area{};
  for (std::size_t f = 0; f < mesh.facets.size(); ++f) {
    const PatchKey& patch = mesh.patch_of[f];
    REQUIRE(patch.wall <= 6);
    REQUIRE((patch.wall == 0) == (patch.sides.outside != kExterior));
    const auto& [a, b, c] = mesh.facets[f];
    const Vec3 n = area_vector2(mesh.points[a], mesh.points[b], mesh.points[c]);
    area[patch.wall] += 0.5 * norm(n);
    if (patch.wall == 0) continue;
    const int axis = (patch.wall - 1) / 2;
    const bool is_high = (patch.wall - 1) % 2 == 1;
    for (const auto v : mesh.facets[f])
      CHECK(mesh.points[v][axis] == (is_high ? hi[axis] : lo[axis]));
    CHECK((is_high ? n[axis] : -n[axis]) > 0);
  }
  for (int axis = 0; axis < 3; ++axis) {
    const Vec3 size = hi - lo;
    const double face = size[(axis + 1) % 3] * size[(axis + 2) % 3];
    CHECK(area[1 + 2 * axis] == Approx(face).epsilon(1e-12));
    CHECK(area[2 + 2 * axis] == Approx(face).epsilon(1e-12));
  }
  for (const Vec3& p : mesh.points)
    for (int axis = 0; axis < 3; ++axis) {
      CHECK(p[axis] >= lo[axis]);
      CHECK(p[axis] <= hi[axis]);
    }
}

TEST_CASE("extract_interfaces: only the label that reaches the border gets walls",
          "[interfaces][unit]") {
  // Label 1 reaches x- only; label 2 lies inside; label 0 has no wall.
  const Labels labels = label_grids::sample({16, 14, 14}, [](const Vec3& p) -> MaterialId {
    const double away = std::hypot(p.y - 6.5, p.z - 6.5);
    return away < 3.2 && p.x < 6 ? 1 : away < 3.2 && p.x < 11 ? 2 : 0;
  });
  const InterfaceMesh mesh = dense(labels);
  check_valid(mesh, labels);
  std::set<PatchKey> patches(mesh.patch_of.begin(), mesh.patch_of.end());
  CHECK(patches == std::set<PatchKey>{{{1, 0}, 0}, {{1, 0}, 1}, {{2, 0}, 0}, {{2, 1}, 0}});

  // Its walls end where its interface with label 0 meets the border: one closed curve.
  const Strata strata = find_strata(mesh);
  REQUIRE(strata.curves.size() == 2);
  for (const auto& curve : strata.curves)
    CHECK(curve.is_closed);
  CHECK(std::count(strata.dimension.begin(), strata.dimension.end(), 0) == 0);
}

TEST_CASE("find_strata: a box of one label has eight corners and twelve curves",
          "[interfaces][mesh][unit]") {
  GridFrame frame;
  frame.dims = {6, 5, 4};
  // A node of label 2 in the middle gives the lattice something to cut; it adds no curve.
  Labels labels(frame, 1);
  labels(3, 2, 2) = 2;
  const InterfaceMesh mesh = dense(labels);
  const Strata strata = find_strata(mesh);
  CHECK(std::count(strata.dimension.begin(), strata.dimension.end(), 0) == 8);
  REQUIRE(strata.curves.size() == 12);
  for (const auto& curve : strata.curves) {
    CHECK_FALSE(curve.is_closed);
    CHECK(curve.patches.size() == 2);
    CHECK(strata.dimension[curve.vertices.front()] == 0);
    CHECK(strata.dimension[curve.vertices.back()] == 0);
  }
  CHECK(strata.patches.size() == 7);
}

TEST_CASE("find_strata: touching boxes meet along one closed curve of three patches",
          "[interfaces][mesh][unit]") {
  const Labels labels = label_grids::sample({20, 16, 16}, [](const Vec3& p) -> MaterialId {
    if (std::min(p.y, p.z) < 4 || std::max(p.y, p.z) > 11 || p.x < 4 || p.x > 15) return 0;
    return p.x < 10 ? 1 : 2;
  });
  const Strata strata = find_strata(dense(labels));
  REQUIRE(strata.curves.size() == 1);
  CHECK(strata.curves[0].is_closed);
  CHECK(strata.curves[0].patches == std::vector<PatchKey>{{{1, 0}, 0}, {{2, 0}, 0}, {{2, 1}, 0}});
  CHECK(std::count(strata.dimension.begin(), strata.dimension.end(), 0) == 0);
  CHECK(static_cast<std::size_t>(std::count(strata.dimension.begin(), strata.dimension.end(), 1)) ==
        strata.curves[0].vertices.size());
}

TEST_CASE("find_strata: quarters of a box meet in corners where four materials do",
          "[interfaces][mesh][unit]") {
  // Two halves above two halves turned by a right angle: four materials around the middle.
  const Labels labels = label_grids::sample({12, 12, 12}, [](const Vec3& p) -> MaterialId {
    return p.z < 6 ? (p.x < 6 ? 1 : 2) : (p.y < 6 ? 3 : 4);
  });
  const InterfaceMesh mesh = dense(labels);
  check_valid(mesh, labels);
  const Strata strata = find_strata(mesh);
  const Vec3 middle{5.5, 5.5, 5.5};
  int inner_corners = 0;
  for (std::size_t v = 0; v < mesh.points.size(); ++v) {
    const bool is_inside = [&] {
      for (int axis = 0; axis < 3; ++axis)
        if (mesh.points[v][axis] <= -0.5 || mesh.points[v][axis] >= 11.5) return false;
      return true;
    }();
    if (strata.dimension[v] != 0 || !is_inside) continue;
    ++inner_corners;
    CHECK(distance(mesh.points[v], middle) < 1.5);
  }
  CHECK(inner_corners >= 1);
  CHECK(inner_corners <= 4);
}

TEST_CASE("extract_interfaces: every vertex keeps its distance from the nodes of its element",
          "[interfaces][unit]") {
  // Cut points keep a twentieth of an edge from its ends, so no facet degenerates.
  const InterfaceMesh mesh = dense(label_grids::noise({8, 8, 8}, 4, 3));
  for (const auto& [a, b, c] : mesh.facets)
    CHECK(norm(area_vector2(mesh.points[a], mesh.points[b], mesh.points[c])) > 1e-4);
}

TEST_CASE("extract_interfaces: volumes are those of the voxels within two in a hundred",
          "[interfaces][unit]") {
  const Labels labels = label_grids::sample({33, 33, 33}, [](const Vec3& p) -> MaterialId {
    const double d = distance(p, {16, 16, 16});
    return d < 8 ? 1 : d < 12 ? 2 : 0;
  });
  const auto all = label_grids::volumes(dense(labels), 3);
  for (const MaterialId m : {MaterialId{1}, MaterialId{2}})
    CHECK(all[m] == Approx(static_cast<double>(label_grids::count(labels, m))).epsilon(0.02));
}

TEST_CASE("extract_interfaces: 1 = 2 = 8 threads", "[interfaces][determinism]") {
  for (const auto& [name, labels] : label_grids::phantoms()) {
    INFO(name);
    std::vector<InterfaceMesh> results;
    for (const int threads : {1, 2, 8}) {
      tbb::global_control limit(tbb::global_control::max_allowed_parallelism,
                                static_cast<std::size_t>(threads));
      tbb::task_arena arena(threads);
      arena.execute([&] { results.push_back(dense(labels)); });
    }
    for (const auto& result : results) {
      CHECK(result.points == results[0].points);
      CHECK(result.facets == results[0].facets);
      CHECK(result.patch_of == results[0].patch_of);
    }
  }
}
