// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/sizing/compute_sizing_field.h"

#include "cvmesh/core/error.h"
#include "cvmesh/core/parallel.h"
#include "cvmesh/sizing/limit_gradation.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <numeric>
#include <string>
#include <utility>
#include <vector>

namespace cvmesh {
namespace {

constexpr char kStage[] = "sizing field";
constexpr double kInfinity = std::numeric_limits<double>::infinity();

// h has slope delta only, so twice the spacing loses little; 20 million nodes took 16 s.
constexpr std::size_t kMaxVolumeNodes = 8'000'000;

// Room for this many vertices on every closed boundary, and on every closed curve: 4 and 3 are the
// least that make a closed surface and a closed curve.
constexpr double kMinBoundaryVertices = 12;
constexpr double kMinCurveVertices = 4;

// Area of the hexagon that a vertex owns at spacing h, over h^2.
const double kHexagon = std::sqrt(3.0) / 2;

// The clamps of one material.
struct Bounds {
  double epsilon, min_edge_mm, max_edge_mm;
};

std::string number(double value) {
  std::string text = std::to_string(value);
  text.erase(text.find_last_not_of('0') + 1);
  if (text.back() == '.') text.pop_back();
  return text;
}

Bounds checked(const Bounds& b, const std::string& where) {
  const auto check = [&](bool ok, const std::string& message) {
    require(ok, ErrorCode::BadParameter, kStage, where + message);
  };
  check(std::isfinite(b.epsilon) && b.epsilon > 0,
        "epsilon (" + number(b.epsilon) + ") must be greater than 0; usual values are 0.5 to 5");
  check(b.min_edge_mm >= 0, "min_edge_mm (" + number(b.min_edge_mm) + ") must not be negative");
  check(b.max_edge_mm > 0, "max_edge_mm (" + number(b.max_edge_mm) + ") must be greater than 0");
  check(b.min_edge_mm <= b.max_edge_mm, "min_edge_mm (" + number(b.min_edge_mm) +
                                            ") exceeds max_edge_mm (" + number(b.max_edge_mm) +
                                            "); lower min_edge_mm");
  return b;
}

// Bounds by material id; the exterior's are infinite unless it is named.
std::vector<Bounds> bounds_of_materials(const InterfaceMesh& dense, const SizingOptions& options) {
  require(std::isfinite(options.delta) && options.delta >= 0, ErrorCode::BadParameter, kStage,
          "delta (" + number(options.delta) + ") must not be negative; usual values are 0.2 to 1");
  require(std::isfinite(options.min_feature_vox) && options.min_feature_vox > 0,
          ErrorCode::BadParameter, kStage,
          "min_feature_vox (" + number(options.min_feature_vox) + ") must be greater than 0");
  MaterialId last = 0;
  for (const auto& patch : dense.patch_of)
    last = std::max(last, patch.sides.inside);
  const Bounds common = checked(
      {options.epsilon, options.min_edge_mm.value_or(0), options.max_edge_mm.value_or(kInfinity)},
      "");
  std::vector<Bounds> bounds(std::size_t{last} + 1, common);
  bounds[kExterior] = {kInfinity, kInfinity, kInfinity};
  for (const auto& [m, own] : options.per_material) {
    const Bounds b =
        checked({own.epsilon.value_or(common.epsilon), own.min_edge_mm.value_or(common.min_edge_mm),
                 own.max_edge_mm.value_or(common.max_edge_mm)},
                "material " + std::to_string(m) + ": ");
    if (m < bounds.size()) bounds[m] = b;
  }
  return bounds;
}

std::vector<double> wanted_size(const InterfaceMesh& dense,
                                const VertexStars& stars,
                                const std::vector<double>& lfs_mm,
                                double min_feature_mm,
                                const std::vector<Bounds>& bounds) {
  std::vector<double> h(lfs_mm.size(), kInfinity);
  parallel_for_each_index(0, h.size(), [&](std::size_t v) {
    const double feature = std::max(lfs_mm[v], min_feature_mm);
    const auto lower = [&](MaterialId m) {
      const Bounds& b = bounds[m];
      h[v] = std::min(h[v], std::clamp(b.epsilon * feature, b.min_edge_mm, b.max_edge_mm));
    };
    for (auto s = stars.first[v]; s < stars.first[v + 1]; ++s) {
      lower(dense.patch_of[stars.facet[s]].sides.inside);
      lower(dense.patch_of[stars.facet[s]].sides.outside);
    }
    // A point without facets belongs to no material.
    if (h[v] == kInfinity) h[v] = feature;
  });
  return h;
}

class DisjointSets {
 public:
  explicit DisjointSets(std::size_t n) : parent_(n) {
    std::iota(parent_.begin(), parent_.end(), std::int32_t{0});
  }

