// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/metrics/distance_samples.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

namespace cvmesh {

void DistanceSamples::add(std::span<const float> distances, float weight) {
  runs_.push_back({distances, weight});
}

DistanceStats DistanceSamples::stats() const {
  DistanceStats stats;
  double weight = 0, weight2 = 0, first = 0, largest = 0;
  for (const Run& run : runs_) {
    double sum = 0;
    for (const float d : run.distances) {
      sum += d;
      largest = std::max(largest, double{d});
    }
    const auto count = static_cast<double>(run.distances.size());
    stats.samples += run.distances.size();
    weight += run.weight * count;
    weight2 += run.weight * run.weight * count;
    first += run.weight * sum;
  }
  if (!(weight > 0)) return stats;
  stats.mean = first / weight;
  double second = 0;  // around the mean, so that nearly equal distances lose no digits
  for (const Run& run : runs_) {
    double sum = 0;
    for (const float d : run.distances)
      sum += (d - stats.mean) * (d - stats.mean);
    second += run.weight * sum;
  }
  const double variance = second / weight;
  stats.rms = std::sqrt(stats.mean * stats.mean + variance);
  stats.mean_standard_error = std::sqrt(variance * weight2) / weight;
  stats.p95 = quantile(0.95, largest, weight);
  return stats;
}

double DistanceSamples::quantile(double share, double largest, double total_weight) const {
  constexpr std::size_t kBins = 4096;
  const auto bin_of = [&](float d) {
    return largest > 0 ? std::min(kBins - 1, static_cast<std::size_t>(d / largest * kBins)) : 0;
  };
  // First the bin in which the quantile lies, then its samples in order.
  std::array<double, kBins> weight_of{};
  for (const Run& run : runs_)
    for (const float d : run.distances)
      weight_of[bin_of(d)] += run.weight;
  double below = 0;
  std::size_t bin = 0;
  while (bin + 1 < kBins && below + weight_of[bin] < share * total_weight)
    below += weight_of[bin++];
  std::vector<std::pair<float, double>> samples;
  for (const Run& run : runs_)
    for (const float d : run.distances)
      if (bin_of(d) == bin) samples.emplace_back(d, run.weight);
  std::sort(samples.begin(), samples.end());
  for (const auto& [d, weight] : samples) {
    below += weight;
    if (below >= share * total_weight) return d;
  }
  return samples.empty() ? largest : samples.back().first;
}

}  // namespace cvmesh
