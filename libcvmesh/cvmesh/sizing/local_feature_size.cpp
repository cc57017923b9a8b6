// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/core/box3.h"
#include "cvmesh/core/parallel.h"
#include "cvmesh/medial/point_tree.h"
#include "cvmesh/sizing/compute_sizing_field.h"
#include "cvmesh/sizing/limit_gradation.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numeric>
#include <utility>
#include <vector>

namespace cvmesh {
namespace {

constexpr char kStage[] = "sizing field";
constexpr double kInfinity = std::numeric_limits<double>::infinity();

// Half windows, in voxels, over which a curve's radius of curvature is measured. The bow of a
// window is measured to within the curve's own noise, which is taken off.
constexpr std::array<double, 4> kCurvatureWindowsVox{4, 8, 16, 32};
constexpr double kCurveNoiseVox = 0.5;
constexpr double kCurveSmoothingVox = 1.5;

// Points of one curve, or of two curves that share a corner, count as separate features when the
// way along the curves is this much longer than the straight one: a hairpin, or curves that leave
// their corner less than 29 degrees apart.
constexpr double kHairpinRatio = 4;
// The zigzag of an extracted curve between the tets of the lattice is shorter than this.
constexpr double kMinHairpinVox = 6;

// Next to a curve the sheets are closer than the smoothing reaches, and medial points that belong
// to the wedge may be left: within this distance the curve's own size is the floor.
constexpr double kNearCurveVox = 4;

// Medial points of one material.
struct MaterialAxis {
  PointTree tree;
  std::vector<double> radius_mm;
};

std::vector<MaterialAxis> axis_of_materials(const MedialAxis& axis, std::size_t material_count) {
  std::vector<MaterialAxis> result(material_count);
  std::vector<std::vector<Vec3>> points(material_count);
  for (std::size_t n = 0; n < axis.points.size(); ++n) {
    const auto m = axis.material_of[n];
    if (m >= material_count) continue;
    points[m].push_back(axis.points[n]);
    result[m].radius_mm.push_back(axis.radius_mm[n]);
  }
  parallel_for_each_index(
      0, result.size(), [&](std::size_t m) { result[m].tree = PointTree(std::move(points[m])); },
      1);
  return result;
}

// Materials around a vertex, each once.
void find_materials(const InterfaceMesh& dense,
                    const Strata& strata,
                    const VertexStars& stars,
                    std::size_t v,
                    std::vector<MaterialId>& materials) {
  materials.clear();
  for (auto s = stars.first[v]; s < stars.first[v + 1]; ++s) {
    const Sides& sides = dense.patch_of[stars.facet[s]].sides;
    for (const MaterialId m : {sides.inside, sides.outside})
      if (std::find(materials.begin(), materials.end(), m) == materials.end())
        materials.push_back(m);
    if (strata.dimension[v] == 2) break;  // all facets belong to one patch
  }
}

// Distances to the axes of some materials from points that mostly are neighbours: each search
// begins where the last one ended.
class AxisDistance {
 public:
  AxisDistance(const std::vector<MaterialAxis>& axes, double voxel_mm)
      : axes_(axes), half_diagonal2_(0.5 * voxel_mm * voxel_mm), near_(axes.size(), -1) {}

  // The smallest distance from p to the axis of one of the materials, which are sorted by the
  // likely distance.
  double operator()(const Vec3& p, std::vector<MaterialId>& materials) {
    std::sort(materials.begin(), materials.end(),
              [&](MaterialId m, MaterialId n) { return likely(m, p) < likely(n, p); });
    double smallest = kInfinity;
    for (const MaterialId m : materials) {
      // What is farther than this is no smaller for the foot below.
      const double limit = std::min(likely(m, p), std::sqrt(smallest * smallest + half_diagonal2_));
      const auto hit =
          axes_[m].tree.nearest_if(p, kSlack * limit + kSlackMm, [](std::int32_t) { return true; });
      if (hit.index < 0) continue;
      near_[m] = hit.index;
      smallest = std::min(smallest, to_sheet(hit, axes_[m].radius_mm[hit.index]));
    }
    return smallest;
  }

 private:
  // A point at the limit is found in spite of rounding.
  static constexpr double kSlack = 1 + 1e-9, kSlackMm = 1e-12;

