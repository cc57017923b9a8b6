// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/levelset/resample_labels.h"

#include "cvmesh/core/error.h"
#include "cvmesh/core/parallel.h"
#include "cvmesh/labels/simple_change.h"
#include "cvmesh/levelset/distance_transform.h"

#include <spdlog/spdlog.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <limits>
#include <string>
#include <utility>
#include <vector>

// Three steps. The start copies the nearest voxel. Then slabs of native planes, one after another,
// give the wishes of the nodes between their planes: the distances of one label at a time, offered
// to the nodes that have the label in their stencil (the eight native voxels around a node). Last,
// the wishes are carried out one lattice colour after another, each only where it is a simple
// change at that moment, until none is left that can be.
//
// Distances are cut off at the least ridge in the stencil, a ridge being the largest depth of a
// node's label around it in its plane. What ends between two slices is then as far from its
// next slice as it was deep, and ends half way, round; uncut, the label around it would be the
// farther the larger it is, and eat what is thin.
//
// The start has the topology of the native labels. Repeating one layer of nodes is undone by a
// simplicial map under which the preimage of every simplex is a prism, with a simplex glued to one
// end of it where the simplex leaves the layer: contractible, so that every label keeps its
// homotopy type, in the grid and on each face of its box [Quillen 1978]. The index maps, monotone
// and onto, repeat layers and do nothing else; lattice edges map to lattice edges or points, so
// that labels touch that touched before.

namespace cvmesh {
namespace {

constexpr char kStage[] = "resampling";

// Nodes of the new grid are numbered by 32 bits.
constexpr std::int32_t kMaxVoxels = std::numeric_limits<std::int32_t>::max();

// Part by which spacing_mm may exceed the smallest spacing: that of a file is often rounded.
constexpr double kSpacingTolerance = 1e-3;

// Distances are cut off at this many of the coarsest spacings in any case. Measured: of 1 to 3,
// this leaves the fewest wrong voxels over balls, tilted plates and cones, nested balls and stacks
// of five labels at ratios of 3 to 6.4.
constexpr double kClipPlanes = 1.25;

// A label other than the present one must win by this part of a voxel: rounding breaks no tie.
constexpr double kTie = 1e-4;

// Native planes between which wishes are found at a time.
constexpr int kSlabPlanes = 32;

// Every iteration but the last carries out a wish, so that the loop ends; scans need up to 8, since
// a front advances several nodes while the colours take turns.
constexpr int kMaxIterations = 200;

std::string format_number(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%.4g", value);
  return text;
}

// ---- the two grids -------------------------------------------------------------------------

// Where the nodes of the new grid lie in the native one, along one axis. Integers throughout: node
// i lies at (2 i + 1) n / (2 n') - 1/2, exactly.
struct AxisMap {
  std::vector<int> nearest;  // the voxel that the node lies in; monotone, onto
  std::vector<int> lo;       // the native centre at or before the node
  std::vector<float> part;   // of the way to the next centre; 0 beyond the outermost ones

  AxisMap(int native, int count)
      : nearest(static_cast<std::size_t>(count)),
        lo(static_cast<std::size_t>(count)),
        part(static_cast<std::size_t>(count)) {
    const std::int64_t whole = 2 * std::int64_t{count};
    for (int i = 0; i < count; ++i) {
      const std::int64_t at = (2 * std::int64_t{i} + 1) * native;
      const std::int64_t after_centre = std::max<std::int64_t>(at - count, 0);
      nearest[i] = static_cast<int>(at / whole);
      lo[i] = static_cast<int>(after_centre / whole);
      if (lo[i] + 1 < native)
        part[i] = static_cast<float>(after_centre % whole) / static_cast<float>(whole);
    }
  }

  [[nodiscard]] int hi(int i) const { return part[i] > 0 ? lo[i] + 1 : lo[i]; }

  [[nodiscard]] int count() const { return static_cast<int>(lo.size()); }

  // First node whose stencil begins at native index `n` or later.
  [[nodiscard]] int first_from(int n) const {
    return static_cast<int>(std::lower_bound(lo.begin(), lo.end(), n) - lo.begin());
  }