  std::int32_t find(std::int32_t x) {
    while (parent_[x] != x)
      x = parent_[x] = parent_[parent_[x]];
    return x;
  }

  // The smaller root stays, so roots do not depend on the order of the unions.
  void unite(std::int32_t x, std::int32_t y) {
    x = find(x);
    y = find(y);
    parent_[std::max(x, y)] = std::min(x, y);
  }

 private:
  std::vector<std::int32_t> parent_;
};

// The largest h that leaves room for `kMinBoundaryVertices` on each connected component of each
// material's boundary. A facet counts once on each of its two sides, and a boundary has one cycle
// of facets around each vertex, so facets that share a vertex and a material are connected.
void cap_by_area(const InterfaceMesh& dense, const VertexStars& stars, std::vector<double>& h) {
  const auto material = [&](std::int32_t sided) {
    const Sides& sides = dense.patch_of[sided / 2].sides;
    return sided % 2 == 0 ? sides.inside : sides.outside;
  };
  DisjointSets sets(2 * dense.facets.size());
  std::vector<std::int32_t> seen;  // one sided facet per material around the vertex
  const auto visit_materials = [&](std::size_t v, const auto& on_first, const auto& on_repeat) {
    seen.clear();
    for (auto s = stars.first[v]; s < stars.first[v + 1]; ++s)
      for (const auto sided : {2 * stars.facet[s], 2 * stars.facet[s] + 1}) {
        const auto same = std::find_if(seen.begin(), seen.end(), [&](std::int32_t other) {
          return material(other) == material(sided);
        });
        if (same != seen.end()) {
          on_repeat(*same, sided);
        } else {
          seen.push_back(sided);
          on_first(sided);
        }
      }
  };
  for (std::size_t v = 0; v < h.size(); ++v)
    visit_materials(
        v, [](std::int32_t) {}, [&](std::int32_t a, std::int32_t b) { sets.unite(a, b); });
  std::vector<double> area(2 * dense.facets.size(), 0);
  for (std::size_t f = 0; f < dense.facets.size(); ++f) {
    const auto& [a, b, c] = dense.facets[f];
    const double facet_area =
        0.5 * norm(area_vector2(dense.points[a], dense.points[b], dense.points[c]));
    for (const auto sided : {2 * f, 2 * f + 1})
      area[sets.find(static_cast<std::int32_t>(sided))] += facet_area;
  }
  for (std::size_t v = 0; v < h.size(); ++v)
    visit_materials(
        v,
        [&](std::int32_t sided) {
          const double room = area[sets.find(sided)] / (kHexagon * kMinBoundaryVertices);
          h[v] = std::min(h[v], std::sqrt(room));
        },
        [](std::int32_t, std::int32_t) {});
}

void cap_on_closed_curves(const InterfaceMesh& dense,
                          const Strata& strata,
                          std::vector<double>& h) {
  for (const auto& curve : strata.curves) {
    if (!curve.is_closed) continue;
    double length = 0;
    for (std::size_t n = 0; n < curve.vertices.size(); ++n)
      length += distance(dense.points[curve.vertices[n]],
                         dense.points[curve.vertices[(n + 1) % curve.vertices.size()]]);
    for (const auto v : curve.vertices)
      h[v] = std::min(h[v], length / kMinCurveVertices);
  }
}

// Vertices of a mesh with spacing h. A patch of area A and border L holds A / (hexagon) - L / (2 h)
// vertices inside (Pick's theorem on the triangular lattice); its border is counted on the curves.
double expected_vertices(const InterfaceMesh& dense,
                         const Strata& strata,
                         const std::vector<double>& h) {
  std::vector<double> inside(strata.patches.size(), 0);
  for (std::size_t f = 0; f < dense.facets.size(); ++f) {
    const auto& [a, b, c] = dense.facets[f];
    const double area = 0.5 * norm(area_vector2(dense.points[a], dense.points[b], dense.points[c]));
    const double density = (1 / (h[a] * h[a]) + 1 / (h[b] * h[b]) + 1 / (h[c] * h[c])) / 3;
    inside[strata.patch_of[f]] += area * density / kHexagon;
  }
  double on_curves = 0;
  for (const auto& curve : strata.curves) {
    const std::size_t n = curve.vertices.size();
    double count = 0;
    for (std::size_t e = 0; e + (curve.is_closed ? 0 : 1) < n; ++e) {
      const auto a = curve.vertices[e], b = curve.vertices[(e + 1) % n];
      count += distance(dense.points[a], dense.points[b]) * 0.5 * (1 / h[a] + 1 / h[b]);
    }
    for (const auto& key : curve.patches)
      inside[std::lower_bound(strata.patches.begin(), strata.patches.end(), key) -
             strata.patches.begin()] -= 0.5 * count;
    // An open curve ends at corners, which are counted once for all.
    on_curves += curve.is_closed ? count : std::max(count - 1, 0.0);
  }
  double total = on_curves;
  for (const auto d : strata.dimension)
    total += d == 0 ? 1 : 0;
  for (const double n : inside)
    total += std::max(n, 0.0);
  return total;
}

// Smallest, median and largest of the values; zeros when there are none.
struct Range {
  double min = 0, median = 0, max = 0;
};

Range range_of(std::vector<double> values) {
  if (values.empty()) return {};
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  const auto [lo, hi] = std::minmax_element(values.begin(), values.end());
  return {*lo, *middle, *hi};
}

}  // namespace

SizingResult compute_sizing_field(const InterfaceMesh& dense,
                                  const Strata& strata,
                                  std::vector<double> lfs_mm,
                                  const GridFrame& frame,
                                  const SizingOptions& options,
                                  const StageContext& context) {
  const auto bounds = bounds_of_materials(dense, options);
  const VertexStars stars = find_vertex_stars(dense);
  SizingResult result;
  SizingField& field = result.sizing_field;
  field.delta = options.delta;

  std::vector<double> h =
      wanted_size(dense, stars, lfs_mm, options.min_feature_vox * frame.voxel_mm(), bounds);
  const std::vector<double> uncapped = h;
  cap_by_area(dense, stars, h);
  cap_on_closed_curves(dense, strata, h);
  for (std::size_t v = 0; v < h.size(); ++v)
    result.stats.capped_vertices += h[v] < uncapped[v];
  report_progress(context, kStage, 0.6);

  limit_along_edges(dense, stars, options.delta, h);
  field.volume_h_mm = extend_from_points(dense.points, h, options.delta, frame, kMaxVolumeNodes);
  report_progress(context, kStage, 0.9);
  // Walls that are close in space but far apart on the surface limit each other through the volume.
  parallel_for_each_index(0, h.size(),
                          [&](std::size_t v) { h[v] = std::min(h[v], field.at(dense.points[v])); });
  limit_along_edges(dense, stars, options.delta, h);
  if (options.max_edge_mm)
    for (float& value : field.volume_h_mm.values)
      value = std::min(value, static_cast<float>(*options.max_edge_mm));

  const Range lfs_range = range_of(lfs_mm), h_range = range_of(h);
  auto& stats = result.stats;
  stats.lfs_min_mm = lfs_range.min;
  stats.lfs_median_mm = lfs_range.median;
  stats.lfs_max_mm = lfs_range.max;
  stats.h_min_mm = h_range.min;
  stats.h_median_mm = h_range.median;
  stats.h_max_mm = h_range.max;
  stats.expected_vertices = expected_vertices(dense, strata, h);
  field.lfs_mm = std::move(lfs_mm);
  field.h_mm = std::move(h);
  report_progress(context, kStage, 1);
  return result;
}

}  // namespace cvmesh
