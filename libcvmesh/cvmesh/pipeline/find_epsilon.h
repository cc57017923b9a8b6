// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include <functional>

namespace cvmesh {

struct CountSearchOptions {
  double target = 0;
  double start = 1;         ///< first epsilon tried
  double slope = -2;        ///< of log count over log epsilon, as far as known: that of areas
  double tolerance = 0.02;  ///< relative, on the count
  int max_rounds = 8;       ///< evaluations of the count
  /// Asked after every round that missed the target: whether no epsilon will do. Then that is it.
  std::function<bool()> is_out_of_reach{};
};

struct CountSearchResult {
  double epsilon = 0;  ///< the one whose count came nearest to the target
  double count = 0;
  double slope = -2;  ///< of log count over log epsilon, near the end of the search
  int rounds = 0;
  bool is_reached = false;  ///< within the tolerance
};

/// The epsilon at which `count_at(epsilon)` is the target, for a count that falls with epsilon.
///
/// Secant steps of log count over log epsilon, where the count is nearly a power law; once the
/// target is bracketed, a step that leaves the bracket becomes a bisection.
CountSearchResult find_epsilon(const std::function<double(double)>& count_at,
                               const CountSearchOptions& options);

}  // namespace cvmesh