  // First node whose stencil ends after native index `n`.
  [[nodiscard]] int first_beyond(int n) const {
    int i = first_from(n);
    while (i < count() && hi(i) <= n)
      ++i;
    return i;
  }
};

using AxisMaps = std::array<AxisMap, 3>;

AxisMaps axis_maps(const std::array<int, 3>& native, const std::array<int, 3>& dims) {
  return {AxisMap(native[0], dims[0]), AxisMap(native[1], dims[1]), AxisMap(native[2], dims[2])};
}

std::array<int, 3> resampled_dims(const GridFrame& native, double spacing_mm) {
  require(spacing_mm > 0, ErrorCode::BadParameter, kStage,
          "grid_spacing_mm (" + format_number(spacing_mm) +
              ") must be greater than 0; the smallest spacing of the volume is " +
              format_number(auto_spacing_mm(native)));
  require(spacing_mm <= auto_spacing_mm(native) * (1 + kSpacingTolerance), ErrorCode::BadParameter,
          kStage,
          "grid_spacing_mm (" + format_number(spacing_mm) +
              ") exceeds the smallest spacing of the " + "volume (" +
              format_number(auto_spacing_mm(native)) +
              "), and thin parts could be lost; lower it to that");
  std::array<double, 3> wished{};
  for (int axis = 0; axis < 3; ++axis)
    wished[axis] = std::max<double>(
        native.dims[axis], std::round(native.dims[axis] * native.spacing_mm[axis] / spacing_mm));
  const double voxels = wished[0] * wished[1] * wished[2];
  require(voxels <= kMaxVoxels, ErrorCode::BadParameter, kStage,
          "grid_spacing_mm (" + format_number(spacing_mm) + ") makes a grid of " +
              format_number(voxels) + " voxels, more than " + std::to_string(kMaxVoxels) +
              (spacing_mm < auto_spacing_mm(native) ? "; raise it or crop the volume"
                                                    : "; crop the volume, or set it to null"));
  return {static_cast<int>(wished[0]), static_cast<int>(wished[1]), static_cast<int>(wished[2])};
}

// The frame of `dims` voxels over the box of `native`.
GridFrame frame_over(const GridFrame& native, const std::array<int, 3>& dims) {
  GridFrame frame = native;
  frame.dims = dims;
  Vec3 first;  // native index of the new grid's first voxel
  for (int axis = 0; axis < 3; ++axis) {
    const double ratio = static_cast<double>(native.dims[axis]) / dims[axis];
    frame.spacing_mm[axis] *= ratio;
    for (Vec3& row : frame.index_to_world.rows)
      row[axis] *= ratio;
    first[axis] = 0.5 * ratio - 0.5;
  }
  frame.index_to_world.offset = native.index_to_world(first);
  return frame;
}

Grid<MaterialId> nearest_labels(const Grid<MaterialId>& native,
                                const GridFrame& frame,
                                const AxisMaps& maps) {
  Grid<MaterialId> labels(frame);
  const auto [nx, ny, nz] = frame.dims;
  parallel_for_each_index(
      0, static_cast<std::size_t>(ny) * nz,
      [&, nx = nx, ny = ny](std::size_t row) {
        const int j = maps[1].nearest[row % ny], k = maps[2].nearest[row / ny];
        const MaterialId* from = &native.values[native.frame.linear(0, j, k)];
        MaterialId* to = &labels.values[row * nx];
        for (int i = 0; i < nx; ++i)
          to[i] = from[maps[0].nearest[i]];
      },
      64);
  return labels;
}

// ---- wishes ----------------------------------------------------------------------------------

// A box of nodes, `end` excluded.
struct NodeBox {
  std::array<int, 3> begin{}, end{};

  [[nodiscard]] std::array<int, 3> dims() const {
    return {end[0] - begin[0], end[1] - begin[1], end[2] - begin[2]};
  }

  [[nodiscard]] std::size_t row_count() const {
    return static_cast<std::size_t>(end[1] - begin[1]) * (end[2] - begin[2]);
  }

  // The y and z of a row of the box.
  [[nodiscard]] std::array<int, 2> row_at(std::size_t row) const {
    const auto ny = static_cast<std::size_t>(end[1] - begin[1]);
    return {begin[1] + static_cast<int>(row % ny), begin[2] + static_cast<int>(row / ny)};
  }

  [[nodiscard]] std::size_t row_of(int j, int k) const {
    return static_cast<std::size_t>(k - begin[2]) * (end[1] - begin[1]) + (j - begin[1]);
  }

