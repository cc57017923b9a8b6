// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/tet/star_scores.h"
#include "cvmesh/tet/tet_score.h"

#include "support/catch.h"
#include <array>
#include <limits>
#include <random>
#include <vector>

using namespace cvmesh;

namespace {

using Face = std::array<Vec3, 3>;

constexpr double kNoFloor = -std::numeric_limits<double>::infinity();

Vec3 random_point(std::mt19937_64& random) {
  std::uniform_real_distribution<double> coordinate(-1, 1);
  const double x = coordinate(random), y = coordinate(random), z = coordinate(random);
  return {x, y, z};
}

/// Faces that see p on their inner side, or not.
std::vector<Face> random_faces(std::size_t count, std::mt19937_64& random) {
  std::vector<Face> faces(count);
  for (Face& face : faces)
    for (Vec3& corner : face)
      corner = random_point(random);
  return faces;
}

StarScores star_of(const std::vector<Face>& faces) {
  StarScores star;
  for (const auto& [a, b, c] : faces)
    star.add(a, b, c);
  return star;
}

TetQuality one_by_one(const std::vector<Face>& faces, const Vec3& p) {
  TetQuality quality;
  for (const auto& [a, b, c] : faces)
    quality.add(score_tet(p, a, b, c));
  return quality;
}

}  // namespace

TEST_CASE("StarScores: stars are scored as their tets are one by one", "[tet][property]") {
  std::mt19937_64 random(1);
  std::size_t upright = 0;
  for (std::size_t count = 1; count < 40; ++count) {
    const std::vector<Face> faces = random_faces(count, random);
    const StarScores star = star_of(faces);
    for (int place = 0; place < 20; ++place) {
      const Vec3 p = random_point(random);
      const TetQuality all = star.quality_at(p, kNoFloor), wanted = one_by_one(faces, p);
      CHECK(all.count == count);
      CHECK((all.worst > 0) == (wanted.worst > 0));
      if (wanted.worst > 0) ++upright;
      if (wanted.worst > 0) CHECK(all.worst == Approx(wanted.worst).epsilon(1e-9));
      CHECK(all.sum == Approx(wanted.sum).epsilon(1e-9).margin(1e-12));
    }
  }
  CHECK(upright > 10);
}

TEST_CASE("StarScores: a regular tet, from its centre and its corners", "[tet][unit]") {
  const Vec3 a{1, 1, 1}, b{1, -1, -1}, c{-1, 1, -1}, d{-1, -1, 1};
  // Counter-clockwise from outside the tet: away from the fourth corner.
  const StarScores star = star_of({{a, b, c}, {a, c, d}, {a, d, b}, {b, d, c}});
  const TetQuality centre = star.quality_at({0, 0, 0}, kNoFloor);
  const TetScore part = score_tet({0, 0, 0}, a, b, c);
  CHECK(part.radius_ratio > 0);
  CHECK(centre.worst == Approx(part.min_sine));
  CHECK(centre.mean() == Approx(part.radius_ratio));
  CHECK(star_of({{b, d, c}}).quality_at(a, kNoFloor).mean() == Approx(1));
}

TEST_CASE("StarScores: flat, inverted and degenerate tets are as bad as can be", "[tet][unit]") {
  const Vec3 a{1, 0, 0}, b{0, 1, 0}, c{0, 0, 1}, below{0, 0, 0}, above{1, 1, 1};
  const StarScores star = star_of({{a, b, c}});
  CHECK(star.quality_at(below, kNoFloor).worst > 0);
  CHECK(star.quality_at(above, kNoFloor).worst < 0);
  CHECK_FALSE(star.quality_at({1. / 2, 1. / 2, 0}, kNoFloor).worst > 1e-12);
  CHECK_FALSE(star.quality_at(a, kNoFloor).worst > 0);
  CHECK_FALSE(star_of({{a, a, b}}).quality_at(c, kNoFloor).worst > 0);
  CHECK(star_of({{a, a, b}}).quality_at(c, kNoFloor).sum == 0);
}

TEST_CASE("StarScores: scoring stops below the floor, and room is used again", "[tet][unit]") {
  std::mt19937_64 random(2);
  StarScores star = star_of(random_faces(40, random));
  CHECK(star.quality_at(random_point(random), 0.5).count < 40);
  star.clear();
  star.add({1, 0, 0}, {0, 1, 0}, {0, 0, 1});
  const TetQuality one = star.quality_at({0, 0, 0}, 0.1);
  CHECK(one.count == 1);
  CHECK(one.worst == Approx(score_tet({0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}).min_sine));
}
