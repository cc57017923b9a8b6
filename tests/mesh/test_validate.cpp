// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/mesh/validate.h"

#include "metrics/simple_meshes.h"
#include "support/catch.h"
#include <algorithm>
#include <limits>

using namespace cvmesh;
using simple_meshes::together;

namespace {

bool reports(const Validation& validation, const std::string& words) {
  return std::any_of(
      validation.faults.begin(), validation.faults.end(),
      [&](const std::string& fault) { return fault.find(words) != std::string::npos; });
}

// A closed ring of `around` x `across` quads.
InterfaceMesh torus(int around, int across) {
  InterfaceMesh mesh;
  const double turn = 2 * 3.14159265358979323846;
  for (int i = 0; i < around; ++i) {
    for (int j = 0; j < across; ++j) {
      const double u = turn * i / around, v = turn * j / across, r = 3 + std::cos(v);
      mesh.points.push_back({r * std::cos(u), r * std::sin(u), std::sin(v)});
      const auto at = [&](int a, int b) { return (a % around) * across + b % across; };
      const auto a = at(i, j), b = at(i + 1, j), c = at(i + 1, j + 1), d = at(i, j + 1);
      mesh.facets.push_back({a, b, c});
      mesh.facets.push_back({a, c, d});
    }
  }
  mesh.patch_of.assign(mesh.facets.size(), {{1, 0}, 0});
  return mesh;
}

// Two tetrahedra that share one vertex, the origin.
InterfaceMesh pinched() {
  InterfaceMesh a = simple_meshes::corner_tetrahedron();
  InterfaceMesh b = simple_meshes::corner_tetrahedron();
  for (Vec3& p : b.points)
    p = -p;
  for (auto& f : b.facets)
    std::swap(f[1], f[2]);
  InterfaceMesh mesh = together(a, b);
  for (auto& f : mesh.facets) {
    for (auto& v : f)
      v = v == 4 ? 0 : v > 4 ? v - 1 : v;
  }
  mesh.points.erase(mesh.points.begin() + 4);
  return mesh;
}

}  // namespace

TEST_CASE("boundary_topology: sphere, torus and shells have the known Euler characteristics",
          "[mesh][unit]") {
  const auto sphere = boundary_topology(simple_meshes::sphere({0, 0, 0}, 1, 2), 2);
  CHECK(sphere[1].euler == 2);
  CHECK(sphere[1].components == 1);
  CHECK(sphere[1].is_closed_manifold);
  CHECK(sphere[0].euler == 2);
  CHECK(sphere[0].is_closed_manifold);
  const auto ring = boundary_topology(torus(12, 8), 2);
  CHECK(ring[1].euler == 0);
  CHECK(ring[1].components == 1);
  CHECK(ring[1].is_closed_manifold);
  const auto shell = boundary_topology(together(simple_meshes::sphere({0, 0, 0}, 1, 1, {2, 1}),
                                                simple_meshes::sphere({0, 0, 0}, 2, 1, {1, 0})),
                                       4);
  CHECK(shell[2].components == 1);
  CHECK(shell[1].components == 2);
  CHECK(shell[1].euler == 4);
  CHECK(shell[3].components == 0);
  CHECK(shell[3].is_closed_manifold);  // nothing is closed
}

TEST_CASE("validate: sound surfaces have no faults", "[mesh][unit]") {
  CHECK(validate(simple_meshes::sphere({0, 0, 0}, 1, 3), 2).summary().empty());
  CHECK(validate(torus(9, 7), 2).is_valid());
  CHECK(validate(simple_meshes::two_material_cube().surface, 3).summary().empty());
  CHECK(validate(InterfaceMesh{}, 1).is_valid());
}

TEST_CASE("validate: an open edge is found", "[mesh][unit]") {
  InterfaceMesh mesh = simple_meshes::sphere({0, 0, 0}, 1, 1);
  mesh.facets.pop_back();
  mesh.patch_of.pop_back();
  const Validation v = validate(mesh, 2);
  CHECK(reports(v, "is in 1 facets instead of 2"));
  CHECK(v.faults.size() == 6);  // three edges, of two materials
  CHECK_FALSE(boundary_topology(mesh, 2)[1].is_closed_manifold);
}