  [[nodiscard]] std::size_t linear(int i, int j, int k) const {
    return row_of(j, k) * (end[0] - begin[0]) + (i - begin[0]);
  }
};

// Change of one node of the new grid.
struct Wish {
  std::uint32_t node = 0;
  MaterialId material = 0;
};

// By lattice colour; nodes of one colour are never neighbours.
using WishLists = std::array<std::vector<Wish>, 8>;

// The last of the axes with the largest spacing: scans are stacked along z.
int coarsest_axis(const Vec3& spacing_mm) {
  int coarsest = 2;
  for (int axis = 1; axis >= 0; --axis)
    if (spacing_mm[axis] > spacing_mm[coarsest]) coarsest = axis;
  return coarsest;
}

// Finds the wishes of all nodes.
class WishFinder {
 public:
  WishFinder(const Grid<MaterialId>& native,
             const Grid<MaterialId>& start,
             const AxisMaps& maps,
             std::size_t material_count)
      : native_(native), start_(start), maps_(maps), material_count_(material_count) {
    const Vec3& spacing = native.frame.spacing_mm;
    across_ = coarsest_axis(spacing);
    half_voxel_ =
        static_cast<float>(0.5 * std::min(spacing[(across_ + 1) % 3], spacing[(across_ + 2) % 3]));
    clip_ = static_cast<float>(kClipPlanes * spacing[across_]);
    tie_ = static_cast<float>(kTie * native.frame.voxel_mm());
  }

  [[nodiscard]] int slab_count() const {
    return (native_.frame.dims[across_] + kSlabPlanes - 1) / kSlabPlanes;
  }

  // Adds the wishes of the nodes whose stencil begins in a plane of the slab.
  void add_wishes(int slab, WishLists& wishes) const {
    const int first = slab * kSlabPlanes, planes = native_.frame.dims[across_];
    NodeBox window{{0, 0, 0}, native_.frame.dims}, nodes{{0, 0, 0}, start_.frame.dims};
    window.begin[across_] = first;
    window.end[across_] = std::min(first + kSlabPlanes + 1, planes);
    nodes.begin[across_] = maps_[across_].first_from(first);
    nodes.end[across_] = maps_[across_].first_from(first + kSlabPlanes);

    Election election = open_election(nodes);
    if (election.is_empty()) return;
    const std::vector<NodeBox> boxes = boxes_in(window);
    const auto for_each_material = [&](const auto& body) {
      for (std::size_t m = 0; m < boxes.size(); ++m)
        if (boxes[m].end[0] > 0) body(static_cast<MaterialId>(m), boxes[m]);
    };
    Field depth(window);
    for_each_material([&](MaterialId m, const NodeBox& box) { add_depths(m, box, depth); });
    set_clips(ridges_of(depth), election);
    for_each_material([&](MaterialId m, const NodeBox& box) { run_for(m, box, depth, election); });

    for (std::size_t row = 0; row < election.rows.size(); ++row) {
      const auto [j, k] = nodes.row_at(row);
      for (const Seat& seat : election.rows[row]) {
        const std::size_t node = start_.frame.linear(seat.i, j, k);
        if (seat.material != start_.values[node])
          wishes[lattice_colour(seat.i, j, k)].push_back(
              {static_cast<std::uint32_t>(node), seat.material});
      }
    }
  }

 private:
  // Values at the nodes of a native box.
  struct Field {
    NodeBox box;
    std::vector<float> values;

    explicit Field(const NodeBox& b)
        : box(b), values(static_cast<std::size_t>(b.dims()[0]) * b.row_count()) {}

    [[nodiscard]] float at(int i, int j, int k) const { return values[box.linear(i, j, k)]; }

    float& at(int i, int j, int k) { return values[box.linear(i, j, k)]; }
  };

  // The best label so far of a node whose stencil is mixed.
  struct Seat {
    int i = 0;
    float clip = 0;  // distances around the node are cut off here
    float value = -std::numeric_limits<float>::infinity();
    MaterialId material = 0;
  };

  struct Election {
    NodeBox nodes;
    std::vector<std::vector<Seat>> rows;  // of `nodes`; i ascending in each

    [[nodiscard]] bool is_empty() const {
      return std::all_of(rows.begin(), rows.end(), [](const auto& row) { return row.empty(); });
    }
  };

  // The four native rows that the stencils of a row of nodes lie in, y first.
  [[nodiscard]] std::array<const MaterialId*, 4> native_rows(int j, int k) const {
    const auto row = [&](int y, int z) { return &native_.values[native_.frame.linear(0, y, z)]; };
    return {row(maps_[1].lo[j], maps_[2].lo[k]), row(maps_[1].hi(j), maps_[2].lo[k]),
            row(maps_[1].lo[j], maps_[2].hi(k)), row(maps_[1].hi(j), maps_[2].hi(k))};
  }

