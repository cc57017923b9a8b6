// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/pipeline/find_epsilon.h"
#include "cvmesh/pipeline/population_law.h"

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

TEST_CASE("PopulationLaw: two rounds where the rest is nearly the same at all sizes",
          "[pipeline][unit]") {
  // a pelvis at 60,000: particles that the sizes do not know of, and of these more where h is large
  const auto particles = [](double expected) {
    return expected + 9200 + 0.03 * (60000 - expected);
  };
  PopulationLaw law(60000, 0.02);
  CHECK(law.to_expect() == 60000);
  REQUIRE(law.learn(60144, particles(60144)));
  CHECK(particles(law.to_expect()) == Approx(60000).epsilon(0.01));
}

TEST_CASE("PopulationLaw: steep and flat laws are solved in few rounds", "[pipeline][unit]") {
  for (const double slope : {0.3, 0.7, 1.0, 1.2})
    for (const double wanted : {700.0, 1000.0, 3000.0}) {
      CAPTURE(slope, wanted);
      const auto particles = [&](double expected) { return 500 + slope * expected; };
      PopulationLaw law(wanted, 0.02);
      double count = 0;
      int rounds = 0;
      do {
        const double expected = law.to_expect();
        count = particles(expected);
        ++rounds;
        REQUIRE(law.learn(expected, count));
      } while (std::abs(count - wanted) > 0.02 * wanted);
      CHECK(rounds <= 3);
    }
}

TEST_CASE("PopulationLaw: ends where no sizes help", "[pipeline][unit]") {
  PopulationLaw small_parts(1000, 0.02);
  CHECK_FALSE(small_parts.learn(900, 2000));  // the small parts alone are too many
  PopulationLaw bounds(1000, 0.02);
  CHECK(bounds.learn(1500, 1500));
  CHECK_FALSE(bounds.learn(1499, 1499));  // asked for 1000: edges may not be longer
  PopulationLaw tiny(1000, 0.02);
  CHECK(tiny.learn(60, 1070));
  CHECK(tiny.to_expect() == 50);  // never nothing
}
