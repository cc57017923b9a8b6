// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/core/random.h"
#include "cvmesh/tet/second_order.h"
#include "cvmesh/tet/tetrahedralize.h"

#include "support/catch.h"
#include "tet/shapes.h"
#include <algorithm>
#include <cmath>
#include <map>
#include <set>
#include <vector>

using namespace cvmesh;
using namespace cvmesh::shapes;

namespace {

const Vec3 kCentre{20, 20, 20};
constexpr std::size_t kEdges[6][2] = {{0, 1}, {1, 2}, {2, 0}, {0, 3}, {1, 3}, {2, 3}};

std::size_t at(std::int32_t index) {
  return static_cast<std::size_t>(index);
}

TetMesh filled(const InterfaceMesh& surface, std::size_t materials, double h) {
  find_helper();
  return tetrahedralize(surface, materials, sizing({40, 40, 40}, [&](const Vec3&) { return h; }),
                        {}, silent_context())
      .tets;
}

/// The Jacobian determinant of a quadratic tet at barycentric coordinates, over six volumes.
double jacobian_at(const std::array<Vec3, 4>& p,
                   const std::array<Vec3, 6>& m,
                   const std::array<double, 4>& b) {
  // N_k = b_k (2 b_k - 1) at the corners, 4 b_i b_j on the edges; derivatives along b_1, b_2, b_3
  // with b_0 = 1 - b_1 - b_2 - b_3.
  std::array<Vec3, 3> d;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const auto slope = [&](std::size_t k) { return k == axis + 1 ? 1.0 : k == 0 ? -1.0 : 0.0; };
    for (std::size_t k = 0; k < 4; ++k)
      d[axis] += (4 * b[k] - 1) * slope(k) * p[k];
    for (std::size_t e = 0; e < 6; ++e) {
      const auto [i, j] = kEdges[e];
      d[axis] += 4 * (slope(i) * b[j] + b[i] * slope(j)) * m[e];
    }
  }
  return dot(d[0], cross(d[1], d[2])) / volume6(p[0], p[1], p[2], p[3]);
}

}  // namespace

TEST_CASE("make_second_order: one node in the middle of every edge", "[tet][unit]") {
  TetMesh mesh = filled(sphere(kCentre, 15, 2, {1, 0}), 2, 6);
  const SecondOrderStats stats = make_second_order(mesh, nullptr, silent_context());
  CHECK(stats.moved == 0);
  CHECK(stats.least_jacobian == Approx(1));
  REQUIRE(mesh.mid_of.size() == mesh.tets.size());
  CHECK(stats.mid_nodes == mesh.mid_points.size());
  std::map<std::int32_t, std::set<std::int32_t>> ends_of;
  for (std::size_t t = 0; t < mesh.tets.size(); ++t)
    for (std::size_t e = 0; e < 6; ++e) {
      const std::int32_t a = mesh.tets[t][kEdges[e][0]], b = mesh.tets[t][kEdges[e][1]];
      const std::int32_t n = mesh.mid_of[t][e];
      CHECK(distance(mesh.mid_points[at(n)], (mesh.points[at(a)] + mesh.points[at(b)]) / 2) <
            1e-12);
      ends_of[n].insert({a, b});
    }
  CHECK(ends_of.size() == mesh.mid_points.size());  // none unused
  for (const auto& [n, ends] : ends_of)
    CHECK(ends.size() == 2);  // none shared by two edges
}

TEST_CASE("make_second_order: nodes of a sphere's edges move onto the dense sphere",
          "[tet][unit]") {
  const InterfaceMesh dense = sphere(kCentre, 15, 5, {1, 0});
  TetMesh mesh = filled(sphere(kCentre, 15, 1, {1, 0}), 2, 8);
  const SecondOrderStats stats = make_second_order(mesh, &dense, silent_context());
  CHECK(stats.moved == 120);  // the edges of 80 facets
  CHECK(stats.held_back == 0);
  CHECK(stats.least_jacobian > 0.1);
  double farthest = 0;
  for (std::size_t t = 0; t < mesh.tets.size(); ++t)
    for (std::size_t e = 0; e < 6; ++e) {
      const Vec3 m = mesh.mid_points[at(mesh.mid_of[t][e])];
      farthest = std::max(farthest, distance(m, kCentre));
    }
  CHECK(farthest == Approx(15).epsilon(1e-3));
  // The middles of the icosphere's chords, some 8 mm long, lie this far inside.
  CHECK(stats.max_shift_mm > 0.5);
}

