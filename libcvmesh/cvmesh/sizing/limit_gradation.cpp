// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/sizing/limit_gradation.h"

#include "cvmesh/core/parallel.h"

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <functional>
#include <utility>

namespace cvmesh {
namespace {

// Rounds of eight sweeps: one is enough where every characteristic keeps to one octant, which
// straight ones do. What bends at the borders of the grid moves on by less than this part of a
// spacing after the second round.
constexpr int kMaxRounds = 4;
constexpr double kSettled = 0.1;

// ---- sources in the grid ---------------------------------------------------------------------

// Nodes of the cell that holds a point, along one axis. Points of the box faces lie half a spacing
// outside the nodes.
struct CellEnds {
  int lo, hi;

  CellEnds(double index, int node_count) {
    const int cell = static_cast<int>(std::floor(index));
    lo = std::clamp(cell, 0, node_count - 1);
    hi = std::clamp(cell + 1, 0, node_count - 1);
  }
};

// The points in order of the layer of cells that they lie in: those of layer k are
// `point[first[k]] .. point[first[k + 1] - 1]`.
struct PointsByLayer {
  std::vector<std::size_t> first;
  std::vector<std::int32_t> point;
};

PointsByLayer sort_into_layers(const std::vector<Vec3>& points, const GridFrame& frame) {
  std::vector<int> layer_of(points.size());
  parallel_for_each_index(0, points.size(), [&](std::size_t n) {
    layer_of[n] = CellEnds(points[n].z / frame.spacing_mm.z, frame.dims[2]).lo;
  });
  PointsByLayer layers;
  layers.first.assign(static_cast<std::size_t>(frame.dims[2]) + 1, 0);
  for (const int layer : layer_of)
    ++layers.first[static_cast<std::size_t>(layer) + 1];
  for (std::size_t k = 1; k < layers.first.size(); ++k)
    layers.first[k] += layers.first[k - 1];
  layers.point.resize(points.size());
  auto fill = layers.first;
  for (std::size_t n = 0; n < points.size(); ++n)
    layers.point[fill[static_cast<std::size_t>(layer_of[n])]++] = static_cast<std::int32_t>(n);
  return layers;
}

// Gives the value of a point to the corners of its cell.
void set_source(const Vec3& point, double value, double delta, Grid<float>& u) {
  const GridFrame& frame = u.frame;
  const Vec3 index = frame.mm_to_index(point);
  const CellEnds x(index.x, frame.dims[0]), y(index.y, frame.dims[1]), z(index.z, frame.dims[2]);
  for (int k = z.lo; k <= z.hi; ++k)
    for (int j = y.lo; j <= y.hi; ++j)
      for (int i = x.lo; i <= x.hi; ++i) {
        const Vec3 node = frame.index_to_mm({double(i), double(j), double(k)});
        const double at_node = value + delta * distance(node, point);
        u(i, j, k) = std::min(u(i, j, k), static_cast<float>(at_node));
      }
}

// Points of one layer of cells write to two layers of nodes: every other one may run at a time.
void set_sources(const std::vector<Vec3>& points,
                 const std::vector<double>& values,
                 double delta,
                 Grid<float>& u) {
  const PointsByLayer layers = sort_into_layers(points, u.frame);
  const std::size_t count = layers.first.size() - 1;
  for (const std::size_t parity : {0, 1})
    parallel_for_each_index(
        0, (count + 1 - parity) / 2,
        [&](std::size_t half) {
          const std::size_t layer = 2 * half + parity;
          for (std::size_t n = layers.first[layer]; n < layers.first[layer + 1]; ++n)
            set_source(points[layers.point[n]], values[layers.point[n]], delta, u);
        },
        1);
}

// ---- sweeps ----------------------------------------------------------------------------------

// Solves sum of max(0, (u - a) / s)^2 = delta^2 for u, from three neighbours a with w = 1 / s^2.
class UpwindSolver {
 public:
  UpwindSolver(const Vec3& spacing, double delta)
      : delta2_(static_cast<float>(delta * delta)),
        is_isotropic_(spacing.x == spacing.y && spacing.y == spacing.z) {
    for (int axis = 0; axis < 3; ++axis) {
      weight_[axis] = static_cast<float>(1 / (spacing[axis] * spacing[axis]));
      step_[axis] = static_cast<float>(delta * spacing[axis]);
    }
  }

