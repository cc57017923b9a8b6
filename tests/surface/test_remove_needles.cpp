// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/core/error.h"
#include "cvmesh/mesh/validate.h"
#include "cvmesh/surface/flip_edges.h"
#include "cvmesh/surface/remove_needles.h"

#include "support/catch.h"
#include "support/phantoms.h"
#include "surface/dense_phantoms.h"
#include <algorithm>
#include <atomic>

using namespace cvmesh;

namespace {

double poorest_quality(const InterfaceMesh& mesh) {
  double least = 1;
  for (const auto& [a, b, c] : mesh.facets)
    least = std::min(least, triangle_quality(mesh.points[static_cast<std::size_t>(a)],
                                             mesh.points[static_cast<std::size_t>(b)],
                                             mesh.points[static_cast<std::size_t>(c)]));
  return least;
}

/// A fin: two long facets on one edge, with `count` vertices in a row on that edge, so that both
/// are fans of needles. No edge of it can be flipped.
InterfaceMesh fin(int count) {
  InterfaceMesh mesh;
  mesh.points = {{0, 0, 0}, {0, 0, 0.8}, {2, 0.5, 0.4}, {2, -0.5, 0.4}};
  std::vector<std::int32_t> row{0};
  for (int n = 0; n < count; ++n) {
    row.push_back(static_cast<std::int32_t>(mesh.points.size()));
    mesh.points.push_back({0, 0, 0.4 + 0.004 * (n - 0.5 * (count - 1))});
  }
  row.push_back(1);
  for (std::size_t n = 0; n + 1 < row.size(); ++n) {
    mesh.facets.push_back({row[n], 2, row[n + 1]});
    mesh.facets.push_back({row[n], row[n + 1], 3});
  }
  mesh.facets.push_back({0, 3, 2});
  mesh.facets.push_back({1, 2, 3});
  mesh.patch_of.assign(mesh.facets.size(), {{1, 0}, 0});
  return mesh;
}

}  // namespace

TEST_CASE("remove_needles: vertices in a row on a ridge go, which no flip can help",
          "[surface][unit]") {
  const InterfaceMesh mesh = fin(6);
  auto flipped = flip_edges(MaterialSurfaces(mesh, 2), 1, {}, silent_context());
  REQUIRE(poorest_quality(flipped.surfaces.to_interface_mesh()) < 0.005);
  const auto freed = remove_needles(std::move(flipped.surfaces), 1, 0.5, silent_context());
  REQUIRE(freed.surfaces.validate().is_valid());
  const InterfaceMesh after = freed.surfaces.to_interface_mesh();
  CHECK(freed.stats.removed >= 4);
  CHECK(after.points.size() + freed.stats.removed == mesh.points.size());
  CHECK(poorest_quality(after) > 0.0128);
  // the corners of the fin are where they were
  for (std::size_t v = 0; v < 4; ++v)
    CHECK(std::find(after.points.begin(), after.points.end(), mesh.points[v]) !=
          after.points.end());
}

TEST_CASE("remove_needles: what has no needles stays as it is, curves and corners too",
          "[surface][property]") {
  for (const auto& volume : {phantoms::ball(8), phantoms::three_material_wedge(75, 8)}) {
    const auto dense = dense_phantoms::make(volume);
    MaterialSurfaces surfaces(dense.mesh, dense.material_count);
    const double poorest = poorest_quality(dense.mesh);
    const std::size_t vertices = surfaces.vertex_count();
    const auto freed = remove_needles(std::move(surfaces), dense.voxel_mm, 0.5, silent_context());
    REQUIRE(freed.surfaces.validate().is_valid());
    dense_phantoms::require_same_topology(freed.surfaces.to_interface_mesh(), dense);
    CHECK(freed.surfaces.vertex_count() + freed.stats.removed == vertices);
    if (poorest > 0.0128) CHECK(freed.stats.removed == 0);
    // but for rounding: facets may begin at another corner
    CHECK(poorest_quality(freed.surfaces.to_interface_mesh()) >= poorest * (1 - 1e-12));
  }
}

TEST_CASE("remove_needles: a cancel ends it with a Limit error", "[surface][unit]") {
  const InterfaceMesh mesh = fin(6);
  const std::atomic<bool> cancel = true;
  StageContext context = silent_context();
  context.cancel = &cancel;
  try {
    remove_needles(MaterialSurfaces(mesh, 2), 1, 0.5, context);
    FAIL("it went on");
  } catch (const Error& error) {
    CHECK(error.code() == ErrorCode::Limit);
  }
}
