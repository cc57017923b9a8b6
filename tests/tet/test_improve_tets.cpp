// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/mesh/validate.h"
#include "cvmesh/tet/improve_tets.h"
#include "cvmesh/tet/tetrahedralize.h"

#include "support/catch.h"
#include "tet/shapes.h"
#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

using namespace cvmesh;
using namespace cvmesh::shapes;

namespace {

const Vec3 kCentre{20, 20, 20};

TetMesh unimproved(const InterfaceMesh& surface, std::size_t material_count, double h) {
  find_helper();
  TetrahedralizeOptions options;
  options.improvement_passes = 0;
  return tetrahedralize(surface, material_count,
                        sizing({40, 40, 40}, [&](const Vec3&) { return h; }), options,
                        silent_context())
      .tets;
}

std::vector<double> volumes(const TetMesh& mesh, std::size_t material_count) {
  std::vector<double> sums(material_count, 0.0);
  for (std::size_t t = 0; t < mesh.tets.size(); ++t) {
    const auto corner = [&](std::size_t k) {
      return mesh.points[static_cast<std::size_t>(mesh.tets[t][k])];
    };
    sums[mesh.material_of[t]] += volume6(corner(0), corner(1), corner(2), corner(3)) / 6;
  }
  return sums;
}

double worst_quality(const TetMesh& mesh) {
  double worst = 1;
  for (const auto& tet : mesh.tets)
    worst = std::min(worst, min_dihedral_sine(mesh.points[static_cast<std::size_t>(tet[0])],
                                              mesh.points[static_cast<std::size_t>(tet[1])],
                                              mesh.points[static_cast<std::size_t>(tet[2])],
                                              mesh.points[static_cast<std::size_t>(tet[3])]));
  return worst;
}

/// Octahedron of six surface points around the z axis, cut into four slim tets around its long
/// axis, which lies inside.
TetMesh long_octahedron(double half_axis) {
  TetMesh mesh;
  mesh.points = {{1, 0, 0},  {0, 1, 0},          {-1, 0, 0},
                 {0, -1, 0}, {0, 0, -half_axis}, {0, 0, half_axis}};
  mesh.surface.points = mesh.points;
  for (std::int32_t i = 0; i < 4; ++i) {
    const std::int32_t j = (i + 1) % 4;
    mesh.tets.push_back({4, 5, i, j});
    mesh.material_of.push_back(1);
    mesh.surface.facets.push_back({i, j, 5});
    mesh.surface.facets.push_back({j, i, 4});
    mesh.surface.patch_of.resize(mesh.surface.facets.size(), {{1, 0}, 0});
  }
  return mesh;
}

}  // namespace