  float operator()(float x, float y, float z) const {
    Neighbour a{x, weight_[0], step_[0]}, b{y, weight_[1], step_[1]}, c{z, weight_[2], step_[2]};
    if (is_isotropic_) {
      // Sorted without a branch: which axis a value belongs to makes no difference.
      const float low = std::min(x, y), high = std::max(x, y);
      a.value = std::min(low, z);
      b.value = std::max(low, std::min(high, z));
      c.value = std::max(high, z);
    } else {
      if (b.value < a.value) std::swap(a, b);
      if (c.value < b.value) std::swap(b, c);
      if (b.value < a.value) std::swap(a, b);
    }
    return solve(a, b, c);
  }

 private:
  struct Neighbour {
    float value, weight, step;
  };

  // From ascending neighbours. All relative to the first, so that single precision is enough.
  [[nodiscard]] float solve(const Neighbour& a, const Neighbour& b, const Neighbour& c) const {
    const float from_b = b.value - a.value;
    if (from_b >= a.step) return a.value + a.step;
    float w = a.weight + b.weight, wa = b.weight * from_b, waa = b.weight * from_b * from_b;
    float root = wa * wa - w * (waa - delta2_);
    if (root < 0) return a.value + a.step;
    const float u = (wa + std::sqrt(root)) / w;
    const float from_c = c.value - a.value;
    if (from_c >= u) return a.value + u;
    w += c.weight;
    wa += c.weight * from_c;
    waa += c.weight * from_c * from_c;
    root = wa * wa - w * (waa - delta2_);
    return a.value + (root < 0 ? u : (wa + std::sqrt(root)) / w);
  }

  std::array<float, 3> weight_, step_;
  float delta2_;
  bool is_isotropic_;
};

// Gauss-Seidel sweeps. A block of rows reads only blocks one step before and after it, so blocks
// with the same number of steps from the corner where a sweep begins run in parallel, with the
// result of the sequential sweep. A node is due when one of its neighbours fell below it since it
// was last visited; a visit of any other node would find nothing new.
class Sweeper {
 public:
  Sweeper(Grid<float>& u, double delta)
      : u_(u),
        dims_(u.frame.dims),
        solve_(u.frame.spacing_mm, delta),
        is_due_(u.values.size(), 0),
        row_is_due_(static_cast<std::size_t>(dims_[1]) * dims_[2], 0),
        blocks_y_((dims_[1] + kBlock - 1) / kBlock),
        blocks_z_((dims_[2] + kBlock - 1) / kBlock),
        change_(blocks_z_) {
    parallel_for_each_index(
        0, row_is_due_.size(), [&](std::size_t row) { begin_row(row); }, kBlock);
  }

  // One sweep in the given directions (+1 or -1); returns the largest decrease.
  float operator()(const std::array<int, 3>& direction) {
    std::fill(change_.begin(), change_.end(), 0.0F);
    for (int wave = 0; wave <= blocks_y_ + blocks_z_ - 2; ++wave) {
      const int first = std::max(0, wave - (blocks_y_ - 1)), last = std::min(wave, blocks_z_ - 1);
      parallel_for_each_index(
          first, std::size_t(last) + 1,
          [&](std::size_t z) {
            const float change = sweep_block(direction, wave - static_cast<int>(z), int(z));
            change_[z] = std::max(change_[z], change);
          },
          1);
    }
    return *std::max_element(change_.begin(), change_.end());
  }

 private:
  static constexpr int kBlock = 8;  // rows along y and z: enough work for a task

  // Block (y, z) counted from where the sweep begins.
  float sweep_block(const std::array<int, 3>& direction, int y, int z) {
    float largest = 0;
    for (int nk = z * kBlock; nk < std::min((z + 1) * kBlock, dims_[2]); ++nk)
      for (int nj = y * kBlock; nj < std::min((y + 1) * kBlock, dims_[1]); ++nj)
        largest =
            std::max(largest, sweep_row(direction[0] > 0, direction[1] > 0 ? nj : dims_[1] - 1 - nj,
                                        direction[2] > 0 ? nk : dims_[2] - 1 - nk));
    return largest;
  }

