// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/mesh/validate.h"
#include "cvmesh/tet/split_surface_edges.h"
#include "cvmesh/tet/tet_part.h"

#include "support/catch.h"
#include "tet/shapes.h"
#include <algorithm>
#include <cstdint>
#include <vector>

using namespace cvmesh;
using namespace cvmesh::shapes;

TEST_CASE("TetPart: put back untouched, the mesh is what it was", "[tet][property]") {
  const TetMesh whole = thin_wall();
  for (const int rings : {0, 2, 100}) {
    CAPTURE(rings);
    const TetPart part(whole, {17, 400}, rings, 0);
    CHECK((part.mesh.tets.size() == whole.tets.size()) == (rings == 100));
    CHECK(part.mesh.surface.points.size() == part.is_frozen.size());
    TetMesh back = whole;
    part.put_back(back);
    require_valid(back);
    CHECK(back.surface.points == whole.surface.points);
    CHECK(back.surface.facets == whole.surface.facets);
    CHECK(back.points.size() == whole.points.size());
    CHECK(places(back) == places(whole));
  }
}

TEST_CASE("TetPart: all tets of a vertex that is not frozen are in the part", "[tet][property]") {
  const TetMesh whole = thin_wall();
  const TetPart part(whole, {17}, 2, 0);
  // each vertex by its place: its tets in the whole and in the part
  const auto tets_at = [](const TetMesh& mesh, const Vec3& p) {
    return std::count_if(mesh.tets.begin(), mesh.tets.end(), [&](const auto& tet) {
      return std::any_of(tet.begin(), tet.end(), [&](std::int32_t v) {
        return mesh.points[static_cast<std::size_t>(v)] == p;
      });
    });
  };
  std::size_t frozen = 0;
  for (std::size_t v = 0; v < part.mesh.points.size(); ++v) {
    const Vec3& p = part.mesh.points[v];
    const bool is_frozen = v < part.is_frozen.size() && part.is_frozen[v];
    frozen += is_frozen;
    if (!is_frozen) CHECK(tets_at(part.mesh, p) == tets_at(whole, p));
  }
  CHECK(frozen > 10);
}

TEST_CASE("TetPart: edges split in a part split the whole", "[tet][property]") {
  const TetMesh whole = thin_wall();
  TetPart part(whole, {17, 400}, 2, 0);
  const std::vector<Vec3> given = part.mesh.points;
  std::vector<std::int32_t> all(part.mesh.tets.size());
  for (std::size_t t = 0; t < all.size(); ++t)
    all[t] = static_cast<std::int32_t>(t);
  split_surface_edges(part.mesh, all, part.is_frozen, 0, 100000);
  const std::size_t splits = part.mesh.surface.points.size() - part.is_frozen.size();
  REQUIRE(splits > 5);
  TetMesh back = whole;
  part.put_back(back);
  require_valid(back);  // conformal: nothing was split beyond the border of the part
  CHECK(back.surface.points.size() == whole.surface.points.size() + splits);
  CHECK(back.points.size() == whole.points.size() + splits);
  for (std::size_t m = 1; m < 3; ++m)
    CHECK(volumes(back)[m] == Approx(volumes(whole)[m]).epsilon(1e-12));
}

TEST_CASE("TetPart: facets across the exterior are in its surface, and stay as they are",
          "[tet][unit]") {
  // two boxes, with a gap of 1 between them
  const TetMesh whole = filled(
      join(box({5, 5, 5}, {15, 15, 15}, 3, {1, 0}), box({16, 5, 5}, {26, 15, 15}, 3, {2, 0})));
  std::int32_t beside_gap = -1;
  for (std::size_t t = 0; t < whole.tets.size() && beside_gap < 0; ++t)
    if (whole.material_of[t] == 1 &&
        std::count_if(whole.tets[t].begin(), whole.tets[t].end(), [&](std::int32_t v) {
          return whole.points[static_cast<std::size_t>(v)].x == 15;
        }) == 3)
      beside_gap = static_cast<std::int32_t>(t);
  REQUIRE(beside_gap >= 0);
  const auto of_second = [](const TetPart& part) {
    return std::count_if(part.mesh.surface.patch_of.begin(), part.mesh.surface.patch_of.end(),
                         [](const PatchKey& key) {
                           return key.sides == Sides{2, 0};
                         });
  };
  CHECK(of_second(TetPart(whole, {beside_gap}, 1, 0.5)) == 0);
  const TetPart part(whole, {beside_gap}, 1, 1.5);
  CHECK(of_second(part) > 0);
  CHECK(std::all_of(part.mesh.material_of.begin(), part.mesh.material_of.end(),
                    [](MaterialId m) { return m == 1; }));
  TetMesh back = whole;
  part.put_back(back);
  require_valid(back);
  CHECK(back.surface.facets == whole.surface.facets);
}