  // Nodes with one label in their stencil cannot wish for another.
  [[nodiscard]] Election open_election(const NodeBox& nodes) const {
    Election election{nodes, std::vector<std::vector<Seat>>(nodes.row_count())};
    parallel_for_each_index(
        0, election.rows.size(),
        [&](std::size_t row) {
          const auto [j, k] = nodes.row_at(row);
          const auto from = native_rows(j, k);
          for (int i = nodes.begin[0]; i < nodes.end[0]; ++i) {
            const int lo = maps_[0].lo[i], hi = maps_[0].hi(i);
            const MaterialId m = from[0][lo];
            bool is_mixed = false;
            for (const MaterialId* ids : from)
              is_mixed = is_mixed || ids[lo] != m || ids[hi] != m;
            if (is_mixed) election.rows[row].push_back({.i = i});
          }
        },
        64);
    return election;
  }

  // The box of every material in the window and one node around it, as far as the window goes.
  [[nodiscard]] std::vector<NodeBox> boxes_in(const NodeBox& window) const {
    std::vector<NodeBox> boxes(material_count_, {window.end, {0, 0, 0}});
    for (int k = window.begin[2]; k < window.end[2]; ++k)
      for (int j = window.begin[1]; j < window.end[1]; ++j) {
        const MaterialId* row = &native_.values[native_.frame.linear(0, j, k)];
        for (int i = window.begin[0]; i < window.end[0];) {
          const std::array<int, 3> first{i - 1, j - 1, k - 1};
          NodeBox& box = boxes[row[i]];
          for (const MaterialId m = row[i]; i < window.end[0] && row[i] == m;)
            ++i;
          const std::array<int, 3> end{i + 1, j + 2, k + 2};
          for (int axis = 0; axis < 3; ++axis) {
            box.begin[axis] = std::max(window.begin[axis], std::min(box.begin[axis], first[axis]));
            box.end[axis] = std::min(window.end[axis], std::max(box.end[axis], end[axis]));
          }
        }
      }
    return boxes;
  }

  // Offers a material's value to the nodes that have it in their stencil.
  void run_for(MaterialId m, const NodeBox& box, const Field& depth, Election& election) const {
    const Field distance = signed_distances(m, box, depth);
    NodeBox nodes = election.nodes;
    for (int axis = 0; axis < 3; ++axis) {
      nodes.begin[axis] = std::max(nodes.begin[axis], maps_[axis].first_from(box.begin[axis]));
      nodes.end[axis] = std::min(nodes.end[axis], maps_[axis].first_beyond(box.end[axis] - 1));
      if (nodes.begin[axis] >= nodes.end[axis]) return;
    }
    parallel_for_each_index(
        0, nodes.row_count(),
        [&](std::size_t row) {
          const auto [j, k] = nodes.row_at(row);
          std::vector<Seat>& seats = election.rows[election.nodes.row_of(j, k)];
          const auto from = native_rows(j, k);
          auto seat = std::lower_bound(seats.begin(), seats.end(), nodes.begin[0],
                                       [](const Seat& s, int i) { return s.i < i; });
          for (; seat != seats.end() && seat->i < nodes.end[0]; ++seat) {
            const int lo = maps_[0].lo[seat->i], hi = maps_[0].hi(seat->i);
            const bool has_m = std::any_of(from.begin(), from.end(), [&](const MaterialId* ids) {
              return ids[lo] == m || ids[hi] == m;
            });
            if (!has_m) continue;
            float value = interpolate(distance, seat->clip, seat->i, j, k);
            if (start_(seat->i, j, k) == m) value += tie_;
            if (value > seat->value) {
              seat->value = value;
              seat->material = m;
            }
          }
        },
        64);
  }

  // Distance within each plane of the box from every node to the boundary of the nearest node that
  // `is_site(label)`, at most clip_. Half a voxel lies between a node and the boundary.
  template <typename IsSite>
  [[nodiscard]] std::vector<float> distances_to(const NodeBox& box, const IsSite& is_site) const {
    const auto dims = box.dims();
    std::vector<std::uint8_t> sites(static_cast<std::size_t>(dims[0]) * box.row_count());
    parallel_for_each_index(
        0, box.row_count(),
        [&](std::size_t row) {
          const auto [j, k] = box.row_at(row);
          const MaterialId* from = &native_.values[native_.frame.linear(box.begin[0], j, k)];
          std::uint8_t* to = &sites[row * dims[0]];
          for (int i = 0; i < dims[0]; ++i)
            to[i] = is_site(from[i]) ? 1 : 0;
        },
        64);
    // Planes farther apart than the reach do not see each other.
    const double reach = double{clip_} + half_voxel_;
    Vec3 step = native_.frame.spacing_mm;
    step[across_] = 2 * reach;
    std::vector<float> distances = squared_distances(dims, step, sites, reach);
    parallel_for_each_index(
        0, distances.size(),
        [&](std::size_t n) {
          distances[n] = std::min(std::sqrt(distances[n]) - half_voxel_, clip_);
        },
        1 << 14);
    return distances;
  }

