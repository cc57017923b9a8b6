// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/mesh/validate.h"
#include "cvmesh/tet/improve_tets.h"
#include "cvmesh/tet/split_surface_edges.h"
#include "cvmesh/tet/tetrahedralize.h"

#include <tbb/global_control.h>

#include "support/catch.h"
#include "tet/shapes.h"
#include <algorithm>
#include <cmath>
#include <vector>

using namespace cvmesh;
using namespace cvmesh::shapes;

namespace {

const Vec3 kCentre{20, 20, 20};

// Along two edges three patches meet, and along eight two.
InterfaceMesh two_boxes() {
  return join(box({5, 5, 5}, {15, 15, 15}, 3, {1, 0}), box({15, 5, 5}, {25, 15, 15}, 3, {2, 0}));
}

InterfaceMesh thin_wall(double gap, int levels) {
  return join(sphere(kCentre, 15, levels, {1, 0}), sphere(kCentre, 15 - gap, levels, {2, 1}));
}

double area(const InterfaceMesh& surface) {
  double sum = 0;
  for (const auto& [a, b, c] : surface.facets)
    sum += norm(area_vector2(surface.points[a], surface.points[b], surface.points[c])) / 2;
  return sum;
}

}  // namespace

TEST_CASE("split_surface_edges: space, surface and conformity stay, on curves too",
          "[tet][property]") {
  for (const InterfaceMesh& surface : {two_boxes(), thin_wall(1, 2)}) {
    TetMesh mesh = filled(surface);
    const TetMesh before = mesh;
    std::vector<std::int32_t> wanted;
    for (std::size_t t = 0; t < mesh.tets.size(); t += 7)
      wanted.push_back(static_cast<std::int32_t>(t));
    const std::vector<std::int32_t> touched = split_surface_edges(mesh, wanted, {}, 0, 100000);
    const std::size_t old_count = before.surface.points.size();
    const std::size_t splits = mesh.surface.points.size() - old_count;
    REQUIRE(splits > 10);
    CHECK(mesh.points.size() == before.points.size() + splits);
    CHECK(mesh.surface.facets.size() >= before.surface.facets.size() + 2 * splits);
    CHECK(mesh.tets.size() > before.tets.size() + splits);
    for (std::size_t v = 0; v < old_count; ++v)
      REQUIRE(mesh.points[v] == before.points[v]);
    for (std::size_t v = old_count; v < before.points.size(); ++v)  // of the interior
      REQUIRE(mesh.points[v + splits] == before.points[v]);
    for (std::size_t m = 1; m < 3; ++m)
      CHECK(volumes(mesh)[m] == Approx(volumes(before)[m]).epsilon(1e-12));
    CHECK(area(mesh.surface) == Approx(area(before.surface)).epsilon(1e-12));
    require_valid(mesh);
    for (std::size_t v = old_count; v < old_count + splits; ++v)
      CHECK(std::binary_search(touched.begin(), touched.end(), static_cast<std::int32_t>(v)));
  }
}

TEST_CASE("split_surface_edges: no more than asked for, the first tets first, none too short",
          "[tet][unit]") {
  const TetMesh start = filled(two_boxes());
  std::vector<std::int32_t> all(start.tets.size());
  for (std::size_t t = 0; t < all.size(); ++t)
    all[t] = static_cast<std::int32_t>(t);
  TetMesh mesh = start;
  split_surface_edges(mesh, all, {}, 0, 3);
  CHECK(mesh.surface.points.size() == start.surface.points.size() + 3);
  TetMesh untouched = start;
  CHECK(split_surface_edges(untouched, all, {}, 1000, 3).empty());
  CHECK(untouched.points == start.points);
  CHECK(untouched.tets == start.tets);
  CHECK(untouched.surface.facets == start.surface.facets);
}

TEST_CASE("improve_tets: split edges leave fewer poor tets between sheets that nearly touch",
          "[tet][determinism]") {
  const TetMesh start =
      filled(join(sphere(kCentre, 15, 2, {1, 0}), sphere(kCentre, 14.45, 3, {2, 1})));
  ImproveTetsOptions options;
  options.max_vertex_shift_mm = 0.05;
  TetMesh without = start;
  const ImproveTetsStats as_it_was = improve_tets(without, options, silent_context());
  REQUIRE(as_it_was.after.poor > 20);
  CHECK(as_it_was.edge_splits == 0);
  options.max_splits_per_vertex = 2;
  TetMesh mesh = start;
  const ImproveTetsStats stats = improve_tets(mesh, options, silent_context());
  CHECK(stats.edge_splits == mesh.surface.points.size() - start.surface.points.size());
  CHECK(stats.edge_splits > 0);
  CHECK(stats.after.poor < as_it_was.after.poor);
  require_valid(mesh);
  CHECK(find_intersections(mesh.surface).empty());
  for (const std::size_t threads : {1U, 3U}) {
    const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
    TetMesh second = start;
    improve_tets(second, options, silent_context());
    CHECK(mesh.tets == second.tets);
    CHECK(mesh.points == second.points);
  }
}

TEST_CASE("improve_tets: split edges stay below their bound", "[tet][unit]") {
  TetMesh mesh = filled(thin_wall(0.45, 2));
  const auto vertices = static_cast<double>(mesh.surface.points.size());
  ImproveTetsOptions options;
  options.max_splits_per_vertex = 0.02;
  const ImproveTetsStats stats = improve_tets(mesh, options, silent_context());
  CHECK(static_cast<double>(stats.edge_splits) <= 0.02 * vertices);
}

TEST_CASE("improve_tets: splits kept for after barred moves are used where no vertex may move",
          "[tet][unit]") {
  TetMesh mesh = filled(thin_wall(0.45, 2));  // far more poor tets than splits
  const auto vertices = static_cast<double>(mesh.surface.points.size());
  ImproveTetsOptions options;
  options.max_splits_per_vertex = 0.5;
  REQUIRE(options.max_vertex_shift_mm == 0);
  const ImproveTetsStats stats = improve_tets(mesh, options, silent_context());
  CHECK(stats.edge_splits == static_cast<std::size_t>(0.5 * vertices));
}