  [[nodiscard]] double likely(MaterialId m, const Vec3& p) const {
    return near_[m] < 0 ? kInfinity : distance(p, axes_[m].tree.points()[near_[m]]);
  }

  // The distance to the axis that the points are a sample of. The nearest point of a sheet lies
  // beside the foot of p by up to half the diagonal of a voxel face, which matters for thin sheets;
  // the distance is never below the radius there, which is exact where p is a wall of the sheet.
  [[nodiscard]] double to_sheet(const PointTree::Hit& hit, double radius) const {
    const double foot2 = hit.distance * hit.distance - half_diagonal2_;
    return std::min(hit.distance, std::sqrt(std::max(radius * radius, foot2)));
  }

  const std::vector<MaterialAxis>& axes_;
  double half_diagonal2_;
  std::vector<std::int32_t> near_;  // of each material the last point found, or -1
};

// Distance from every vertex to the medial axis of its materials.
std::vector<double> distance_to_axis(const InterfaceMesh& dense,
                                     const Strata& strata,
                                     const VertexStars& stars,
                                     const MedialAxis& medial_axis,
                                     double voxel_mm) {
  constexpr std::size_t kChunk = 4096;
  MaterialId last = 0;
  for (const auto& patch : strata.patches)
    last = std::max(last, patch.sides.inside);
  const auto axes = axis_of_materials(medial_axis, std::size_t{last} + 1);
  const std::size_t count = dense.points.size();
  std::vector<double> result(count, kInfinity);
  parallel_for_each_index(
      0, (count + kChunk - 1) / kChunk,
      [&](std::size_t chunk) {
        AxisDistance distance_to(axes, voxel_mm);
        std::vector<MaterialId> materials;
        for (std::size_t v = chunk * kChunk; v < std::min(count, (chunk + 1) * kChunk); ++v) {
          find_materials(dense, strata, stars, v, materials);
          result[v] = distance_to(dense.points[v], materials);
        }
      },
      1);
  return result;
}

// A vertex on a curve, once for each curve that it is on: a corner ends several.
struct CurvePoint {
  std::int32_t vertex, curve;
  double arc;  // along the curve from its first vertex
};

class CurveSizes {
 public:
  CurveSizes(const InterfaceMesh& dense, const Strata& strata, double voxel_mm)
      : dense_(dense), strata_(strata), voxel_(voxel_mm), length_(strata.curves.size()) {
    std::vector<Vec3> points;
    for (std::size_t c = 0; c < strata.curves.size(); ++c) {
      const auto& vertices = strata.curves[c].vertices;
      double arc = 0;
      for (std::size_t n = 0; n < vertices.size(); ++n) {
        if (n > 0) arc += distance(dense.points[vertices[n]], dense.points[vertices[n - 1]]);
        points_.push_back({vertices[n], static_cast<std::int32_t>(c), arc});
        points.push_back(dense.points[vertices[n]]);
      }
      if (strata.curves[c].is_closed && !vertices.empty())
        arc += distance(dense.points[vertices.back()], dense.points[vertices.front()]);
      length_[c] = arc;
    }
    tree_ = PointTree(std::move(points));
  }

  // The size of each curve point; a corner's is the smallest of its points.
  [[nodiscard]] std::vector<double> sizes(double bound) const {
    std::vector<double> size(points_.size(), bound);
    std::vector<std::size_t> begin(strata_.curves.size() + 1, 0);
    for (std::size_t c = 0; c < strata_.curves.size(); ++c)
      begin[c + 1] = begin[c] + strata_.curves[c].vertices.size();
    parallel_for_each_index(
        0, strata_.curves.size(), [&](std::size_t c) { limit_by_curvature(c, begin[c], size); }, 1);
    parallel_for_each_index(
        0, points_.size(),
        [&](std::size_t n) { size[n] = std::min(size[n], 0.5 * distance_to_others(n, size[n])); },
        64);
    return size;
  }

  [[nodiscard]] const PointTree& tree() const { return tree_; }

  [[nodiscard]] const std::vector<CurvePoint>& points() const { return points_; }

