// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include <cstddef>
#include <vector>

namespace cvmesh {

/// A set of values in a few numbers. All zero when the set is empty. `standard_deviation` divides
/// by the count; percentile p is the value at place floor(p / 100 * count) of the sorted set.
struct Distribution {
  std::size_t count = 0;
  double min = 0, max = 0, mean = 0, standard_deviation = 0;
  double p1 = 0, p5 = 0, p25 = 0, p50 = 0, p75 = 0, p95 = 0, p99 = 0;
};

/// The distribution of `values`, the same to the last bit at any number of threads and for any
/// order of the values. O(n log n).
Distribution describe(std::vector<double> values);

}  // namespace cvmesh
