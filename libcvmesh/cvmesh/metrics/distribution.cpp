// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/metrics/distribution.h"

#include "cvmesh/core/parallel.h"

#include <algorithm>
#include <cmath>
#include <functional>

namespace cvmesh {

Distribution describe(std::vector<double> values) {
  Distribution result;
  result.count = values.size();
  if (values.empty()) return result;
  // Sorted first, so that the sums do not depend on the order in which the values came.
  parallel_sort(values.begin(), values.end());
  const auto n = static_cast<double>(values.size());
  result.min = values.front();
  result.max = values.back();
  result.mean =
      deterministic_reduce(
          0, values.size(), 0.0, [&](std::size_t i) { return values[i]; }, std::plus<>()) /
      n;
  const double squares = deterministic_reduce(
      0, values.size(), 0.0,
      [&](std::size_t i) {
        const double d = values[i] - result.mean;
        return d * d;
      },
      std::plus<>());
  result.standard_deviation = std::sqrt(squares / n);
  const auto percentile = [&](double p) {
    return values[std::min(values.size() - 1, static_cast<std::size_t>(p / 100 * n))];
  };
  result.p1 = percentile(1);
  result.p5 = percentile(5);
  result.p25 = percentile(25);
  result.p50 = percentile(50);
  result.p75 = percentile(75);
  result.p95 = percentile(95);
  result.p99 = percentile(99);
  return result;
}

}  // namespace cvmesh