TEST_CASE("make_second_order: a node whose move would fold a tet is held back", "[tet][unit]") {
  // One flat tet over a dense surface that bulges down through it.
  InterfaceMesh dense;
  dense.points = {{-9, -9, -1}, {9, -9, -1}, {0, 9, -1}};
  dense.facets = {{0, 1, 2}};
  dense.patch_of = {{{1, 0}, 0}};
  TetMesh mesh;
  mesh.points = {{0, 0, 0}, {4, 0, 0}, {0, 4, 0}, {1, 1, -0.5}};
  mesh.tets = {{0, 2, 1, 3}};
  mesh.material_of = {1};
  REQUIRE(volume6(mesh.points[0], mesh.points[2], mesh.points[1], mesh.points[3]) > 0);
  mesh.surface.points = mesh.points;
  mesh.surface.facets = {{0, 1, 2}};
  mesh.surface.patch_of = {{{1, 0}, 0}};
  const SecondOrderStats stats = make_second_order(mesh, &dense, silent_context());
  CHECK(stats.held_back > 0);
  CHECK(stats.least_jacobian >= 0.1);
}

TEST_CASE("make_second_order: nodes on the border of the image and on curves keep their place",
          "[tet][unit]") {
  // Two boxes with a common wall; a dense surface of the same patches, two further up.
  const InterfaceMesh surface =
      join(box({10, 10, 10}, {20, 20, 20}, 1, {1, 0}), box({20, 10, 10}, {30, 20, 20}, 1, {2, 0}));
  InterfaceMesh walled = surface;
  for (PatchKey& patch : walled.patch_of)
    if (patch.sides.outside == 0) patch.wall = 5;
  TetMesh mesh = filled(walled, 3, 10);
  InterfaceMesh dense = walled;
  for (Vec3& p : dense.points)
    p = p + Vec3{1, 0, 0};
  const SecondOrderStats stats = make_second_order(mesh, &dense, silent_context());
  // Only the diagonal inside the common wall may move, and it does, by the whole shift.
  CHECK(stats.moved == 1);
  CHECK(stats.max_shift_mm == Approx(1));
}

TEST_CASE("least_jacobian: a lower bound of the determinant everywhere inside", "[tet][unit]") {
  const std::array<Vec3, 4> p{{{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}}};
  std::array<Vec3, 6> straight;
  for (std::size_t e = 0; e < 6; ++e)
    straight[e] = (p[kEdges[e][0]] + p[kEdges[e][1]]) / 2;
  CHECK(least_jacobian(p, straight) == Approx(1));

  const CounterRandom random(7, "least_jacobian");
  std::uint64_t draw = 0;
  int folded = 0;
  for (int trial = 0; trial < 50; ++trial) {
    std::array<Vec3, 6> mids = straight;
    for (Vec3& m : mids)
      for (int axis = 0; axis < 3; ++axis)
        m[axis] += 0.3 * (random.uniform(draw++) - 0.5);
    const double bound = least_jacobian(p, mids);
    double least = 1e9;
    constexpr int kSteps = 12;
    for (int i = 0; i <= kSteps; ++i)
      for (int j = 0; i + j <= kSteps; ++j)
        for (int k = 0; i + j + k <= kSteps; ++k) {
          const double s = kSteps;
          least = std::min(least, jacobian_at(p, mids, {1 - (i + j + k) / s, i / s, j / s, k / s}));
        }
    CHECK(bound <= least + 1e-12);
    CHECK(least - bound < 0.8);  // and not a useless one
    folded += least < 0 ? 1 : 0;
  }
  CHECK(folded > 0);
}