TEST_CASE("min_dihedral_sine: known tets", "[tet][unit]") {
  // Regular: all six angles are acos(1/3).
  CHECK(min_dihedral_sine({1, 1, 1}, {1, -1, -1}, {-1, 1, -1}, {-1, -1, 1}) ==
        Approx(-std::sqrt(8.0) / 3));
  CHECK(min_dihedral_sine({1, 1, 1}, {-1, 1, -1}, {1, -1, -1}, {-1, -1, 1}) ==
        Approx(std::sqrt(8.0) / 3));
  // The corner of a cube: three right angles, three of acos(1/sqrt 3).
  CHECK(min_dihedral_sine({0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}) ==
        Approx(std::sqrt(2.0 / 3)));
  CHECK(min_dihedral_sine({0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {1, 1, 0}) == 0);
}

TEST_CASE("improve_tets: quality rises, volumes and surface stay", "[tet][unit]") {
  const InterfaceMesh surface = join(sphere(kCentre, 16, 3, {1, 0}), sphere(kCentre, 9, 3, {2, 1}));
  const TetMesh before = unimproved(surface, 3, 2.5);
  TetMesh after = before;
  const ImproveTetsStats stats = improve_tets(after, {}, silent_context());
  CHECK(worst_quality(after) > worst_quality(before));
  CHECK(stats.min_dihedral_after_deg > stats.min_dihedral_before_deg + 5);  // measured: + 14
  CHECK(stats.max_dihedral_after_deg < stats.max_dihedral_before_deg);
  CHECK(stats.below_10_deg_after <= stats.below_10_deg_before);
  CHECK(stats.edge_removals + stats.face_flips > 0);
  CHECK(stats.moves > 0);
  const auto old_volumes = volumes(before, 3), new_volumes = volumes(after, 3);
  for (std::size_t m = 1; m < 3; ++m)
    CHECK(new_volumes[m] == Approx(old_volumes[m]).epsilon(1e-10));
  CHECK(std::equal(surface.points.begin(), surface.points.end(), after.points.begin()));
  const Validation validation = validate(after, 3);
  INFO(validation.summary());
  CHECK(validation.is_valid());
}

TEST_CASE("improve_tets: flat walls stay flat and covered", "[tet][unit]") {
  const InterfaceMesh surface =
      join(box({0, 0, 0}, {10, 10, 10}, 5, {1, 0}), box({10, 0, 0}, {20, 10, 10}, 5, {2, 0}));
  TetMesh mesh = unimproved(surface, 3, 2);
  const double before = worst_quality(mesh);
  improve_tets(mesh, {}, silent_context());
  CHECK(worst_quality(mesh) > before);
  const auto sums = volumes(mesh, 3);
  CHECK(sums[1] == Approx(1000).epsilon(1e-10));
  CHECK(sums[2] == Approx(1000).epsilon(1e-10));
  const Validation validation = validate(mesh, 3);
  INFO(validation.summary());
  CHECK(validation.is_valid());
}

TEST_CASE("improve_tets: a long edge is replaced by the better diagonal", "[tet][unit]") {
  TetMesh mesh = long_octahedron(4);
  const double before = worst_quality(mesh);
  const ImproveTetsStats stats = improve_tets(mesh, {}, silent_context());
  // Four tets around the long axis, each with an angle of 90 degrees there, but with sharp ones
  // along the rim, become four around a short diagonal.
  CHECK(stats.edge_removals == 1);
  CHECK(mesh.tets.size() == 4);
  CHECK(worst_quality(mesh) > before);
  for (const auto& tet : mesh.tets)
    CHECK_FALSE(
        (std::count(tet.begin(), tet.end(), 4) == 1 && std::count(tet.begin(), tet.end(), 5) == 1));
  CHECK(volumes(mesh, 2)[1] == Approx(2.0 * 4 * 2 / 3));
}

TEST_CASE("improve_tets: an inner vertex that lies badly moves to the middle", "[tet][unit]") {
  // One vertex inside a regular octahedron, close to a face.
  TetMesh mesh;
  mesh.points = {{1, 0, 0}, {0, 1, 0}, {-1, 0, 0}, {0, -1, 0}, {0, 0, -1}, {0, 0, 1}};
  mesh.surface.points = mesh.points;
  mesh.points.push_back({0.3, 0.3, 0.3});
  for (std::int32_t i = 0; i < 4; ++i) {
    const std::int32_t j = (i + 1) % 4;
    mesh.surface.facets.push_back({i, j, 5});
    mesh.surface.facets.push_back({j, i, 4});
  }
  for (const auto& facet : mesh.surface.facets) {
    mesh.tets.push_back({facet[0], facet[2], facet[1], 6});
    mesh.material_of.push_back(1);
    mesh.surface.patch_of.push_back({{1, 0}, 0});
  }
  ImproveTetsOptions options;
  options.flip_below_deg = 0;  // no flips: the move alone
  options.smooth_below_deg = 89;
  options.passes = 20;
  const ImproveTetsStats stats = improve_tets(mesh, options, silent_context());
  CHECK(stats.moves > 0);
  CHECK(norm(mesh.points[6]) < 0.05);  // by symmetry the best place is the centre
  CHECK(mesh.tets.size() == 8);
}

TEST_CASE("improve_tets: a new vertex helps where flips and moves cannot", "[tet][unit]") {
  // A flat disc of few facets: TetGen adds no point close to them, so tets span the whole
  // thickness (measured: smallest angle 8.2 degrees, with new vertices 21.7).
  InterfaceMesh surface = sphere({0, 0, 0}, 1, 2, {1, 0});
  for (Vec3& p : surface.points)
    p = scaled_by(p, {10, 10, 3});
  const TetMesh start = unimproved(surface, 2, 100);
  ImproveTetsOptions options;
  options.insert_below_deg = 0;
  TetMesh without = start, with = start;
  const ImproveTetsStats plain = improve_tets(without, options, silent_context());
  const ImproveTetsStats stats = improve_tets(with, {}, silent_context());
  CHECK(plain.insertions == 0);
  CHECK(stats.insertions > 0);
  CHECK(stats.min_dihedral_after_deg > plain.min_dihedral_after_deg + 5);
  CHECK(volumes(with, 2)[1] == Approx(volumes(start, 2)[1]).epsilon(1e-10));
  const Validation validation = validate(with, 2);
  INFO(validation.summary());
  CHECK(validation.is_valid());
}

TEST_CASE("improve_tets: the bound on new vertices holds", "[tet][unit]") {
  TetMesh mesh = unimproved(sphere(kCentre, 15, 3, {1, 0}), 2, 100);
  const std::size_t before = mesh.points.size();
  ImproveTetsOptions options;
  options.insert_below_deg = 80;
  options.max_insertions_per_vertex = 0.02;
  const ImproveTetsStats stats = improve_tets(mesh, options, silent_context());
  CHECK(stats.insertions == static_cast<std::size_t>(0.02 * static_cast<double>(before)));
}

TEST_CASE("improve_tets: a thin wall between two sparse sheets keeps its surface", "[tet][unit]") {
  const InterfaceMesh surface =
      join(sphere(kCentre, 15, 3, {1, 0}), sphere(kCentre, 14.5, 3, {2, 1}));
  TetMesh mesh = unimproved(surface, 3, 4);
  const double before = worst_quality(mesh);
  improve_tets(mesh, {}, silent_context());
  CHECK(worst_quality(mesh) >= before);
  const Validation validation = validate(mesh, 3);
  INFO(validation.summary());
  CHECK(validation.is_valid());
}

TEST_CASE("improve_tets: no pass changes nothing", "[tet][unit]") {
  TetMesh mesh = long_octahedron(4);
  const TetMesh before = mesh;
  ImproveTetsOptions options;
  options.passes = 0;
  improve_tets(mesh, options, silent_context());
  CHECK(mesh.tets == before.tets);
  CHECK(mesh.points == before.points);
}

TEST_CASE("improve_tets: equal input gives equal tets", "[tet][determinism]") {
  const TetMesh start = unimproved(sphere(kCentre, 15, 3, {1, 0}), 2, 3);
  TetMesh first = start, second = start;
  improve_tets(first, {}, silent_context());
  improve_tets(second, {}, silent_context());
  CHECK(first.tets == second.tets);
  CHECK(first.points == second.points);
}
