// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/core/random.h"
#include "cvmesh/mesh/flat_triangle.h"

#include "support/catch.h"
#include <cmath>
#include <cstdint>

using namespace cvmesh;
using Catch::Matchers::WithinAbs;

namespace {

/// Random vectors, each coordinate within +-0.5.
class Draws {
 public:
  Vec3 operator()() {
    return {random_.uniform(draw_++) - 0.5, random_.uniform(draw_++) - 0.5,
            random_.uniform(draw_++) - 0.5};
  }

 private:
  CounterRandom random_{5, "triangles"};
  std::uint64_t draw_ = 0;
};

double exact(const Vec3& p, const Vec3& a, const Vec3& b, const Vec3& c) {
  return norm(p - nearest_on_triangle(p, a, b, c));
}

void check_both_lanes(Draws& draws, const Vec3& a, const Vec3& b, const Vec3& c, double margin) {
  const FlatTriangle triangle(a, b, c);
  for (int trial = 0; trial < 50; ++trial) {
    const Vec3 p = a + 4 * draws(), q = (a + b + c) / 3 + 0.5 * draws();
    const DoublePair squared = triangle.squared_distance({p, q});
    CHECK_THAT(std::sqrt(squared[0]), WithinAbs(exact(p, a, b, c), margin));
    CHECK_THAT(std::sqrt(squared[1]), WithinAbs(exact(q, a, b, c), margin));
  }
}

}  // namespace

TEST_CASE("FlatTriangle: agrees with nearest_on_triangle", "[mesh][property]") {
  Draws draws;
  for (int trial = 0; trial < 200; ++trial) {
    const Vec3 origin = 1000 * draws();
    check_both_lanes(draws, origin + draws(), origin + draws(), origin + draws(), 1e-9);
  }
}

TEST_CASE("FlatTriangle: thin triangles, segments and points", "[mesh][property]") {
  Draws draws;
  for (const double thickness : {1e-2, 1e-4, 1e-5, 1e-6, 1e-7, 1e-12, 0.0}) {
    CAPTURE(thickness);
    for (int trial = 0; trial < 20; ++trial) {
      const Vec3 a = 100 * draws(), b = a + draws(), nearly_a = a + thickness * draws();
      check_both_lanes(draws, a, b, nearly_a, 1e-7);                             // a needle
      check_both_lanes(draws, a, b, 0.5 * (a + b) + thickness * draws(), 1e-7);  // a blade
      check_both_lanes(draws, nearly_a, a + thickness * draws(), b, 1e-7);       // from its eye
    }
    const Vec3 a = draws();
    check_both_lanes(draws, a, a + thickness * draws(), a + thickness * draws(), 1e-7);
  }
}

TEST_CASE("FlatTriangle: above a face, beside an edge, beyond a corner", "[mesh][unit]") {
  const FlatTriangle triangle({0, 0, 0}, {3, 0, 0}, {0, 4, 0});
  const auto squared = [&](const Vec3& p) { return triangle.squared_distance({p, {9, 9, 9}})[0]; };
  CHECK_THAT(squared({1, 1, 2}), WithinAbs(4, 1e-12));
  CHECK_THAT(squared({1, 1, 0}), WithinAbs(0, 1e-12));
  CHECK_THAT(squared({1, -2, 1}), WithinAbs(5, 1e-12));
  CHECK_THAT(squared({-3, 2, 0}), WithinAbs(9, 1e-12));
  CHECK_THAT(squared({5, -1, 2}), WithinAbs(9, 1e-12));   // beyond b
  CHECK_THAT(squared({-1, 6, 2}), WithinAbs(9, 1e-12));   // beyond c
  CHECK_THAT(squared({-1, -2, 2}), WithinAbs(9, 1e-12));  // beyond a
}