  // A row of nodes and the four rows beside it; one that the border cuts off repeats the other one.
  struct Row {
    float* u;
    std::uint8_t* is_due;
    std::array<std::ptrdiff_t, 4> beside;      // y-, y+, z-, z+ as steps in `u`
    std::array<std::ptrdiff_t, 4> row_beside;  // the same as steps in `row_is_due_`
    std::size_t row;
  };

  Row row_at(int j, int k) {
    const std::size_t row = static_cast<std::size_t>(k) * dims_[1] + j;
    const std::ptrdiff_t ny = dims_[1];
    const std::ptrdiff_t y0 = j > 0 ? -1 : j + 1 < dims_[1] ? 1 : 0;
    const std::ptrdiff_t y1 = j + 1 < dims_[1] ? 1 : y0;
    const std::ptrdiff_t z0 = k > 0 ? -ny : k + 1 < dims_[2] ? ny : 0;
    const std::ptrdiff_t z1 = k + 1 < dims_[2] ? ny : z0;
    const std::ptrdiff_t nx = dims_[0];
    return {&u_(0, j, k),
            &is_due_[row * dims_[0]],
            {y0 * nx, y1 * nx, z0 * nx, z1 * nx},
            {y0, y1, z0, z1},
            row};
  }

  // Rows of one wave may mark the same row: the mark is atomic, and says the same from both.
  static void mark(std::uint8_t& flag) {
    std::atomic_ref<std::uint8_t>(flag).store(1, std::memory_order_relaxed);
  }

  // Before the first sweep a node is due when a neighbour lies below it.
  void begin_row(std::size_t index) {
    const Row row = row_at(static_cast<int>(index % dims_[1]), static_cast<int>(index / dims_[1]));
    for (int i = 0; i < dims_[0]; ++i) {
      const float* at = row.u + i;
      bool is_due = (i > 0 && at[-1] < *at) || (i + 1 < dims_[0] && at[1] < *at);
      for (const auto step : row.beside)
        is_due = is_due || at[step] < *at;
      row.is_due[i] = is_due ? 1 : 0;
      row_is_due_[index] |= row.is_due[i];
    }
  }

  float sweep_row(bool is_forward, int j, int k) {
    std::uint8_t& row_is_due = row_is_due_[static_cast<std::size_t>(k) * dims_[1] + j];
    if (row_is_due == 0) return 0;
    row_is_due = 0;
    const Row row = row_at(j, k);
    const int nx = dims_[0], step = is_forward ? 1 : -1;
    float largest = 0;
    for (int i = is_forward ? 0 : nx - 1; i >= 0 && i < nx; i += step) {
      if (row.is_due[i] == 0) continue;
      row.is_due[i] = 0;
      float* at = row.u + i;
      const float x = std::min(i > 0 ? at[-1] : kUnlimited, i + 1 < nx ? at[1] : kUnlimited);
      const float y = std::min(at[row.beside[0]], at[row.beside[1]]);
      const float z = std::min(at[row.beside[2]], at[row.beside[3]]);
      if (!(*at > std::min(x, std::min(y, z)))) continue;
      const float value = solve_(x, y, z);
      if (!(value < *at)) continue;
      largest = std::max(largest, *at - value);
      *at = value;
      mark_above(row, i);
    }
    return largest;
  }

  // The neighbours of a node that fell, as far as they lie above it.
  void mark_above(const Row& row, int i) {
    const float* at = row.u + i;
    for (const int next : {i - 1, i + 1})
      if (next >= 0 && next < dims_[0] && row.u[next] > *at) {
        row.is_due[next] = 1;
        row_is_due_[row.row] = 1;
      }
    for (int n = 0; n < 4; ++n)
      if (at[row.beside[n]] > *at) {
        mark(row.is_due[i + row.beside[n]]);
        mark(row_is_due_[row.row + row.row_beside[n]]);
      }
  }

