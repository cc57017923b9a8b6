// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/medial/feature_transform.h"

#include "cvmesh/core/error.h"
#include "cvmesh/core/parallel.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace cvmesh {
namespace {

constexpr char kStage[] = "medial axis";

// Crossings keep this distance from the nodes, in edge lengths, so that their order along a line is
// strict in single precision.
constexpr double kMinFraction = 0.01;

// The grid lines along one axis: their number and where each begins.
struct Lines {
  int axis;
  std::array<int, 3> dims;

  [[nodiscard]] std::size_t count() const {
    return axis == 0   ? static_cast<std::size_t>(dims[1]) * dims[2]
           : axis == 1 ? static_cast<std::size_t>(dims[0]) * dims[2]
                       : static_cast<std::size_t>(dims[0]) * dims[1];
  }

  [[nodiscard]] std::array<int, 3> start(std::size_t line) const {
    const auto row = static_cast<std::size_t>(axis == 0 ? dims[1] : dims[0]);
    const int lo = static_cast<int>(line % row), hi = static_cast<int>(line / row);
    return axis == 0   ? std::array<int, 3>{0, lo, hi}
           : axis == 1 ? std::array<int, 3>{lo, 0, hi}
                       : std::array<int, 3>{lo, hi, 0};
  }
};

// Mean gradient of the four cells around an edge along `axis`: one cell alone knows the field on
// one side only, which tilts the normal where the field is curved or the slices are thick.
Vec3 normal_on_edge(const LevelSets& level_sets,
                    const InterfaceSite& site,
                    const Vec3& p,
                    int axis) {
  constexpr double kIntoCell = 1e-3;  // of a spacing
  const Vec3& spacing = level_sets.frame().spacing_mm;
  const int u = (axis + 1) % 3, v = (axis + 2) % 3;
  Vec3 sum;
  for (const double du : {-kIntoCell, kIntoCell})
    for (const double dv : {-kIntoCell, kIntoCell}) {
      Vec3 q = p;
      q[u] += du * spacing[u];
      q[v] += dv * spacing[v];
      sum += level_sets.sample_difference(site.a, site.b, q).gradient;
    }
  return normalized(sum);
}

InterfaceSite make_site(const LevelSets& level_sets, std::array<int, 3> node, int axis) {
  const auto& labels = *level_sets.labels;
  auto next = node;
  ++next[axis];
  InterfaceSite site;
  site.a = labels(node[0], node[1], node[2]);
  site.b = labels(next[0], next[1], next[2]);
  const double at_a = level_sets.at(site.a, node[0], node[1], node[2]) -
                      level_sets.at(site.b, node[0], node[1], node[2]);
  const double at_b = level_sets.at(site.a, next[0], next[1], next[2]) -
                      level_sets.at(site.b, next[0], next[1], next[2]);
  // The own label is positive and every other negative, so at_a > 0 > at_b.
  const double t = std::clamp(at_a / (at_a - at_b), kMinFraction, 1 - kMinFraction);
  Vec3 index{double(node[0]), double(node[1]), double(node[2])};
  index[axis] += t;
  const Vec3 p = level_sets.frame().index_to_mm(index);
  const Vec3 n = normal_on_edge(level_sets, site, p, axis);
  for (int c = 0; c < 3; ++c) {
    site.position_mm[c] = static_cast<float>(p[c]);
    site.normal[c] = static_cast<float>(n[c]);
  }
  return site;
}

// Scratch for one line: the slots that hold a site, as parabolas, and their lower envelope.
class Envelope {
 public:
  explicit Envelope(int longest)
      : apex_(longest), height_(longest), site_(longest), kept_(longest), from_(longest + 1) {}

  void clear() { count_ = 0; }

  // A parabola height + (x - apex)^2; apices ascend.
  void add(double apex, double height, std::int32_t site) {
    apex_[count_] = apex;
    height_[count_] = height + apex * apex;
    site_[count_++] = site;
  }

  [[nodiscard]] bool is_empty() const { return count_ == 0; }

  // Calls `write(slot, site)` for the slots 0..n-1 at x = slot * step; equal distances go to the
  // lower apex.
  template <typename Write>
  void evaluate(int n, double step, const Write& write) {
    int top = 0;
    kept_[0] = 0;
    from_[0] = -std::numeric_limits<double>::infinity();
    for (int q = 1; q < count_; ++q) {
      double x = crossing(kept_[top], q);
      while (x <= from_[top])
        x = crossing(kept_[--top], q);
      kept_[++top] = q;
      from_[top] = x;
    }
    for (int slot = 0, e = 0; slot < n; ++slot) {
      while (e < top && from_[e + 1] < slot * step)
        ++e;
      write(slot, site_[kept_[e]]);
    }
  }

 private:
  [[nodiscard]] double crossing(int p, int q) const {
    return (height_[q] - height_[p]) / (2 * (apex_[q] - apex_[p]));
  }

