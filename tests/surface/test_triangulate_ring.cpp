// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/surface/triangulate_ring.h"

#include "support/catch.h"
#include <algorithm>
#include <cmath>
#include <numbers>

using namespace cvmesh;

namespace {

constexpr SurfaceObjective kObjective{0.25};

RingProblem flat_ring(std::vector<Vec3> ring) {
  RingProblem problem;
  problem.normal = {0, 0, 1};
  problem.outer_normals.assign(ring.size(), {});
  problem.forbidden_edges.assign(ring.size(), 0);
  problem.ring = std::move(ring);
  return problem;
}

bool has_diagonal(const MaterialSurfaces::Triangulation& triangles, int i, int j) {
  return std::any_of(triangles.begin(), triangles.end(), [&](const auto& t) {
    return std::count(t.begin(), t.end(), i) + std::count(t.begin(), t.end(), j) == 2;
  });
}

}  // namespace

TEST_CASE("triangulate_ring: a flat ring gets the better shaped diagonal", "[surface][unit]") {
  // a kite whose short diagonal (1, 3) makes two good triangles
  const auto triangles =
      triangulate_ring(flat_ring({{0, -2, 0}, {1, 0, 0}, {0, 2, 0}, {-1, 0, 0}}), {}, kObjective);
  REQUIRE(triangles);
  CHECK(triangles->size() == 2);
  CHECK(has_diagonal(*triangles, 1, 3));
}

TEST_CASE("triangulate_ring: forbidden edges and triangles are not used", "[surface][unit]") {
  RingProblem problem = flat_ring({{0, -2, 0}, {1, 0, 0}, {0, 2, 0}, {-1, 0, 0}});
  problem.forbidden_edges[1] |= 1U << 3;
  problem.forbidden_edges[3] |= 1U << 1;
  const auto triangles = triangulate_ring(problem, {}, kObjective);
  REQUIRE(triangles);
  CHECK(has_diagonal(*triangles, 0, 2));
  problem.forbidden_triangles.push_back({0, 1, 2});
  CHECK_FALSE(triangulate_ring(problem, {}, kObjective));
}

TEST_CASE("triangulate_ring: samples far from one diagonal choose the other", "[surface][unit]") {
  // a roof: corners 0 and 2 up, 1 and 3 down; shape prefers nothing, the sample on the ridge
  // decides
  RingProblem problem = flat_ring({{1, 0, 1}, {0, 1, 0}, {-1, 0, 1}, {0, -1, 0}});
  problem.samples = {{0, 0, 1}};
  auto triangles = triangulate_ring(problem, {0.01, -1, -1}, kObjective);
  REQUIRE(triangles);
  CHECK(has_diagonal(*triangles, 0, 2));
  problem.samples = {{0, 0, 0}};
  triangles = triangulate_ring(problem, {0.01, -1, -1}, kObjective);
  REQUIRE(triangles);
  CHECK(has_diagonal(*triangles, 1, 3));
}

TEST_CASE("triangulate_ring: a star-shaped ring is filled without overlap", "[surface][property]") {
  std::vector<Vec3> ring;
  double area = 0;
  for (int i = 0; i < 14; ++i) {
    const double a = 2 * std::numbers::pi * i / 14, r = i % 2 == 0 ? 2 : 1;
    ring.push_back({r * std::cos(a), r * std::sin(a), 0});
  }
  for (std::size_t i = 0; i < ring.size(); ++i)
    area += cross(ring[i], ring[(i + 1) % ring.size()]).z;
  const auto triangles = triangulate_ring(flat_ring(ring), {0.001, 0.0, -1}, kObjective);
  REQUIRE(triangles);
  CHECK(triangles->size() == 12);
  double filled = 0;
  for (const auto& t : *triangles) {
    const double z = area_vector2(ring[t[0]], ring[t[1]], ring[t[2]]).z;
    CHECK(z > 0);
    filled += z;
  }
  CHECK(filled == Approx(area));
}
