// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/metrics/distance_samples.h"

#include "cvmesh/core/parallel.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <utility>

namespace cvmesh {
namespace {

constexpr std::size_t kBins = 4096;
constexpr std::size_t kBlock = 65536;  // runs that are summed one after the other

struct Sums {
  double weight = 0, weight2 = 0, first = 0, largest = 0;
  std::size_t samples = 0;

  friend Sums operator+(Sums a, const Sums& b) {
    a.weight += b.weight;
    a.weight2 += b.weight2;
    a.first += b.first;
    a.largest = std::max(a.largest, b.largest);
    a.samples += b.samples;
    return a;
  }
};

Sums sums_of(const SampleRun& run) {
  const auto count = static_cast<double>(run.distances.size());
  const double weight = run.weight;
  Sums sums{weight * count, weight * weight * count, 0, 0, run.distances.size()};
  for (const float d : run.distances) {
    sums.first += d;
    sums.largest = std::max(sums.largest, double{d});
  }
  sums.first *= weight;
  return sums;
}

// Squares around the mean, so that nearly equal distances lose no digits, and the weight of the
// distances in equal steps up to the largest.
struct Spread {
  double second = 0;
  std::array<double, kBins> weight_of{};
};

std::size_t bin_of(float d, double largest) {
  return largest > 0 ? std::min(kBins - 1, static_cast<std::size_t>(d / largest * kBins)) : 0;
}

Spread spread_of(const std::vector<SampleRun>& runs, double mean, double largest) {
  std::vector<Spread> of_block((runs.size() + kBlock - 1) / kBlock);
  parallel_for_each_index(
      0, of_block.size(),
      [&](std::size_t b) {
        Spread& spread = of_block[b];
        for (std::size_t r = b * kBlock; r < std::min(runs.size(), (b + 1) * kBlock); ++r) {
          double sum = 0;
          for (const float d : runs[r].distances) {
            sum += (d - mean) * (d - mean);
            spread.weight_of[bin_of(d, largest)] += runs[r].weight;
          }
          spread.second += runs[r].weight * sum;
        }
      },
      1);
  Spread total;
  for (const Spread& spread : of_block) {
    total.second += spread.second;
    for (std::size_t bin = 0; bin < kBins; ++bin)
      total.weight_of[bin] += spread.weight_of[bin];
  }
  return total;
}

// First the bin in which the quantile lies, then its samples in order.
double quantile(const std::vector<SampleRun>& runs,
                double share,
                const Sums& sums,
                const std::array<double, kBins>& weight_of) {
  double below = 0;
  std::size_t bin = 0;
  while (bin + 1 < kBins && below + weight_of[bin] < share * sums.weight)
    below += weight_of[bin++];
  std::vector<std::pair<float, double>> samples;
  for (const SampleRun& run : runs)
    for (const float d : run.distances)
      if (bin_of(d, sums.largest) == bin) samples.emplace_back(d, run.weight);
  std::sort(samples.begin(), samples.end());
  for (const auto& [d, weight] : samples) {
    below += weight;
    if (below >= share * sums.weight) return d;
  }
  return samples.empty() ? sums.largest : samples.back().first;
}

}  // namespace

DistanceStats sample_stats(const std::vector<SampleRun>& runs) {
  DistanceStats stats;
  const Sums sums = deterministic_reduce(
      0, runs.size(), Sums{}, [&](std::size_t r) { return sums_of(runs[r]); }, std::plus<>());
  stats.samples = sums.samples;
  if (!(sums.weight > 0)) return stats;
  stats.mean = sums.first / sums.weight;
  const Spread spread = spread_of(runs, stats.mean, sums.largest);
  const double variance = spread.second / sums.weight;
  stats.rms = std::sqrt(stats.mean * stats.mean + variance);
  stats.mean_standard_error = std::sqrt(variance * sums.weight2) / sums.weight;
  stats.p95 = quantile(runs, 0.95, sums, spread.weight_of);
  return stats;
}

}  // namespace cvmesh