TEST_CASE("validate: a flipped facet is found", "[mesh][unit]") {
  InterfaceMesh mesh = simple_meshes::sphere({0, 0, 0}, 1, 1);
  std::swap(mesh.facets[7][0], mesh.facets[7][1]);
  CHECK(reports(validate(mesh, 2), "face opposite ways"));
}

TEST_CASE("validate: a repeated facet is found", "[mesh][unit]") {
  InterfaceMesh mesh = simple_meshes::sphere({0, 0, 0}, 1, 1);
  const auto [a, b, c] = mesh.facets[5];
  mesh.facets.push_back({c, a, b});
  mesh.patch_of.push_back(mesh.patch_of[5]);
  const Validation v = validate(mesh, 2);
  CHECK(reports(v, "facets 5 and 80 have the same vertices"));
  CHECK(reports(v, "is in 3 facets"));
}

TEST_CASE("validate: a pinched vertex is found", "[mesh][unit]") {
  const InterfaceMesh mesh = pinched();
  const Validation v = validate(mesh, 2);
  CHECK(reports(v, "touches itself at vertex 0"));
  CHECK(v.faults.size() == 2);  // of the material and of the exterior
  const BoundaryTopology topology = boundary_topology(mesh, 2)[1];
  CHECK_FALSE(topology.is_closed_manifold);
  CHECK(topology.nonmanifold_edges == 0);
  CHECK(topology.nonmanifold_vertices == 1);
}

TEST_CASE("boundary_topology: counts non-manifold edges, and vertices beside them",
          "[mesh][unit]") {
  InterfaceMesh mesh = pinched();
  const auto count = [&] { return boundary_topology(mesh, 2)[1]; };
  // A facet less: three edges with one facet each, and the pinched vertex stays one.
  mesh.facets.pop_back();
  mesh.patch_of.pop_back();
  CHECK(count().nonmanifold_edges == 3);
  CHECK(count().nonmanifold_vertices == 1);
  // Two tetrahedra that share an edge: four facets there, and its ends are no faults of their own.
  const std::array<std::int32_t, 3> first[] = {{0, 2, 1}, {0, 1, 3}, {0, 3, 2}, {1, 2, 3}};
  mesh = {};
  mesh.points = {{0, 0, 0}, {0, 0, 1}, {1, 0, 0}, {1, 1, 0}, {-1, 0, 0}, {-1, -1, 0}};
  for (const auto& facet : first)
    for (const bool is_second : {false, true}) {
      std::array<std::int32_t, 3> moved = facet;
      for (std::int32_t& v : moved)
        if (is_second && v > 1) v += 2;
      mesh.facets.push_back(moved);
      mesh.patch_of.push_back({{1, 0}, 0});
    }
  CHECK(count().nonmanifold_edges == 1);
  CHECK(count().nonmanifold_vertices == 0);
  CHECK_FALSE(count().is_closed_manifold);
}

TEST_CASE("validate: bad points, facets and materials are found", "[mesh][unit]") {
  const InterfaceMesh good = simple_meshes::sphere({0, 0, 0}, 1, 1);
  InterfaceMesh mesh = good;
  mesh.points[3] = mesh.points[17];
  CHECK(reports(validate(mesh, 2), "vertices 3 and 17 are at the same point"));
  mesh = good;
  mesh.points[4].y = std::numeric_limits<double>::quiet_NaN();
  CHECK(reports(validate(mesh, 2), "vertex 4 is not finite"));
  mesh = good;
  const auto [a, b, c] = mesh.facets[0];
  mesh.points[a] = {0, 0, 5};
  mesh.points[b] = {0, 0, 6};
  mesh.points[c] = {0, 0, 9};
  CHECK(reports(validate(mesh, 2), "has zero area"));
  mesh = good;
  mesh.patch_of[9].sides = {0, 1};
  CHECK(reports(validate(mesh, 2), "inside must be above outside"));
  CHECK(reports(validate(good, 1), "there are 42 points and 1 materials"));
  mesh = good;
  mesh.facets[2][1] = 42;
  CHECK(reports(validate(mesh, 2), "facet 2 "));
  mesh.facets[2][1] = mesh.facets[2][0];
  CHECK(reports(validate(mesh, 2), "uses a vertex twice"));
  mesh = good;
  mesh.patch_of.pop_back();
  CHECK(reports(validate(mesh, 2), "80 facets but 79 patch keys"));
}

