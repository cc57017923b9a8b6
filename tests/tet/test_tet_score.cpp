// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/tet/tet_score.h"

#include "support/catch.h"
#include <array>
#include <cmath>
#include <cstddef>
#include <optional>
#include <random>

using namespace cvmesh;

namespace {

using Corners = std::array<Vec3, 4>;

Corners random_tet(std::mt19937_64& random) {
  std::uniform_real_distribution<double> coordinate(-1, 1);
  Corners corners;
  for (Vec3& corner : corners)
    for (int axis = 0; axis < 3; ++axis)
      corner[axis] = coordinate(random);
  return corners;
}

TetScore score(const Corners& t, double floor) {
  return score_tet(t[0], t[1], t[2], t[3], floor);
}

std::optional<std::array<TetScore, 2>> score_both(const Corners& s,
                                                  const Corners& t,
                                                  double floor) {
  return score_two_tets({s[0], t[0]}, {s[1], t[1]}, {s[2], t[2]}, {s[3], t[3]}, floor);
}

}  // namespace

TEST_CASE("score_tet: a regular tet, a corner of a cube", "[tet][unit]") {
  const TetScore regular = score({{{1, 1, 1}, {-1, 1, -1}, {1, -1, -1}, {-1, -1, 1}}}, 0);
  CHECK(regular.radius_ratio == Approx(1));
  CHECK(regular.min_sine == Approx(std::sqrt(8.0) / 3));  // acos(1/3)
  // Right angles at the cube's edges, atan(sqrt 2) at the others; 2 r = 1 - 1 / sqrt 3, R = its
  // half diagonal.
  const TetScore corner = score({{{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}}}, 0);
  CHECK(corner.min_sine == Approx(std::sqrt(2.0 / 3)));
  CHECK(corner.radius_ratio == Approx(3 / (3 + std::sqrt(3.0)) / (std::sqrt(3.0) / 2)));
}

TEST_CASE("score_two_tets: to the last bit the scores one by one", "[tet][property]") {
  std::mt19937_64 random(4);
  const double floor = 0.1;
  std::size_t scored = 0, refused = 0;
  for (int trial = 0; trial < 20000; ++trial) {
    const Corners s = random_tet(random), t = random_tet(random);
    const TetScore of_s = score(s, floor), of_t = score(t, floor);
    const auto both = score_both(s, t, floor);
    REQUIRE(both.has_value() == (of_s.min_sine >= floor && of_t.min_sine >= floor));
    if (!both) {
      ++refused;
      continue;
    }
    ++scored;
    REQUIRE((*both)[0].min_sine == of_s.min_sine);
    REQUIRE((*both)[1].min_sine == of_t.min_sine);
    REQUIRE((*both)[0].radius_ratio == of_s.radius_ratio);
    REQUIRE((*both)[1].radius_ratio == of_t.radius_ratio);
  }
  CHECK(scored > 1000);
  CHECK(refused > 1000);
}

TEST_CASE("score_two_tets: a tet without volume, or with a face without area, is below any floor",
          "[tet][unit]") {
  const Corners good{{{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}}};
  const Corners flat{{{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {1, 1, 0}}};
  const Corners line{{{0, 0, 0}, {1, 0, 0}, {2, 0, 0}, {0, 0, 1}}};
  const Corners point{};
  CHECK(score_both(good, good, 1e-9).has_value());
  for (const Corners& bad : {flat, line, point}) {
    CHECK_FALSE(score_both(good, bad, 1e-9).has_value());
    CHECK_FALSE(score_both(bad, good, 1e-9).has_value());
  }
}

TEST_CASE("min_dihedral_sines: to the last bit the sines one by one, inverted tets too",
          "[tet][property]") {
  std::mt19937_64 random(5);
  std::size_t inverted = 0;
  const auto check = [&](const Corners& s, const Corners& t, const Vec3& apex) {
    const BaseTerms<Vec3Pair> bases({s[0], t[0]}, {s[1], t[1]}, {s[2], t[2]});
    const DoublePair sines = min_dihedral_sines(bases, apex);
    REQUIRE(sines[0] == min_dihedral_sine(s[0], s[1], s[2], apex));
    REQUIRE(sines[1] == min_dihedral_sine(t[0], t[1], t[2], apex));
    if (sines[0] < 0) ++inverted;
  };
  for (int trial = 0; trial < 5000; ++trial) {
    const Corners s = random_tet(random), t = random_tet(random);
    check(s, t, s[3]);
    check(s, t, s[0]);  // no volume
  }
  const Vec3 o{0, 0, 0}, x{1, 0, 0};
  check({o, x, {2, 0, 0}, o}, {o, o, o, o}, {0, 0, 1});  // bases without area
  CHECK(inverted > 1000);
}
