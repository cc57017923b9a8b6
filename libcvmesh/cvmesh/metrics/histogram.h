// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include <algorithm>
#include <cstddef>
#include <vector>

namespace cvmesh {

/// Weights of values, gathered in bins of equal width over [lo, hi]. A value beyond an end counts
/// in the bin at that end, so that the weights always sum up to what was added.
struct Histogram {
  double lo, hi;
  std::vector<double> weights;

  /// @param high   above `low`
  /// @param bins   at least one
  Histogram(double low, double high, std::size_t bins) : lo(low), hi(high), weights(bins, 0.0) {}

  void add(double value, double weight = 1) {
    const double last = static_cast<double>(weights.size() - 1);
    const double place = (value - lo) / (hi - lo) * static_cast<double>(weights.size());
    weights[static_cast<std::size_t>(std::clamp(place, 0.0, last))] += weight;
  }
};

}  // namespace cvmesh