  Grid<float>& u_;
  std::array<int, 3> dims_;
  UpwindSolver solve_;
  std::vector<std::uint8_t> is_due_, row_is_due_;  // of the nodes, of any node of a row
  int blocks_y_, blocks_z_;
  std::vector<float> change_;  // of the blocks at each z
};

// ---- the surface -----------------------------------------------------------------------------

// Lowers values along edges, part by part. A part is a run of consecutive vertices; those of the
// dense surface are numbered along a curve, so they lie close together, and what a part reads stays
// in the cache. Inside a part the lowest value goes first, which settles it in one pass;
// what crosses to another part is a mark there, for the next round. Parts of one round run
// in parallel: values only fall, each by compare and exchange, and a mark is set after the value
// that it tells of, so nothing is missed.
class EdgeLimiter {
 public:
  EdgeLimiter(const std::vector<Vec3>& points,
              const VertexNeighbours& neighbours,
              double delta,
              std::vector<double>& values)
      : points_(points),
        neighbours_(neighbours),
        delta_(delta),
        values_(values),
        is_due_(values.size(), 0),
        part_is_due_((values.size() + kPart - 1) / kPart, 0) {}

  void run() {
    parallel_for_each_index(
        0, part_is_due_.size(), [&](std::size_t part) { begin(part); }, 1);
    for (std::vector<std::size_t> due = due_parts(); !due.empty(); due = due_parts())
      parallel_for_each_index(
          0, due.size(), [&](std::size_t n) { settle(due[n]); }, 1);
  }

 private:
  using Item = std::pair<double, std::int32_t>;  // of the queue: value, vertex

  static constexpr std::size_t kPart = 4096;

  [[nodiscard]] std::size_t end_of(std::size_t part) const {
    return std::min(values_.size(), (part + 1) * kPart);
  }

  [[nodiscard]] std::vector<std::size_t> due_parts() const {
    std::vector<std::size_t> due;
    for (std::size_t part = 0; part < part_is_due_.size(); ++part)
      if (part_is_due_[part] != 0) due.push_back(part);
    return due;
  }

  // Before the first round a vertex is due when it has a neighbour to lower.
  void begin(std::size_t part) {
    for (std::size_t v = part * kPart; v < end_of(part); ++v)
      visit_higher(static_cast<std::int32_t>(v), values_[v],
                   [&](std::int32_t, double) { is_due_[v] = part_is_due_[part] = 1; });
  }

  void settle(std::size_t part) {
    const std::size_t first = part * kPart, end = end_of(part);
    std::vector<Item> queue;
    take(part_is_due_[part]);
    for (std::size_t v = first; v < end; ++v)
      if (take(is_due_[v])) queue.emplace_back(load(v), static_cast<std::int32_t>(v));
    std::make_heap(queue.begin(), queue.end(), std::greater<>());
    while (!queue.empty()) {
      const auto [value, v] = queue.front();
      std::pop_heap(queue.begin(), queue.end(), std::greater<>());
      queue.pop_back();
      if (load(static_cast<std::size_t>(v)) < value) continue;  // it is due again
      visit_higher(v, value, [&](std::int32_t to, double lower_value) {
        const auto w = static_cast<std::size_t>(to);
        if (!lower(values_[w], lower_value)) return;
        if (w >= first && w < end) {
          queue.emplace_back(lower_value, to);
          std::push_heap(queue.begin(), queue.end(), std::greater<>());
        } else {
          mark(is_due_[w]);
          mark(part_is_due_[w / kPart]);
        }
      });
    }
  }

  template <typename Visit>
  void visit_higher(std::int32_t v, double value, const Visit& visit) const {
    for (auto n = neighbours_.first[v]; n < neighbours_.first[v + 1]; ++n) {
      const std::int32_t w = neighbours_.vertex[n];
      const double limit = value + delta_ * distance(points_[v], points_[w]);
      if (limit < load(static_cast<std::size_t>(w))) visit(w, limit);
    }
  }