  // Calls body(node of the box, node of the field, is the node m's) for all nodes of the box.
  template <typename Body>
  void for_each_node(MaterialId m, const NodeBox& box, const Field& field, const Body& body) const {
    parallel_for_each_index(
        0, box.row_count(),
        [&](std::size_t row) {
          const auto [j, k] = box.row_at(row);
          const MaterialId* from = &native_.values[native_.frame.linear(box.begin[0], j, k)];
          const std::size_t first = row * box.dims()[0];
          const std::size_t first_of_field = field.box.linear(box.begin[0], j, k);
          for (std::size_t i = 0; i < static_cast<std::size_t>(box.dims()[0]); ++i)
            body(first + i, first_of_field + i, from[i] == m);
        },
        64);
  }

  // Sets the depth of m's nodes inside m. One layer of nodes around the material is enough of a
  // box: whatever lies farther out has a node of that layer before it.
  void add_depths(MaterialId m, const NodeBox& box, Field& depth) const {
    const auto depths = distances_to(box, [m](MaterialId other) { return other != m; });
    for_each_node(m, box, depth, [&](std::size_t n, std::size_t to, bool is_inside) {
      if (is_inside) depth.values[to] = depths[n];
    });
  }

  // Signed distance of m within each plane of the box, positive inside.
  [[nodiscard]] Field signed_distances(MaterialId m, const NodeBox& box, const Field& depth) const {
    Field distance(box);
    distance.values = distances_to(box, [m](MaterialId other) { return other == m; });
    for_each_node(m, box, depth, [&](std::size_t n, std::size_t from, bool is_inside) {
      distance.values[n] = is_inside ? depth.values[from] : -distance.values[n];
    });
    return distance;
  }

  // At every node the largest depth that its label has around it: within clip_ along one axis of
  // the plane, then along the other. Nodes that are clip_ deep themselves need no look.
  [[nodiscard]] Field ridges_of(const Field& depth) const {
    Field along_one(depth.box), ridges(depth.box);
    largest_along((across_ + 1) % 3, depth, along_one);
    largest_along((across_ + 2) % 3, along_one, ridges);
    return ridges;
  }

  void largest_along(int axis, const Field& from, Field& to) const {
    const int reach = static_cast<int>(std::ceil(clip_ / native_.frame.spacing_mm[axis]));
    const NodeBox& box = from.box;
    parallel_for_each_index(
        0, box.row_count(),
        [&](std::size_t row) {
          const auto [j, k] = box.row_at(row);
          for (std::array<int, 3> at{box.begin[0], j, k}; at[0] < box.end[0]; ++at[0]) {
            const MaterialId m = native_(at[0], j, k);
            float largest = from.at(at[0], j, k);
            if (largest < clip_) {
              std::array<int, 3> other = at;
              const int last = std::min(at[axis] + reach, box.end[axis] - 1);
              for (other[axis] = std::max(at[axis] - reach, box.begin[axis]); other[axis] <= last;
                   ++other[axis])
                if (native_(other[0], other[1], other[2]) == m)
                  largest = std::max(largest, from.at(other[0], other[1], other[2]));
            }
            to.at(at[0], j, k) = largest;
          }
        },
        64);
  }

  // The least ridge in the stencil of every node.
  void set_clips(const Field& ridges, Election& election) const {
    parallel_for_each_index(
        0, election.rows.size(),
        [&](std::size_t row) {
          const auto [j, k] = election.nodes.row_at(row);
          for (Seat& seat : election.rows[row]) {
            seat.clip = clip_;
            for (const int z : {maps_[2].lo[k], maps_[2].hi(k)})
              for (const int y : {maps_[1].lo[j], maps_[1].hi(j)})
                for (const int x : {maps_[0].lo[seat.i], maps_[0].hi(seat.i)})
                  seat.clip = std::min(seat.clip, ridges.at(x, y, z));
          }
        },
        64);
  }

