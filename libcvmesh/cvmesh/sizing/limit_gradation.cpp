// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/sizing/limit_gradation.h"

#include "cvmesh/core/parallel.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <queue>
#include <utility>

namespace cvmesh {
namespace {

// Rounds of eight sweeps: one is enough where every characteristic keeps to one octant, which
// straight ones do. What bends at the borders of the grid moves on by less than this part of a
// spacing after the second round.
constexpr int kMaxRounds = 4;
constexpr double kSettled = 0.1;

GridFrame coarsened(const GridFrame& frame, std::size_t max_nodes) {
  GridFrame result = frame;
  for (int factor = 2; result.size() > max_nodes; ++factor) {
    result = frame;
    result.spacing_mm *= factor;
    for (auto& row : result.index_to_world.rows)
      row *= factor;
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

// Solves sum of max(0, (u - a) / s)^2 = delta^2 for u, from three neighbours a with w = 1 / s^2.
class UpwindSolver {
 public:
  UpwindSolver(const Vec3& spacing, double delta) : delta2_(static_cast<float>(delta * delta)) {
    for (int axis = 0; axis < 3; ++axis) {
      weight_[axis] = static_cast<float>(1 / (spacing[axis] * spacing[axis]));
      step_[axis] = static_cast<float>(delta * spacing[axis]);
    }
  }

  // Relative to the smallest neighbour, so that single precision is enough.
  float operator()(float x, float y, float z) const {
    std::array<float, 3> a{x, y, z};
    std::array<int, 3> order{0, 1, 2};
    if (a[order[1]] < a[order[0]]) std::swap(order[0], order[1]);
    if (a[order[2]] < a[order[1]]) std::swap(order[1], order[2]);
    if (a[order[1]] < a[order[0]]) std::swap(order[0], order[1]);
    const float base = a[order[0]];
    float u = step_[order[0]];
    float w = weight_[order[0]], wa = 0, waa = 0;
    for (int n = 1; n < 3; ++n) {
      const float value = a[order[n]] - base;
      if (value >= u) break;
      const float weight = weight_[order[n]];
      w += weight;
      wa += weight * value;
      waa += weight * value * value;
      const float root = wa * wa - w * (waa - delta2_);
      if (root < 0) break;
      u = (wa + std::sqrt(root)) / w;
    }
    return base + u;
  }

 private:
  std::array<float, 3> weight_, step_;
  float delta2_;
};

// Gauss-Seidel sweeps. Rows (j, k) with the same number of steps j + k from the corner where a
// sweep begins read only rows one step before and after, so they run in parallel with the result of
// the sequential sweep.
class Sweeper {
 public:
  Sweeper(Grid<float>& u, double delta)
      : u_(u), dims_(u.frame.dims), solve_(u.frame.spacing_mm, delta), row_change_(dims_[2]) {}

  // One sweep in the given directions (+1 or -1); returns the largest decrease.
  double operator()(const std::array<int, 3>& direction) {
    std::fill(row_change_.begin(), row_change_.end(), 0.0F);
    for (int wave = 0; wave <= dims_[1] + dims_[2] - 2; ++wave) {
      const int first = std::max(0, wave - (dims_[1] - 1)), last = std::min(wave, dims_[2] - 1);
      parallel_for_each_index(
          first, std::size_t(last) + 1,
          [&](std::size_t n) {
            const int nk = static_cast<int>(n), nj = wave - nk;
            const float change =
                sweep_row(direction[0] > 0, direction[1] > 0 ? nj : dims_[1] - 1 - nj,
                          direction[2] > 0 ? nk : dims_[2] - 1 - nk);
            row_change_[n] = std::max(row_change_[n], change);
          },
          kRowsPerTask);
    }
    return *std::max_element(row_change_.begin(), row_change_.end());
  }

 private:
  static constexpr std::size_t kRowsPerTask = 16;

  float sweep_row(bool is_forward, int j, int k) {
    constexpr float kFar = std::numeric_limits<float>::max();
    const int nx = dims_[0];
    const std::ptrdiff_t sy = nx, sz = static_cast<std::ptrdiff_t>(nx) * dims_[1];
    // A neighbour that the border cuts off repeats the other one.
    const std::ptrdiff_t y0 = j > 0 ? -sy : j + 1 < dims_[1] ? sy : 0;
    const std::ptrdiff_t y1 = j + 1 < dims_[1] ? sy : y0;
    const std::ptrdiff_t z0 = k > 0 ? -sz : k + 1 < dims_[2] ? sz : 0;
    const std::ptrdiff_t z1 = k + 1 < dims_[2] ? sz : z0;
    float* row = &u_(0, j, k);
    float largest = 0, before = kFar;  // `before` is the neighbour that was just updated
    for (int ni = 0; ni < nx; ++ni) {
      const int i = is_forward ? ni : nx - 1 - ni;
      const int next = is_forward ? i + 1 : i - 1;
      float* at = row + i;
      const float x = std::min(before, ni + 1 < nx ? row[next] : kFar);
      const float y = std::min(at[y0], at[y1]);
      const float z = std::min(at[z0], at[z1]);
      if (*at > std::min(x, std::min(y, z))) {
        const float value = solve_(x, y, z);
        if (value < *at) {
          largest = std::max(largest, *at - value);
          *at = value;
        }
      }
      before = *at;
    }
    return largest;
  }

  Grid<float>& u_;
  std::array<int, 3> dims_;
  UpwindSolver solve_;
  std::vector<float> row_change_;
};

}  // namespace

Grid<float> extend_from_points(const std::vector<Vec3>& points,
                               const std::vector<double>& values,
                               double delta,
                               const GridFrame& frame,
                               std::size_t max_nodes) {
  Grid<float> u(coarsened(frame, max_nodes), std::numeric_limits<float>::max());
  if (points.empty()) return u;
  set_sources(points, values, delta, u);
  Sweeper sweep(u, delta);
  const double settled = kSettled * delta * u.frame.voxel_mm();
  for (int round = 0; round < kMaxRounds; ++round) {
    double largest = 0;
    for (int octant = 0; octant < 8; ++octant)
      largest = std::max(largest, sweep({(octant & 1) != 0 ? -1 : 1, (octant & 2) != 0 ? -1 : 1,
                                         (octant & 4) != 0 ? -1 : 1}));
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
  for (std::size_t v = 0; v < values.size(); ++v)
    lower_neighbours(static_cast<std::int32_t>(v));
  while (!queue.empty()) {
    const auto [value, v] = queue.top();
    queue.pop();
    if (value <= values[v]) lower_neighbours(v);
  }
}

}  // namespace cvmesh
