// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/levelset/distance_transform.h"

#include "cvmesh/core/parallel.h"

#include <algorithm>
#include <cstddef>

namespace cvmesh {
namespace {

// Lines along y and z are strided in memory: this many neighbours are moved together, one cache
// line of floats.
constexpr int kBundle = 16;

// Squared distance to the nearest site along x, by one scan in each direction.
void scan_line(const std::uint8_t* sites, int n, double step, float reach2, float* out) {
  constexpr int kNone = std::numeric_limits<int>::max();
  const auto squared = [&](int nodes) {
    const double d = nodes * step;
    return static_cast<float>(d * d);
  };
  int since = kNone;
  for (int i = 0; i < n; ++i) {
    since = sites[i] != 0 ? 0 : since == kNone ? kNone : since + 1;
    out[i] = since == kNone ? kNoSite : squared(since);
  }
  since = kNone;
  for (int i = n - 1; i >= 0; --i) {
    since = sites[i] != 0 ? 0 : since == kNone ? kNone : since + 1;
    if (since != kNone) out[i] = std::min(out[i], squared(since));
    if (out[i] > reach2) out[i] = kNoSite;
  }
}

// Parabolas of the lower envelope of one line, left to right.
struct Envelope {
  std::vector<int> apex;
  std::vector<float> height;
  std::vector<double> start;  // where the parabola begins to be the lowest

  explicit Envelope(int n)
      : apex(static_cast<std::size_t>(n)),
        height(static_cast<std::size_t>(n)),
        start(static_cast<std::size_t>(n)) {}
};

// values[i] <- min over j of values[j] + (step (i - j))^2.
void transform_line(float* values, int n, double step, float reach2, Envelope& envelope) {
  const bool is_trivial =
      std::all_of(values, values + n, [&](float v) { return v == values[0]; }) &&
      (values[0] == 0 || values[0] == kNoSite);
  if (is_trivial) return;
  const double w2 = step * step;
  int count = 0;
  for (int i = 0; i < n; ++i) {
    if (values[i] == kNoSite) continue;
    double start = -kNoSite;
    for (; count > 0; --count) {
      // Where parabola i meets the last one of the envelope.
      const int j = envelope.apex[count - 1];
      const double rise = static_cast<double>(values[i]) - values[j];
      start = 0.5 * (i + j) + rise / (2 * w2 * (i - j));
      if (start > envelope.start[count - 1]) break;
      start = -kNoSite;
    }
    envelope.apex[count] = i;
    envelope.height[count] = values[i];
    envelope.start[count++] = start;
  }
  if (count == 0) return;
  for (int i = 0, p = 0; i < n; ++i) {
    while (p + 1 < count && envelope.start[p + 1] < i)
      ++p;
    const double d = i - envelope.apex[p];
    const auto value = static_cast<float>(envelope.height[p] + w2 * d * d);
    values[i] = value > reach2 ? kNoSite : value;
  }
}

// Transforms the lines of `n` nodes, `stride` apart, that start at `first` and its `width`
// neighbours along x.
void transform_bundle(float* first,
                      int width,
                      int n,
                      std::size_t stride,
                      double step,
                      float reach2,
                      Envelope& envelope,
                      std::vector<float>& lines) {
  for (int i = 0; i < n; ++i)
    for (int x = 0; x < width; ++x)
      lines[static_cast<std::size_t>(x) * n + i] = first[i * stride + x];
  for (int x = 0; x < width; ++x)
    transform_line(&lines[static_cast<std::size_t>(x) * n], n, step, reach2, envelope);
  for (int i = 0; i < n; ++i)
    for (int x = 0; x < width; ++x)
      first[i * stride + x] = lines[static_cast<std::size_t>(x) * n + i];
}

}  // namespace

std::vector<float> squared_distances(const std::array<int, 3>& dims,
                                     const Vec3& step,
                                     const std::vector<std::uint8_t>& sites,
                                     double reach) {
  const auto [nx, ny, nz] = dims;
  const std::size_t row = static_cast<std::size_t>(nx), slice = row * ny;
  const auto reach2 = static_cast<float>(reach * reach);
  std::vector<float> values(sites.size());
  parallel_for_each_index(
      0, static_cast<std::size_t>(ny) * nz,
      [&](std::size_t line) {
        scan_line(&sites[line * row], nx, step.x, reach2, &values[line * row]);
      },
      64);

  // Lines along one axis: `outer` planes, each `outer_stride` from the next, of nx lines.
  const auto pass = [&](int n, std::size_t stride, int outer, std::size_t outer_stride, double w) {
    parallel_for_each_index(
        0, static_cast<std::size_t>(outer),
        [&](std::size_t plane) {
          Envelope envelope(n);
          std::vector<float> lines(static_cast<std::size_t>(n) * kBundle);
          for (int x = 0; x < nx; x += kBundle)
            transform_bundle(&values[plane * outer_stride + x], std::min(kBundle, nx - x), n,
                             stride, w, reach2, envelope, lines);
        },
        4);
  };
  pass(ny, row, nz, slice, step.y);
  pass(nz, slice, ny, row, step.z);
  return values;
}

}  // namespace cvmesh