  std::vector<double> apex_, height_;
  std::vector<std::int32_t> site_;
  std::vector<int> kept_;
  std::vector<double> from_;
  int count_ = 0;
};

class Transform {
 public:
  Transform(const GridFrame& frame, const InterfaceSites& sites)
      : dims_(frame.dims), spacing_(frame.spacing_mm), sites_(sites) {}

  // Nearest within the slice, of the sites on its x and y edges.
  void in_slice(int k, std::int32_t* slice) const {
    const int nx = dims_[0], ny = dims_[1];
    std::vector<std::int32_t> other(static_cast<std::size_t>(nx) * ny, -1);
    Envelope envelope(std::max(nx, ny));
    for (int j = 0; j < ny; ++j) {
      std::int32_t* row = slice + static_cast<std::size_t>(j) * nx;
      nearest_on_line(0, static_cast<std::size_t>(k) * ny + j, nx,
                      [&](int i, std::int32_t s) { row[i] = s; });
    }
    along_y(k, slice, envelope);
    for (int i = 0; i < nx; ++i)
      nearest_on_line(1, static_cast<std::size_t>(k) * nx + i, ny, [&](int j, std::int32_t s) {
        other[static_cast<std::size_t>(j) * nx + i] = s;
      });
    along_x(k, other.data(), envelope);
    take_nearer(k, other.data(), slice);
  }

  // Turns nearest-in-slice into nearest in the volume, on the columns of row j.
  void along_z(int j, Grid<std::int32_t>& nearest) const {
    // Neighbouring columns share cache lines: a block of them is gathered at a time.
    constexpr int kColumns = 16;
    const int nz = dims_[2];
    Envelope envelope(nz);
    std::vector<std::int32_t> block(static_cast<std::size_t>(kColumns) * nz);
    for (int i0 = 0; i0 < dims_[0]; i0 += kColumns) {
      const int width = std::min(kColumns, dims_[0] - i0);
      for (int k = 0; k < nz; ++k)
        for (int c = 0; c < width; ++c)
          block[static_cast<std::size_t>(c) * nz + k] = nearest(i0 + c, j, k);
      for (int c = 0; c < width; ++c) {
        std::int32_t* column = block.data() + static_cast<std::size_t>(c) * nz;
        const double x = (i0 + c) * spacing_.x, y = j * spacing_.y;
        envelope.clear();
        for (int k = 0; k < nz; ++k)
          if (column[k] >= 0) {
            const auto& p = sites_.sites[column[k]].position_mm;
            envelope.add(k * spacing_.z, square(p[0] - x) + square(p[1] - y), column[k]);
          }
        if (envelope.is_empty()) continue;
        envelope.evaluate(nz, spacing_.z, [&](int k, std::int32_t s) { column[k] = s; });
      }
      for (int k = 0; k < nz; ++k)
        for (int c = 0; c < width; ++c)
          nearest(i0 + c, j, k) = block[static_cast<std::size_t>(c) * nz + k];
    }
  }

  // Adds the sites on z edges: nearest on each column first, then within the slice.
  void add_z_sites(int k, std::int32_t* slice) const {
    const int nx = dims_[0], ny = dims_[1];
    std::vector<std::int32_t> other(static_cast<std::size_t>(nx) * ny);
    Envelope envelope(std::max(nx, ny));
    const float z = static_cast<float>(k * spacing_.z);
    for (std::size_t line = 0; line < other.size(); ++line) {
      const auto begin = sites_.first[2][line], end = sites_.first[2][line + 1];
      auto s = begin;
      while (s + 1 < end && std::abs(sites_.sites[s + 1].position_mm[2] - z) <
                                std::abs(sites_.sites[s].position_mm[2] - z))
        ++s;
      other[line] = begin == end ? -1 : s;
    }
    along_x(k, other.data(), envelope);
    along_y(k, other.data(), envelope);
    take_nearer(k, other.data(), slice);
  }

 private:
  static double square(double x) { return x * x; }

  template <typename Write>
  void nearest_on_line(int axis, std::size_t line, int n, const Write& write) const {
    auto s = sites_.first[axis][line];
    const auto end = sites_.first[axis][line + 1];
    for (int slot = 0; slot < n; ++slot) {
      if (s == end) {
        write(slot, -1);
        continue;
      }
      const double x = slot * spacing_[axis];
      while (s + 1 < end && std::abs(sites_.sites[s + 1].position_mm[axis] - x) <
                                std::abs(sites_.sites[s].position_mm[axis] - x))
        ++s;
      write(slot, s);
    }
  }

  // The envelope over the columns of a slice whose entries are nearest among the sites with the
  // same y as the entry.
  void along_y(int k, std::int32_t* slice, Envelope& envelope) const {
    const double z = k * spacing_.z;
    for (int i = 0; i < dims_[0]; ++i) {
      const double x = i * spacing_.x;
      envelope.clear();
      for (int j = 0; j < dims_[1]; ++j) {
        const std::int32_t s = slice[static_cast<std::size_t>(j) * dims_[0] + i];
        if (s < 0) continue;
        const auto& p = sites_.sites[s].position_mm;
        envelope.add(j * spacing_.y, square(p[0] - x) + square(p[2] - z), s);
      }
      if (envelope.is_empty()) continue;
      envelope.evaluate(dims_[1], spacing_.y, [&](int j, std::int32_t s) {
        slice[static_cast<std::size_t>(j) * dims_[0] + i] = s;
      });
    }
  }

