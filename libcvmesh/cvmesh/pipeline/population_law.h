// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include <algorithm>
#include <cmath>

namespace cvmesh {

/// Leads a search for sizes that end in a wanted number of particles.
///
/// Curves, loops and small parts get particles that the sizes do not know of, and nearly as many at
/// other sizes. So the number of particles is taken for a line over the number that the sizes are
/// expected to give, of slope 1 until two rounds have told another. A power law of epsilon, which
/// the expected number follows, took a round more where such particles are many.
class PopulationLaw {
 public:
  /// @param tolerance  relative, on the number
  PopulationLaw(double wanted, double tolerance)
      : wanted_(wanted), tolerance_(tolerance), to_expect_(wanted) {}

  /// What the next sizes should be expected to give.
  [[nodiscard]] double to_expect() const { return to_expect_; }

  /// Takes in how many particles there were, of how many that were expected.
  /// @return  whether other sizes may come nearer to what is wanted
  bool learn(double expected, double count) {
    // The coarser the sizes are, the more particles there are that they do not know of.
    if (count - expected > (1 + tolerance_) * wanted_) return false;
    if (has_last_) {
      const double step = expected - last_expected_;
      // Where bounds of the edges leave no other sizes.
      if (std::abs(step) < tolerance_ / 8 * wanted_) return false;
      slope_ = std::clamp((count - last_count_) / step, kLeastSlope, kMostSlope);
    }
    has_last_ = true;
    last_expected_ = expected;
    last_count_ = count;
    to_expect_ = std::max(expected + (wanted_ - count) / slope_, kLeastShare * wanted_);
    return true;
  }

 private:
  static constexpr double kLeastSlope = 0.25, kMostSlope = 2, kLeastShare = 0.05;

  double wanted_, tolerance_, to_expect_, slope_ = 1;
  bool has_last_ = false;
  double last_expected_ = 0, last_count_ = 0;
};

}  // namespace cvmesh