TEST_CASE("validate: the first ten faults of a kind are named, the others counted",
          "[mesh][unit]") {
  InterfaceMesh mesh = simple_meshes::sphere({0, 0, 0}, 1, 1);
  for (auto& patch : mesh.patch_of)
    patch.sides = {1, 1};
  const Validation v = validate(mesh, 2);
  CHECK(std::count_if(v.faults.begin(), v.faults.end(), [](const std::string& fault) {
          return fault.find("inside must be above") != std::string::npos;
        }) == 10);
  CHECK(reports(v, "70 more: "));
}

TEST_CASE("find_intersections: sound meshes have none, crossing ones are found", "[mesh][unit]") {
  CHECK(find_intersections(simple_meshes::sphere({0, 0, 0}, 1, 4)).empty());
  CHECK(find_intersections(torus(30, 20)).empty());
  CHECK(find_intersections(simple_meshes::two_material_cube().surface).empty());
  CHECK(find_intersections(pinched()).empty());  // a shared vertex is no intersection
  CHECK(find_intersections(InterfaceMesh{}).empty());
  const InterfaceMesh crossing =
      together(simple_meshes::sphere({0, 0, 0}, 1, 3), simple_meshes::sphere({1, 0, 0}, 1, 3));
  const auto pairs = find_intersections(crossing, 7);
  REQUIRE(pairs.size() == 7);
  CHECK(std::is_sorted(pairs.begin(), pairs.end()));
  for (const auto& [a, b] : pairs) {
    CHECK(a < 1280);
    CHECK(b >= 1280);
  }
  const auto all = find_intersections(crossing, 1000000);
  CHECK(all.size() > 7);
  CHECK(std::equal(pairs.begin(), pairs.end(), all.begin()));
}

TEST_CASE("find_intersections: touching, folding and piercing facets", "[mesh][unit]") {
  // Two facets that touch in a point of their insides.
  InterfaceMesh touching = together(simple_meshes::square(2, 0), InterfaceMesh{});
  touching.points.insert(touching.points.end(), {{1.2, 0.5, 0}, {1, 0, 1}, {1, 1, 1}});
  touching.facets.push_back({4, 5, 6});
  touching.patch_of.push_back({{1, 0}, 0});
  CHECK(find_intersections(touching).size() == 1);
  // Two facets on one edge, folded flat onto each other.
  InterfaceMesh folded;
  folded.points = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0.2, 0.5, 0}};
  folded.facets = {{0, 1, 2}, {1, 0, 3}};
  folded.patch_of.assign(2, {{1, 0}, 0});
  CHECK(find_intersections(folded).size() == 1);
  folded.points[3].z = 1e-12;
  CHECK(find_intersections(folded).empty());
  folded.points[3] = {0.2, -0.5, 0};  // flat, but on the other side of the edge
  CHECK(find_intersections(folded).empty());
  // One shared vertex, the far edge through the other facet.
  InterfaceMesh pierced;
  pierced.points = {{0, 0, 0}, {2, 0, 0}, {0, 2, 0}, {0.5, 0.5, -1}, {0.5, 0.5, 1}};
  pierced.facets = {{0, 1, 2}, {0, 3, 4}};
  pierced.patch_of.assign(2, {{1, 0}, 0});
  CHECK(find_intersections(pierced).size() == 1);
  // The same three vertices.
  InterfaceMesh doubled = simple_meshes::square(1, 0);
  doubled.facets[1] = {2, 1, 0};
  CHECK(find_intersections(doubled).size() == 1);
}

TEST_CASE("validate: a sound tet mesh has no faults", "[mesh][unit]") {
  CHECK(validate(simple_meshes::two_material_cube(), 3).summary().empty());
}