  // Linear along x, y, z in turn: values of opposite sign stay opposite to the last bit.
  [[nodiscard]] float interpolate(const Field& distance, float clip, int i, int j, int k) const {
    const auto between = [](float a, float b, float part) { return a + part * (b - a); };
    const auto clipped = [&](int x, int y, int z) {
      return std::clamp(distance.at(x, y, z), -clip, clip);
    };
    const auto along_x = [&](int y, int z) {
      return between(clipped(maps_[0].lo[i], y, z), clipped(maps_[0].hi(i), y, z),
                     maps_[0].part[i]);
    };
    const auto along_y = [&](int z) {
      return between(along_x(maps_[1].lo[j], z), along_x(maps_[1].hi(j), z), maps_[1].part[j]);
    };
    return between(along_y(maps_[2].lo[k]), along_y(maps_[2].hi(k)), maps_[2].part[k]);
  }

  const Grid<MaterialId>& native_;
  const Grid<MaterialId>& start_;
  const AxisMaps& maps_;
  std::size_t material_count_;
  int across_ = 2;
  float half_voxel_ = 0, clip_ = 0, tie_ = 0;
};

// ---- carrying them out -----------------------------------------------------------------------

std::size_t size_of(const WishLists& wishes) {
  std::size_t size = 0;
  for (const auto& list : wishes)
    size += list.size();
  return size;
}

// One iteration: carries out the wishes that are simple changes, colour after colour, and takes
// them off the lists.
void carry_out(WishLists& wishes, Grid<MaterialId>& labels) {
  const auto [nx, ny, nz] = labels.frame.dims;
  const auto row = static_cast<std::uint32_t>(nx), slice = row * static_cast<std::uint32_t>(ny);
  for (auto& list : wishes) {
    parallel_for_each_index(
        0, list.size(),
        [&](std::size_t w) {
          const auto [node, material] = list[w];
          if (is_simple_change(labels, static_cast<int>(node % row),
                               static_cast<int>(node % slice / row), static_cast<int>(node / slice),
                               material))
            labels.values[node] = material;
        },
        1024);
    list.erase(
        std::remove_if(list.begin(), list.end(),
                       [&](const Wish& wish) { return labels.values[wish.node] == wish.material; }),
        list.end());
  }
}

}  // namespace

double auto_spacing_mm(const GridFrame& frame) {
  return frame.voxel_mm();
}

ResampleLabelsResult resample_labels(const LabelVolume& labels,
                                     const ResampleLabelsOptions& options,
                                     const StageContext& context) {
  const GridFrame& native = labels.frame();
  const auto dims = resampled_dims(native, options.spacing_mm);
  const AxisMaps maps = axis_maps(native.dims, dims);
  ResampleLabelsResult result;
  result.labels.label_of = labels.label_of;
  result.labels.name_of = labels.name_of;
  result.labels.first_voxel = labels.first_voxel;
  result.labels.input_dims = labels.input_dims;
  Grid<MaterialId>& ids = result.labels.ids;
  ids = nearest_labels(labels.ids, frame_over(native, dims), maps);
  result.offset_mm = 0.5 * (ids.frame.spacing_mm - native.spacing_mm);
  report_progress(context, kStage, 0.1);

  WishLists wishes;
  const WishFinder finder(labels.ids, ids, maps, labels.material_count());
  for (int slab = 0; slab < finder.slab_count(); ++slab) {
    finder.add_wishes(slab, wishes);
    report_progress(context, kStage, 0.1 + 0.6 * (slab + 1) / finder.slab_count());
  }

  ResampleLabelsStats& stats = result.stats;
  stats.dims = ids.frame.dims;
  stats.spacing_mm = ids.frame.spacing_mm;
  stats.nodes_wished = size_of(wishes);
  stats.nodes_held = stats.nodes_wished;
  for (int iteration = 1; iteration <= kMaxIterations; ++iteration) {
    const std::size_t before = stats.nodes_held;
    carry_out(wishes, ids);
    stats.nodes_held = size_of(wishes);
    if (stats.nodes_held == before) break;
    context.log->debug("resampling: iteration {}, {} nodes changed", iteration,
                       before - stats.nodes_held);
    report_progress(context, kStage, 0.7 + 0.3 * iteration / kMaxIterations);
  }
  stats.nodes_changed = stats.nodes_wished - stats.nodes_held;
  report_progress(context, kStage, 1);
  return result;
}

}  // namespace cvmesh
