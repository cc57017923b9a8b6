// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/pipeline/find_epsilon.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace cvmesh {

namespace {

/// Clamped sizes and guard particles flatten the law; a flatter slope than this is noise.
constexpr double kFlattestSlope = -0.2;
/// The secant of two close counts may point anywhere: never more than this factor in one step.
constexpr double kLargestLogStep = 2.1;

struct Trial {
  double log_epsilon, log_ratio;  ///< ratio: count over target
};

/// The slope from one trial to the next; `known` where they do not show any.
double slope_between(const Trial& last, const Trial& before, double known) {
  const double span = last.log_epsilon - before.log_epsilon;
  const double slope = span == 0 ? known : (last.log_ratio - before.log_ratio) / span;
  return slope < kFlattestSlope ? slope : known;
}

double next_log_epsilon(const Trial& last, double slope, double low, double high) {
  const double step = std::clamp(-last.log_ratio / slope, -kLargestLogStep, kLargestLogStep);
  const double next = last.log_epsilon + step;
  const bool is_bracketed = std::isfinite(low) && std::isfinite(high);
  return is_bracketed && (next <= low || next >= high) ? (low + high) / 2 : next;
}

}  // namespace

CountSearchResult find_epsilon(const std::function<double(double)>& count_at,
                               const CountSearchOptions& options) {
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  CountSearchResult best;
  double best_error = kInfinity;
  double low = -kInfinity, high = kInfinity;  // log epsilon: too many below, too few above
  Trial last{std::log(options.start), 0}, before = last;
  double log_epsilon = last.log_epsilon;
  for (int round = 1; round <= options.max_rounds && !best.is_reached; ++round) {
    const double epsilon = std::exp(log_epsilon);
    const double count = count_at(epsilon);
    const double error = std::abs(count - options.target) / options.target;
    best.rounds = round;
    if (error < best_error) {
      best_error = error;
      best.epsilon = epsilon;
      best.count = count;
    }
    best.is_reached = error <= options.tolerance;
    if (!best.is_reached && options.is_out_of_reach && options.is_out_of_reach()) break;

    before = round == 1 ? Trial{log_epsilon, 0} : last;
    last = {log_epsilon, std::log(std::max(count, 1.0) / options.target)};
    if (last.log_ratio > 0)
      low = std::max(low, log_epsilon);
    else
      high = std::min(high, log_epsilon);
    best.slope = slope_between(last, before, options.slope);
    log_epsilon = next_log_epsilon(last, best.slope, low, high);
  }
  return best;
}

}  // namespace cvmesh