 private:
  // The point at arc length s of a curve; closed curves wrap around.
  [[nodiscard]] Vec3 point_at(std::size_t curve, std::size_t begin, double s) const {
    const auto& vertices = strata_.curves[curve].vertices;
    const std::size_t n = vertices.size();
    if (strata_.curves[curve].is_closed) s -= std::floor(s / length_[curve]) * length_[curve];
    const auto arcs = points_.begin() + static_cast<std::ptrdiff_t>(begin);
    const auto above =
        std::upper_bound(arcs, arcs + static_cast<std::ptrdiff_t>(n), s,
                         [](double value, const CurvePoint& p) { return value < p.arc; });
    const auto hi = static_cast<std::size_t>(above - arcs);
    if (hi == 0) return dense_.points[vertices.front()];
    const Vec3& a = dense_.points[vertices[hi - 1]];
    if (hi == n && !strata_.curves[curve].is_closed) return a;
    const Vec3& b = dense_.points[vertices[hi == n ? 0 : hi]];
    const double from = points_[begin + hi - 1].arc;
    const double to = hi == n ? length_[curve] : points_[begin + hi].arc;
    return to > from ? a + std::clamp((s - from) / (to - from), 0.0, 1.0) * (b - a) : a;
  }

  // The mean of the curve around s: the extracted curve zigzags between the tets of the lattice.
  [[nodiscard]] Vec3 smooth_point_at(std::size_t curve, std::size_t begin, double s) const {
    constexpr int kSamples = 3;  // on each side
    Vec3 sum;
    for (int n = -kSamples; n <= kSamples; ++n)
      sum += point_at(curve, begin, s + n * kCurveSmoothingVox * voxel_ / kSamples);
    return sum / (2 * kSamples + 1);
  }

  void limit_by_curvature(std::size_t curve, std::size_t begin, std::vector<double>& size) const {
    const std::size_t n = strata_.curves[curve].vertices.size();
    const double length = length_[curve], smoothing = kCurveSmoothingVox * voxel_;
    const bool is_closed = strata_.curves[curve].is_closed;
    for (std::size_t v = 0; v < n; ++v) {
      const double s = points_[begin + v].arc;
      const Vec3 middle = smooth_point_at(curve, begin, s);
      for (const double window : kCurvatureWindowsVox) {
        const double w = window * voxel_;
        // Open curves need the window and its smoothing inside; a closed one is at least three
        // windows around.
        if (is_closed ? 3 * w > length : s < w + smoothing || s + w + smoothing > length) break;
        const Vec3 a = smooth_point_at(curve, begin, s - w);
        const Vec3 b = smooth_point_at(curve, begin, s + w);
        const double half = 0.5 * distance(a, b);
        const double bow = distance(middle, 0.5 * (a + b)) - kCurveNoiseVox * voxel_;
        if (bow > 0)
          size[begin + v] = std::min(size[begin + v], (half * half + bow * bow) / (2 * bow));
      }
      if (is_closed) size[begin + v] = std::min(size[begin + v], length / (2 * M_PI));
    }
  }

  // Along the curves from one point to another: on one curve, or over a corner that two share.
  [[nodiscard]] double way(const CurvePoint& p, const CurvePoint& q) const {
    const auto& cp = strata_.curves[p.curve];
    const auto& cq = strata_.curves[q.curve];
    double shortest = kInfinity;
    if (p.curve == q.curve) {
      shortest = std::abs(p.arc - q.arc);
      if (cp.is_closed) shortest = std::min(shortest, length_[p.curve] - shortest);
    }
    if (cp.is_closed || cq.is_closed) return shortest;
    const std::array<std::pair<std::int32_t, double>, 2> ends_p{
        {{cp.vertices.front(), p.arc}, {cp.vertices.back(), length_[p.curve] - p.arc}}};
    const std::array<std::pair<std::int32_t, double>, 2> ends_q{
        {{cq.vertices.front(), q.arc}, {cq.vertices.back(), length_[q.curve] - q.arc}}};
    for (const auto& [corner_p, way_p] : ends_p)
      for (const auto& [corner_q, way_q] : ends_q)
        if (corner_p == corner_q) shortest = std::min(shortest, way_p + way_q);
    return shortest;
  }

