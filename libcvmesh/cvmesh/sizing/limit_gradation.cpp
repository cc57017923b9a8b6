// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/sizing/limit_gradation.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <queue>
#include <utility>

namespace cvmesh {
namespace {

// Rounds of eight sweeps: the first is enough but for fronts that turn around obstacles of lower
// value, and those move by less than this part of a spacing after the second.
constexpr int kMaxRounds = 4;
constexpr double kSettled = 1e-2;

GridFrame coarsened(const GridFrame& frame, std::size_t max_nodes) {
  GridFrame result = frame;
  for (int factor = 2; result.size() > max_nodes; ++factor) {
    result = frame;
    result.spacing_mm *= factor;
    for (auto& row : result.index_to_world.rows) row *= factor;
    // The last node lies at or beyond the last of `frame`.
    for (int axis = 0; axis < 3; ++axis)
      result.dims[axis] = (frame.dims[axis] - 1 + factor - 1) / factor + 1;
  }
  return result;
}

// Each point gives its value to the corners of its cell.
void set_sources(const std::vector<Vec3>& points,
                 const std::vector<double>& values,
                 double delta,
                 Grid<float>& u) {
  const auto& frame = u.frame;
  for (std::size_t n = 0; n < points.size(); ++n) {
    const Vec3 index = frame.mm_to_index(points[n]);
    std::array<int, 3> lo, hi;
    for (int axis = 0; axis < 3; ++axis) {
      // Points of the box faces lie half a spacing outside the nodes.
      const int last = frame.dims[axis] - 1;
      lo[axis] = std::clamp(static_cast<int>(std::floor(index[axis])), 0, last);
      hi[axis] = std::clamp(static_cast<int>(std::floor(index[axis])) + 1, 0, last);
    }
    for (int k = lo[2]; k <= hi[2]; ++k)
      for (int j = lo[1]; j <= hi[1]; ++j)
        for (int i = lo[0]; i <= hi[0]; ++i) {
          const Vec3 node = frame.index_to_mm({double(i), double(j), double(k)});
          const double value = values[n] + delta * distance(node, points[n]);
          u(i, j, k) = std::min(u(i, j, k), static_cast<float>(value));
        }
  }
}

// Solves sum of max(0, (u - a) / s)^2 = delta^2 for u, the neighbours a[] with spacings s[].
double upwind_solution(std::array<std::pair<double, double>, 3> a, double delta) {
  if (a[1].first < a[0].first) std::swap(a[0], a[1]);
  if (a[2].first < a[1].first) std::swap(a[1], a[2]);
  if (a[1].first < a[0].first) std::swap(a[0], a[1]);
  double u = a[0].first + delta * a[0].second;
  double w = 0, wa = 0, waa = 0;  // sums of 1/s^2, a/s^2, a^2/s^2, with a relative to a[0]
  for (int n = 0; n < 3; ++n) {
    const double value = a[n].first - a[0].first;
    if (!(value < u - a[0].first)) break;
    const double weight = 1 / (a[n].second * a[n].second);
    w += weight;
    wa += weight * value;
    waa += weight * value * value;
    const double root = wa * wa - w * (waa - delta * delta);
    if (root < 0) break;
    u = a[0].first + (wa + std::sqrt(root)) / w;
  }
  return u;
}

// One Gauss-Seidel sweep in the given directions; returns the largest decrease.
double sweep(const std::array<int, 3>& direction, double delta, Grid<float>& u) {
  const auto& dims = u.frame.dims;
  const std::ptrdiff_t sy = dims[0], sz = static_cast<std::ptrdiff_t>(dims[0]) * dims[1];
  const Vec3 spacing = u.frame.spacing_mm;
  constexpr float kFar = std::numeric_limits<float>::max();
  double largest = 0;
  for (int nk = 0; nk < dims[2]; ++nk) {
    const int k = direction[2] > 0 ? nk : dims[2] - 1 - nk;
    for (int nj = 0; nj < dims[1]; ++nj) {
      const int j = direction[1] > 0 ? nj : dims[1] - 1 - nj;
      float* row = &u(0, j, k);
      for (int ni = 0; ni < dims[0]; ++ni) {
        const int i = direction[0] > 0 ? ni : dims[0] - 1 - ni;
        float* at = row + i;
        const float x = std::min(i > 0 ? at[-1] : kFar, i + 1 < dims[0] ? at[1] : kFar);
        const float y = std::min(j > 0 ? at[-sy] : kFar, j + 1 < dims[1] ? at[sy] : kFar);
        const float z = std::min(k > 0 ? at[-sz] : kFar, k + 1 < dims[2] ? at[sz] : kFar);
        if (*at <= std::min(x, std::min(y, z))) continue;
        const auto value = static_cast<float>(
            upwind_solution({{{x, spacing.x}, {y, spacing.y}, {z, spacing.z}}}, delta));
        if (value < *at) {
          largest = std::max(largest, double{*at} - value);
          *at = value;
        }
      }
    }
  }
  return largest;
}

}  // namespace

Grid<float> extend_from_points(const std::vector<Vec3>& points,
                               const std::vector<double>& values,
                               double delta,
                               const GridFrame& frame,
                               std::size_t max_nodes) {
  Grid<float> u(coarsened(frame, max_nodes), std::numeric_limits<float>::max());
  if (points.empty()) return u;
  set_sources(points, values, delta, u);
  const double settled = kSettled * delta * u.frame.voxel_mm();
  for (int round = 0; round < kMaxRounds; ++round) {
    double largest = 0;
    for (int octant = 0; octant < 8; ++octant)
      largest = std::max(largest, sweep({(octant & 1) != 0 ? -1 : 1, (octant & 2) != 0 ? -1 : 1,
                                         (octant & 4) != 0 ? -1 : 1},
                                        delta, u));
    if (largest <= settled) break;
  }
  return u;
}

void limit_along_edges(const InterfaceMesh& mesh,
                       const VertexStars& stars,
                       double delta,
                       std::vector<double>& values) {
  using Entry = std::pair<double, std::int32_t>;  // smallest value first
  std::priority_queue<Entry, std::vector<Entry>, std::greater<>> queue;
  const auto lower_neighbours = [&](std::int32_t v) {
    for (auto s = stars.first[v]; s < stars.first[v + 1]; ++s)
      for (const auto w : mesh.facets[stars.facet[s]]) {
        const double value = values[v] + delta * distance(mesh.points[v], mesh.points[w]);
        if (value < values[w]) {
          values[w] = value;
          queue.push({value, w});
        }
      }
  };
  for (std::size_t v = 0; v < values.size(); ++v) lower_neighbours(static_cast<std::int32_t>(v));
  while (!queue.empty()) {
    const auto [value, v] = queue.top();
    queue.pop();
    if (value <= values[v]) lower_neighbours(v);
  }
}

}  // namespace cvmesh
