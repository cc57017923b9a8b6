// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/core/random.h"
#include "cvmesh/mesh/facet_predicates.h"

#include "support/catch.h"
#include <algorithm>
#include <array>
#include <utility>
#include <vector>

using namespace cvmesh;

namespace {

/// Distance of two triangles by dense sampling of both, an upper bound.
double sampled_distance(const std::vector<Vec3>& p, const VertexTriple& s, const VertexTriple& t) {
  constexpr int kSteps = 40;
  const auto corner = [&](const VertexTriple& v, std::size_t k) {
    return p[static_cast<std::size_t>(v[k])];
  };
  double least = 1e300;
  for (const auto& [from, to] : {std::pair(s, t), std::pair(t, s)})
    for (int i = 0; i <= kSteps; ++i)
      for (int j = 0; i + j <= kSteps; ++j) {
        const double u = double(i) / kSteps, v = double(j) / kSteps;
        const Vec3 q = (1 - u - v) * corner(from, 0) + u * corner(from, 1) + v * corner(from, 2);
        const Vec3 n = nearest_on_triangle(q, corner(to, 0), corner(to, 1), corner(to, 2));
        least = std::min(least, norm(q - n));
      }
  return least;
}

}  // namespace

TEST_CASE("are_facets_near: agrees with sampled distances", "[mesh][property]") {
  const CounterRandom random(3, "facets");
  std::uint64_t draw = 0;
  int near = 0, far = 0;
  for (int trial = 0; trial < 300; ++trial) {
    std::vector<Vec3> p(6);
    for (std::size_t v = 0; v < 6; ++v)
      for (int axis = 0; axis < 3; ++axis)
        p[v][axis] = random.uniform(draw++);
    for (std::size_t v = 3; v < 6; ++v)
      p[v].z += 0.6;
    const VertexTriple s{0, 1, 2}, t{3, 4, 5};
    if (facets_intersect(p, s, t)) continue;
    const double distance = sampled_distance(p, s, t);
    // Samples are 0.04 apart at most: the truth lies at most 0.03 below.
    if (distance < 0.1) {
      CHECK(are_facets_near(p, s, t, 0.1001));
      ++near;
    }
    if (distance > 0.14) {
      CHECK_FALSE(are_facets_near(p, s, t, 0.1));
      ++far;
    }
  }
  CHECK(near > 10);
  CHECK(far > 10);
}

TEST_CASE("are_facets_near: two edges that cross at a small distance are near", "[mesh][unit]") {
  const std::vector<Vec3> p{{-1, 0, 0},    {1, 0, 0},    {0, 0, -3},
                            {0, -1, 0.01}, {0, 1, 0.01}, {0, 0, 3}};
  CHECK(are_facets_near(p, {0, 1, 2}, {3, 4, 5}, 0.011));
  CHECK_FALSE(are_facets_near(p, {0, 1, 2}, {3, 4, 5}, 0.009));
}

TEST_CASE("are_facets_near: neighbours are near only when one is folded onto the other",
          "[mesh][unit]") {
  // A flat fan: neighbours that share an edge, and some that share a vertex.
  const std::vector<Vec3> flat{{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {-1, 0, 0}, {0, -1, 0}};
  CHECK_FALSE(are_facets_near(flat, {0, 1, 2}, {0, 2, 3}, 0.1));
  CHECK_FALSE(are_facets_near(flat, {0, 1, 2}, {0, 3, 4}, 0.1));
  // Folded over the common edge, up to a little height.
  const std::vector<Vec3> folded{{0, 0, 0}, {1, 0, 0}, {0.4, 1, 0}, {0.5, 0.8, 1e-4}};
  CHECK(are_facets_near(folded, {0, 1, 2}, {1, 0, 3}, 1e-3));
  CHECK_FALSE(are_facets_near(folded, {0, 1, 2}, {1, 0, 3}, 1e-5));
  // A square folded along a side: no vertex lies on the other facet, but the diagonals cross.
  const std::vector<Vec3> square{{0, 0, 0}, {1, 0, 0}, {1, 1, 1e-6}, {0, 1, 0}};
  CHECK(are_facets_near(square, {0, 1, 2}, {1, 0, 3}, 1e-3));
}

TEST_CASE(
    "are_facets_apart: never says so of facets that intersect or are near, and mostly where "
    "they are neither",
    "[mesh][property]") {
  const CounterRandom random(5, "apart");
  std::uint64_t draw = 0;
  // Pairs that share 0, 1 or 2 vertices, some of them flattened so that folds are common.
  const std::array<std::pair<VertexTriple, VertexTriple>, 3> pairs{
      {{{0, 1, 2}, {3, 4, 5}}, {{0, 1, 2}, {3, 1, 4}}, {{0, 1, 2}, {2, 3, 1}}}};
  for (const auto& [s, t] : pairs)
    for (const double height : {1.0, 0.05, 1e-3}) {
      int apart = 0, neither = 0;
      for (int trial = 0; trial < 3000; ++trial) {
        std::vector<Vec3> p(6);
        for (Vec3& v : p)
          v = {random.uniform(draw), random.uniform(draw + 1), height * random.uniform(draw + 2)},
          draw += 3;
        constexpr double kClearance = 0.01;
        const bool is_close = facets_intersect(p, s, t) || are_facets_near(p, s, t, kClearance);
        const bool is_apart = are_facets_apart(p, s, t, kClearance);
        CHECK(is_apart == are_facets_apart(p, t, s, kClearance));
        if (is_apart) CHECK_FALSE(is_close);
        apart += is_apart ? 1 : 0;
        neither += is_close ? 0 : 1;
      }
      INFO("shared with height " << height << ": " << apart << " of " << neither);
      CHECK(apart <= neither);
      CHECK(apart > neither / 4);
    }
}
