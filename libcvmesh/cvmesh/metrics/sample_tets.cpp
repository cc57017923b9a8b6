// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/metrics/sample_tets.h"

#include "cvmesh/core/parallel.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>

namespace cvmesh {
namespace {

/// Fewest points along an edge: four points in a tet, close to the four of the rule that is exact
/// for quadratic functions.
constexpr int kLeastPoints = 2;
constexpr double kPointOffset = 0.25;
/// Tets of one task: their points are many.
constexpr std::size_t kGrain = 64;

std::array<Vec3, 4> corners_of(const TetMesh& mesh, std::size_t tet) {
  std::array<Vec3, 4> corners;
  for (std::size_t k = 0; k < 4; ++k)
    corners[k] = mesh.points[static_cast<std::size_t>(mesh.tets[tet][k])];
  return corners;
}

/// The image between its voxel centres; on its outer half voxels, the value of the nearest centre.
/// Nothing beyond.
std::optional<double> interpolate(const Grid<float>& image, const Vec3& index) {
  std::array<int, 3> low{};
  std::array<int, 3> high{};
  Vec3 part;
  for (int axis = 0; axis < 3; ++axis) {
    const auto n = static_cast<std::size_t>(axis);
    const int last = image.frame.dims[n] - 1;
    if (!(index[axis] >= -0.5 && index[axis] <= last + 0.5)) return std::nullopt;
    const double inside = std::clamp(index[axis], 0.0, static_cast<double>(last));
    low[n] = static_cast<int>(inside);
    high[n] = std::min(low[n] + 1, last);
    part[axis] = inside - low[n];
  }
  double value = 0;
  for (int corner = 0; corner < 8; ++corner) {
    double weight = 1;
    std::array<int, 3> at{};
    for (int axis = 0; axis < 3; ++axis) {
      const auto n = static_cast<std::size_t>(axis);
      const bool is_high = (corner >> axis & 1) != 0;
      at[n] = is_high ? high[n] : low[n];
      weight *= is_high ? part[axis] : 1 - part[axis];
    }
    value += weight * static_cast<double>(image(at[0], at[1], at[2]));
  }
  return value;
}

/// The image at the points of one tet that lie in it.
void sample_tet(const std::array<Vec3, 4>& corners,
                const Grid<float>& image,
                std::vector<double>& values) {
  double longest = 0;
  for (std::size_t a = 0; a < 4; ++a)
    for (std::size_t b = a + 1; b < 4; ++b)
      longest = std::max(longest, distance(corners[a], corners[b]));
  const int n = std::max(kLeastPoints, static_cast<int>(std::ceil(longest)));
  values.clear();
  for (int i = 0; i < n; ++i)
    for (int j = 0; i + j < n; ++j)
      for (int k = 0; i + j + k < n; ++k) {
        const std::array<int, 4> step = {i, j, k, n - 1 - i - j - k};
        Vec3 point;
        for (std::size_t c = 0; c < 4; ++c)
          point += (step[c] + kPointOffset) / n * corners[c];
        if (const auto value = interpolate(image, point)) values.push_back(*value);
      }
}

double median_of(std::vector<double>& values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  if (values.size() % 2 == 1) return *middle;
  return 0.5 * (*middle + *std::max_element(values.begin(), middle));
}

}  // namespace

TetSamples sample_tets(const TetMesh& mesh, const Grid<float>& image, const Affine& mm_to_index) {
  const std::size_t count = mesh.tets.size();
  TetSamples samples;
  samples.mean.assign(count, 0);
  samples.median.assign(count, 0);
  std::vector<std::uint8_t> is_outside(count, 0);
  parallel_for_each_index(
      0, count,
      [&](std::size_t tet) {
        std::array<Vec3, 4> corners = corners_of(mesh, tet);
        for (Vec3& corner : corners)
          corner = mm_to_index(corner);
        std::vector<double> values;
        sample_tet(corners, image, values);
        is_outside[tet] = values.empty() ? 1 : 0;
        if (values.empty()) return;
        double sum = 0;
        for (const double value : values)
          sum += value;
        samples.mean[tet] = sum / static_cast<double>(values.size());
        samples.median[tet] = median_of(values);
      },
      kGrain);
  samples.tets_outside =
      static_cast<std::size_t>(std::count(is_outside.begin(), is_outside.end(), 1));
  return samples;
}

std::vector<ElasticBin> bin_by_modulus(const TetMesh& mesh,
                                       const std::vector<double>& modulus_mpa,
                                       int bins,
                                       double poisson_ratio) {
  double lowest = INFINITY, highest = 0;
  for (const double modulus : modulus_mpa) {
    if (modulus == 0) continue;
    lowest = std::min(lowest, modulus);
    highest = std::max(highest, modulus);
  }
  if (highest == 0) return {};

  struct Sums {
    double volume = 0, modulus = 0;
  };

  std::vector<ElasticBin> all(static_cast<std::size_t>(bins));
  std::vector<Sums> sums(all.size());
  const double width = (highest - lowest) / bins;
  for (std::size_t tet = 0; tet < modulus_mpa.size(); ++tet) {
    const double modulus = modulus_mpa[tet];
    if (modulus == 0) continue;
    const double place = width > 0 ? (modulus - lowest) / width : 0;
    const std::size_t bin = std::min(static_cast<std::size_t>(place), all.size() - 1);
    const auto [a, b, c, d] = corners_of(mesh, tet);
    const double volume = volume6(a, b, c, d);
    all[bin].tets.push_back(static_cast<std::int32_t>(tet));
    sums[bin].volume += volume;
    sums[bin].modulus += volume * modulus;
  }
  std::vector<ElasticBin> used;
  for (std::size_t bin = 0; bin < all.size(); ++bin) {
    if (all[bin].tets.empty()) continue;
    all[bin].modulus_mpa = sums[bin].modulus / sums[bin].volume;
    all[bin].poisson_ratio = poisson_ratio;
    used.push_back(std::move(all[bin]));
  }
  return used;
}

}  // namespace cvmesh
