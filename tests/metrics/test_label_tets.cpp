// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/mesh/validate.h"
#include "cvmesh/metrics/label_tets.h"

#include "metrics/simple_meshes.h"
#include "support/catch.h"
#include <algorithm>
#include <set>

using namespace cvmesh;

namespace {

GridFrame unit_frame() {
  GridFrame frame;
  frame.dims = {4, 4, 4};
  return frame;
}

LabelledTets build(const std::vector<Vec3>& points,
                   const std::vector<std::array<std::int32_t, 4>>& tets,
                   const std::vector<MaterialId>& material_of) {
  return build_label_tets(points, tets, material_of, 3, unit_frame());
}

// The facets as sets of points with their sides, whatever their order.
std::set<std::pair<std::set<std::array<double, 3>>, Sides>> facets_of(const InterfaceMesh& mesh) {
  std::set<std::pair<std::set<std::array<double, 3>>, Sides>> result;
  for (std::size_t f = 0; f < mesh.facets.size(); ++f) {
    std::set<std::array<double, 3>> corners;
    for (const std::int32_t v : mesh.facets[f])
      corners.insert({mesh.points[v].x, mesh.points[v].y, mesh.points[v].z});
    result.insert({corners, mesh.patch_of[f].sides});
  }
  return result;
}

}  // namespace

TEST_CASE("build_label_tets: finds the facets of a valid mesh, which stays valid",
          "[metrics][unit]") {
  TetMesh cube = simple_meshes::two_material_cube();
  cube.points.push_back({9, 9, 9});  // that no tet uses
  const LabelledTets built = build(cube.points, cube.tets, cube.material_of);
  CHECK(built.faults == TetFaults{});
  CHECK(built.unused_points == 1);
  CHECK(validate(built.mesh, 3).summary().empty());
  CHECK(validate(built.mesh.surface, 3).summary().empty());
  CHECK(facets_of(built.mesh.surface) == facets_of(cube.surface));
  for (const MaterialId m : {1, 2}) {
    CHECK(built.solids[m].components == 1);
    CHECK(built.solids[m].euler == 1);
  }
}

TEST_CASE("build_label_tets: a mesh in a mirrored space is turned over, one tet is a fault",
          "[metrics][unit]") {
  TetMesh cube = simple_meshes::two_material_cube();
  for (auto& tet : cube.tets)
    std::swap(tet[0], tet[1]);
  CHECK(build(cube.points, cube.tets, cube.material_of).faults == TetFaults{});
  std::swap(cube.tets[2][0], cube.tets[2][1]);
  const LabelledTets built = build(cube.points, cube.tets, cube.material_of);
  CHECK(built.faults == TetFaults{.inverted = 1});
  CHECK_FALSE(validate(built.mesh, 3).is_valid());
}

TEST_CASE("build_label_tets: counts each kind of fault", "[metrics][unit]") {
  const TetMesh cube = simple_meshes::two_material_cube();
  auto tets = cube.tets;
  auto material_of = cube.material_of;
  const auto add = [&](std::array<std::int32_t, 4> tet) {
    tets.push_back(tet);
    material_of.push_back(1);
  };
  SECTION("a tet twice: its faces inside are in three tets, those outside in two on one side") {
    add(tets[0]);
    const TetFaults faults = build(cube.points, tets, material_of).faults;
    CHECK(faults.repeated_tets == 1);
    CHECK(faults.crowded_faces == 2);
    CHECK(faults.folded_faces >= 2);
    CHECK(faults.inverted == 0);
  }
  SECTION("a vertex twice") {
    add({0, 1, 1, 3});
    CHECK(build(cube.points, tets, material_of).faults == TetFaults{.repeated_vertex = 1});
  }
  SECTION("no volume") {
    add({0, 1, 3, 2});
    CHECK(build(cube.points, tets, material_of).faults.flat == 1);
  }
}

TEST_CASE("build_label_tets: solids joined by an edge only are two components", "[metrics][unit]") {
  // Two tets on the edge (0,0,0)-(1,0,0): V - E + F - T = 6 - 11 + 8 - 2.
  const std::vector<Vec3> points = {{0, 0, 0}, {1, 0, 0},  {0, 1, 0},
                                    {0, 0, 1}, {0, -1, 0}, {0, 0, -1}};
  const LabelledTets built = build(points, {{0, 1, 2, 3}, {0, 1, 4, 5}}, {1, 1});
  CHECK(built.solids[1].components == 2);
  CHECK(built.solids[1].euler == 1);
  CHECK_FALSE(boundary_topology(built.mesh.surface, 3)[1].is_closed_manifold);
}

TEST_CASE("build_label_tets: facets in the planes of the box are walls", "[metrics][unit]") {
  const std::vector<Vec3> points = {
      {-0.5, -0.5, -0.5}, {3.5, -0.5, -0.5}, {-0.5, 3.5, -0.5}, {-0.5, -0.5, 3.5}};
  const LabelledTets built = build(points, {{0, 1, 2, 3}}, {2});
  std::vector<std::uint16_t> walls;
  for (const PatchKey& key : built.mesh.surface.patch_of)
    walls.push_back(key.wall);
  std::sort(walls.begin(), walls.end());
  CHECK(walls == std::vector<std::uint16_t>{0, 1, 3, 5});
}