  void along_x(int k, std::int32_t* slice, Envelope& envelope) const {
    const double z = k * spacing_.z;
    for (int j = 0; j < dims_[1]; ++j) {
      const double y = j * spacing_.y;
      std::int32_t* row = slice + static_cast<std::size_t>(j) * dims_[0];
      envelope.clear();
      for (int i = 0; i < dims_[0]; ++i) {
        if (row[i] < 0) continue;
        const auto& p = sites_.sites[row[i]].position_mm;
        envelope.add(i * spacing_.x, square(p[1] - y) + square(p[2] - z), row[i]);
      }
      if (envelope.is_empty()) continue;
      envelope.evaluate(dims_[0], spacing_.x, [&](int i, std::int32_t s) { row[i] = s; });
    }
  }

  [[nodiscard]] double squared_distance(int i, int j, int k, std::int32_t s) const {
    if (s < 0) return std::numeric_limits<double>::infinity();
    const auto& p = sites_.sites[s].position_mm;
    return square(p[0] - i * spacing_.x) + square(p[1] - j * spacing_.y) +
           square(p[2] - k * spacing_.z);
  }

  void take_nearer(int k, const std::int32_t* other, std::int32_t* slice) const {
    std::size_t n = 0;
    for (int j = 0; j < dims_[1]; ++j)
      for (int i = 0; i < dims_[0]; ++i, ++n)
        if (other[n] >= 0 &&
            squared_distance(i, j, k, other[n]) < squared_distance(i, j, k, slice[n]))
          slice[n] = other[n];
  }

  std::array<int, 3> dims_;
  Vec3 spacing_;
  const InterfaceSites& sites_;
};

}  // namespace

InterfaceSites find_interface_sites(const LevelSets& level_sets) {
  const auto& labels = *level_sets.labels;
  const auto& dims = labels.frame.dims;
  const std::array<std::size_t, 3> stride{1, static_cast<std::size_t>(dims[0]),
                                          static_cast<std::size_t>(dims[0]) * dims[1]};
  InterfaceSites result;
  std::size_t total = 0;
  for (int axis = 0; axis < 3; ++axis) {
    const Lines lines{axis, dims};
    auto& first = result.first[axis];
    first.assign(lines.count() + 1, 0);
    parallel_for_each_index(
        0, lines.count(),
        [&](std::size_t line) {
          const auto at = lines.start(line);
          const MaterialId* node = labels.values.data() + labels.frame.linear(at[0], at[1], at[2]);
          for (int n = 0; n + 1 < dims[axis]; ++n, node += stride[axis])
            first[line + 1] += node[0] != node[stride[axis]];
        },
        64);
    std::size_t sum = total;
    for (auto& f : first) {
      sum += static_cast<std::size_t>(f);
      require(sum < static_cast<std::size_t>(std::numeric_limits<std::int32_t>::max()),
              ErrorCode::Limit, kStage,
              "the interfaces cross more than 2^31 grid edges; crop or coarsen the volume");
      f = static_cast<std::int32_t>(sum);
    }
    total = sum;
  }
  result.sites.resize(total);
  for (int axis = 0; axis < 3; ++axis) {
    const Lines lines{axis, dims};
    parallel_for_each_index(
        0, lines.count(),
        [&](std::size_t line) {
          auto at = lines.start(line);
          const MaterialId* node = labels.values.data() + labels.frame.linear(at[0], at[1], at[2]);
          auto s = result.first[axis][line];
          for (int n = 0; n + 1 < dims[axis]; ++n, node += stride[axis])
            if (node[0] != node[stride[axis]]) {
              at[axis] = n;
              result.sites[s++] = make_site(level_sets, at, axis);
            }
        },
        64);
  }
  return result;
}

Grid<std::int32_t> nearest_sites(const GridFrame& frame, const InterfaceSites& sites) {
  Grid<std::int32_t> nearest(frame, -1);
  const Transform transform(frame, sites);
  const std::size_t slice = static_cast<std::size_t>(frame.dims[0]) * frame.dims[1];
  parallel_for_each_index(
      0, frame.dims[2],
      [&](std::size_t k) {
        transform.in_slice(static_cast<int>(k), nearest.values.data() + k * slice);
      },
      1);
  parallel_for_each_index(
      0, frame.dims[1], [&](std::size_t j) { transform.along_z(static_cast<int>(j), nearest); }, 1);
  parallel_for_each_index(
      0, frame.dims[2],
      [&](std::size_t k) {
        transform.add_z_sites(static_cast<int>(k), nearest.values.data() + k * slice);
      },
      1);
  return nearest;
}

}  // namespace cvmesh