TEST_CASE("validate: an inverted and a flat tet are found", "[mesh][unit]") {
  TetMesh mesh = simple_meshes::two_material_cube();
  std::swap(mesh.tets[3][0], mesh.tets[3][1]);
  CHECK(reports(validate(mesh, 3), ") mm, is inverted"));
  mesh = simple_meshes::two_material_cube();
  mesh.tets[2] = {0, 1, 3, 2};
  CHECK(reports(validate(mesh, 3), "tet 2 of material "));
  CHECK(reports(validate(mesh, 3), ") mm, is flat"));
}

TEST_CASE("validate: faults name materials and places as they are called", "[mesh][unit]") {
  const MeshNames names{[](MaterialId m) { return m == 1 ? "the bone" : "another"; },
                        [](const Vec3& p) { return p.x <= 1 ? "the left" : "the right"; }};
  TetMesh mesh = simple_meshes::two_material_cube();
  std::swap(mesh.tets[3][0], mesh.tets[3][1]);
  const Validation solid = validate(mesh, 3, names);
  CHECK(reports(solid, "near the left, is inverted"));
  CHECK(reports(solid, ": its tets fill "));
  CHECK_FALSE(reports(solid, "material "));
  InterfaceMesh open = mesh.surface;
  open.facets.pop_back();
  open.patch_of.pop_back();
  const Validation surface = validate(open, 3, names);
  CHECK(reports(surface, "is in 1 facets instead of 2"));
  CHECK(reports(surface, ", near the left: edge ("));
  CHECK_FALSE(reports(surface, "material "));
}

TEST_CASE("validate: missing facets, missing tets and wrong materials are found", "[mesh][unit]") {
  const TetMesh good = simple_meshes::two_material_cube();
  TetMesh mesh = good;
  mesh.surface.facets.erase(mesh.surface.facets.begin());  // one between the materials
  mesh.surface.patch_of.erase(mesh.surface.patch_of.begin());
  CHECK(reports(validate(mesh, 3), "between materials but is no facet"));
  mesh = good;
  mesh.surface.facets.pop_back();
  mesh.surface.patch_of.pop_back();
  const Validation v = validate(mesh, 3);
  CHECK(reports(v, "is on the outside but is no facet"));
  CHECK(reports(v, "its surface encloses"));
  mesh = good;
  mesh.tets.pop_back();
  mesh.material_of.pop_back();
  CHECK(reports(validate(mesh, 3), "but is no facet"));
  mesh = good;
  mesh.tets = {good.tets[0]};
  mesh.material_of = {good.material_of[0]};
  CHECK(reports(validate(mesh, 3), "is no face of a tet"));
  mesh = good;
  mesh.material_of[0] = 1;
  CHECK(reports(validate(mesh, 3), "has materials"));
  mesh = good;
  std::swap(mesh.surface.facets.back()[0], mesh.surface.facets.back()[1]);
  CHECK(reports(validate(mesh, 3), "but lies between 0|"));
}

TEST_CASE("validate: crowded faces and folds are found", "[mesh][unit]") {
  TetMesh mesh = simple_meshes::two_material_cube();
  mesh.tets.push_back(mesh.tets[0]);
  mesh.material_of.push_back(mesh.material_of[0]);
  const Validation v = validate(mesh, 3);
  CHECK((reports(v, "in 3 tets") || reports(v, "on the same side")));
  TetMesh folded;
  folded.points = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}, {0.1, 0.1, 2}};
  folded.tets = {{0, 1, 2, 3}, {0, 1, 2, 4}};
  folded.material_of = {1, 1};
  CHECK(reports(validate(folded, 2), "tets 0 and 1 are on the same side of face (0, 1, 2)"));
}

TEST_CASE("validate: tet meshes with bad indices are refused", "[mesh][unit]") {
  TetMesh mesh = simple_meshes::two_material_cube();
  mesh.tets[1][2] = 8;
  CHECK(reports(validate(mesh, 3), "tet 1 "));
  mesh = simple_meshes::two_material_cube();
  mesh.material_of[4] = kExterior;
  CHECK(reports(validate(mesh, 3), "tet 4 of material 0"));
  mesh = simple_meshes::two_material_cube();
  mesh.surface.points[2].x += 1e-9;
  CHECK(reports(validate(mesh, 3), "not those of its surface"));
}