  [[nodiscard]] double load(std::size_t v) const {
    return std::atomic_ref<double>(values_[v]).load(std::memory_order_relaxed);
  }

  static bool lower(double& at, double value) {
    const std::atomic_ref<double> ref(at);
    double old = ref.load(std::memory_order_relaxed);
    while (value < old)
      if (ref.compare_exchange_weak(old, value, std::memory_order_relaxed)) return true;
    return false;
  }

  static void mark(std::uint8_t& flag) {
    std::atomic_ref<std::uint8_t>(flag).store(1, std::memory_order_release);
  }

  static bool take(std::uint8_t& flag) {
    const std::atomic_ref<std::uint8_t> ref(flag);
    return ref.load(std::memory_order_relaxed) != 0 &&
           ref.exchange(0, std::memory_order_acquire) != 0;
  }

  const std::vector<Vec3>& points_;
  const VertexNeighbours& neighbours_;
  double delta_;
  std::vector<double>& values_;
  std::vector<std::uint8_t> is_due_, part_is_due_;
};

}  // namespace

GridFrame coarsened(const GridFrame& frame, std::size_t max_nodes) {
  GridFrame result = frame;
  for (int factor = 2; result.size() > max_nodes; ++factor) {
    result = frame;
    result.spacing_mm *= factor;
    for (auto& row : result.index_to_world.rows)
      row *= factor;
    for (int axis = 0; axis < 3; ++axis)
      result.dims[axis] = (frame.dims[axis] - 1 + factor - 1) / factor + 1;
  }
  return result;
}

Grid<float> extend_from_points(const std::vector<Vec3>& points,
                               const std::vector<double>& values,
                               double delta,
                               Grid<float> u) {
  set_sources(points, values, delta, u);
  Sweeper sweep(u, delta);
  const double settled = kSettled * delta * u.frame.voxel_mm();
  for (int round = 0; round < kMaxRounds; ++round) {
    float largest = 0;
    for (int octant = 0; octant < 8; ++octant)
      largest = std::max(largest, sweep({(octant & 1) != 0 ? -1 : 1, (octant & 2) != 0 ? -1 : 1,
                                         (octant & 4) != 0 ? -1 : 1}));
    if (largest <= settled) break;
  }
  return u;
}

VertexNeighbours find_vertex_neighbours(const InterfaceMesh& mesh, const VertexStars& stars) {
  constexpr std::size_t kChunk = 4096;
  const std::size_t count = mesh.points.size();
  std::vector<std::vector<std::int32_t>> lists((count + kChunk - 1) / kChunk);
  VertexNeighbours result;
  result.first.assign(count + 1, 0);
  parallel_for_each_index(
      0, lists.size(),
      [&](std::size_t chunk) {
        std::vector<std::int32_t>& list = lists[chunk];
        for (std::size_t v = chunk * kChunk; v < std::min(count, (chunk + 1) * kChunk); ++v) {
          const auto begin = static_cast<std::ptrdiff_t>(list.size());
          for (auto s = stars.first[v]; s < stars.first[v + 1]; ++s)
            for (const auto w : mesh.facets[stars.facet[s]])
              if (w != static_cast<std::int32_t>(v) &&
                  std::find(list.begin() + begin, list.end(), w) == list.end())
                list.push_back(w);
          result.first[v + 1] = static_cast<std::int32_t>(list.size()) - std::int32_t(begin);
        }
      },
      1);
  for (std::size_t v = 0; v < count; ++v)
    result.first[v + 1] += result.first[v];
  result.vertex.resize(static_cast<std::size_t>(result.first[count]));
  parallel_for_each_index(
      0, lists.size(),
      [&](std::size_t chunk) {
        std::copy(lists[chunk].begin(), lists[chunk].end(),
                  result.vertex.begin() + result.first[chunk * kChunk]);
        lists[chunk] = {};
      },
      1);
  return result;
}

void limit_along_edges(const std::vector<Vec3>& points,
                       const VertexNeighbours& neighbours,
                       double delta,
                       std::vector<double>& values) {
  EdgeLimiter(points, neighbours, delta, values).run();
}

}  // namespace cvmesh
