// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/pipeline/find_epsilon.h"

#include "support/catch.h"
#include <cmath>

using namespace cvmesh;

TEST_CASE("find_epsilon: a power law is solved in three rounds", "[pipeline][unit]") {
  const auto count = [](double epsilon) { return 5000 * std::pow(epsilon, -1.7); };
  const CountSearchResult found = find_epsilon(count, {.target = 1000});
  CHECK(found.is_reached);
  CHECK(found.rounds <= 4);
  CHECK(std::abs(found.count - 1000) <= 20);
  CHECK(found.epsilon == Approx(std::pow(5.0, 1 / 1.7)).epsilon(0.02));
}

TEST_CASE("find_epsilon: with a good start and its slope the second round is there",
          "[pipeline][unit]") {
  const auto count = [](double epsilon) { return 5000 * std::pow(epsilon, -1.2); };
  const double near = std::pow(5.15, 1 / 1.2);  // 3 % off
  const CountSearchResult found =
      find_epsilon(count, {.target = 1000, .start = near, .slope = -1.2, .tolerance = 0.001});
  CHECK(found.is_reached);
  CHECK(found.rounds == 2);
  CHECK(found.slope == Approx(-1.2));
}

TEST_CASE("find_epsilon: guards and clamps that flatten the law are coped with",
          "[pipeline][unit]") {
  // 400 vertices on corners and curves whatever epsilon is, and no more than 90,000.
  const auto count = [](double epsilon) {
    return std::floor(std::min(90000.0, 400 + 3000 / (epsilon * epsilon)));
  };
  for (const double target : {450.0, 2000.0, 40000.0}) {
    INFO(target);
    const CountSearchResult found = find_epsilon(count, {.target = target, .max_rounds = 12});
    CHECK(found.is_reached);
    CHECK(std::abs(found.count - target) <= 0.02 * target);
  }
}

TEST_CASE("find_epsilon: ends with the nearest count once the target is known to be out of reach",
          "[pipeline][unit]") {
  // 400 vertices whatever epsilon is, which the third round tells.
  int rounds = 0;
  const auto count = [&](double epsilon) {
    ++rounds;
    return 400 + 3000 / (epsilon * epsilon);
  };
  const CountSearchResult found =
      find_epsilon(count, {.target = 200, .is_out_of_reach = [&] { return rounds == 3; }});
  CHECK_FALSE(found.is_reached);
  CHECK(found.rounds == 3);
  CHECK(found.count == count(found.epsilon));
  CHECK(found.count < count(1));
}

TEST_CASE("find_epsilon: what cannot be reached ends with the nearest count", "[pipeline][unit]") {
  const auto count = [](double epsilon) { return 400 + 3000 / (epsilon * epsilon); };
  const CountSearchResult found = find_epsilon(count, {.target = 100, .max_rounds = 8});
  CHECK_FALSE(found.is_reached);
  CHECK(found.rounds == 8);
  CHECK(found.count < 402);
}