  // To the nearest curve point that is no neighbour of point n, if it is closer than 2 limit.
  [[nodiscard]] double distance_to_others(std::size_t n, double limit) const {
    const CurvePoint& p = points_[n];
    const Vec3& at = dense_.points[p.vertex];
    const auto is_other = [&](std::int32_t m) {
      const CurvePoint& q = points_[m];
      if (q.vertex == p.vertex) return false;
      // Two corners are features of their own, however they are connected.
      if (strata_.dimension[p.vertex] == 0 && strata_.dimension[q.vertex] == 0) return true;
      return way(p, q) > std::max(kMinHairpinVox * voxel_,
                                  kHairpinRatio * distance(at, dense_.points[q.vertex]));
    };
    const auto hit = tree_.nearest_if(at, 2 * limit, is_other);
    return std::min(hit.distance, 2 * limit);
  }

  const InterfaceMesh& dense_;
  const Strata& strata_;
  double voxel_;
  std::vector<double> length_;
  std::vector<CurvePoint> points_;
  PointTree tree_;
};

// Patches that a curve point touches, as indices into `Strata::patches`, ascending.
std::vector<std::vector<std::int32_t>> patches_of_curves(const Strata& strata) {
  std::vector<std::vector<std::int32_t>> result;
  for (const auto& curve : strata.curves) {
    auto& list = result.emplace_back();
    for (const auto& key : curve.patches)
      list.push_back(static_cast<std::int32_t>(
          std::lower_bound(strata.patches.begin(), strata.patches.end(), key) -
          strata.patches.begin()));
  }
  return result;
}

void apply_curve_sizes(const InterfaceMesh& dense,
                       const Strata& strata,
                       const VertexStars& stars,
                       double voxel_mm,
                       double bound,
                       std::vector<double>& lfs) {
  if (strata.curves.empty()) return;
  const CurveSizes curves(dense, strata, voxel_mm);
  const auto size = curves.sizes(bound);
  const auto& points = curves.points();
  std::vector<double> on_curve(dense.points.size(), bound);
  for (std::size_t n = 0; n < points.size(); ++n)
    on_curve[points[n].vertex] = std::min(on_curve[points[n].vertex], size[n]);

  const auto patches = patches_of_curves(strata);
  const auto bounds = [&](std::int32_t n, std::int32_t patch) {
    const auto& list = patches[points[n].curve];
    return std::binary_search(list.begin(), list.end(), patch);
  };
  parallel_for_each_index(
      0, dense.points.size(),
      [&](std::size_t v) {
        if (strata.dimension[v] < 2) {
          lfs[v] = on_curve[v];
          return;
        }
        if (stars.first[v] == stars.first[v + 1]) return;
        const Vec3& p = dense.points[v];
        const std::int32_t patch = strata.patch_of[stars.facet[stars.first[v]]];
        const auto own = curves.tree().nearest_if(p, kNearCurveVox * voxel_mm,
                                                  [&](std::int32_t n) { return bounds(n, patch); });
        if (own.index < 0) return;
        const double of_curve = on_curve[points[own.index].vertex];
        if (lfs[v] >= of_curve) return;
        const auto foreign = curves.tree().nearest_if(
            p, 2 * of_curve, [&](std::int32_t n) { return !bounds(n, patch); });
        lfs[v] = std::max(lfs[v], std::min(of_curve, 0.5 * foreign.distance));
      },
      64);
}

}  // namespace

std::vector<double> local_feature_size(const InterfaceMesh& dense,
                                       const Strata& strata,
                                       const MedialAxis& medial_axis,
                                       double voxel_mm,
                                       const StageContext& context) {
  Box3 box;
  for (const auto& p : dense.points)
    box.add(p);
  const double bound = box.diagonal();
  const VertexStars stars = find_vertex_stars(dense);
  std::vector<double> lfs = distance_to_axis(dense, strata, stars, medial_axis, voxel_mm);
  report_progress(context, kStage, 0.3);
  for (double& d : lfs)
    d = std::min(d, bound);
  apply_curve_sizes(dense, strata, stars, voxel_mm, bound, lfs);
  // A feature size has slope 1 at most; on curves, where it has an origin of its own, that is not
  // yet so.
  limit_along_edges(dense.points, find_vertex_neighbours(dense, stars), 1, lfs);
  report_progress(context, kStage, 0.5);
  return lfs;
}

}  // namespace cvmesh
