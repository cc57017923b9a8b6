// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/tet/angle_bounds.h"

#include "cvmesh/mesh/facet_predicates.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

namespace cvmesh {
namespace {

constexpr double kDegree = std::numbers::pi / 180;

double mean_edge(const InterfaceMesh& surface) {
  double sum = 0;
  for (const auto& facet : surface.facets)
    sum += distance(surface.points[static_cast<std::size_t>(facet[0])],
                    surface.points[static_cast<std::size_t>(facet[1])]);
  return sum / static_cast<double>(std::max<std::size_t>(surface.facets.size(), 1));
}

FacetIndex index_of(const InterfaceMesh& surface) {
  Box3 bounds;
  for (const Vec3& p : surface.points)
    bounds.add(p);
  FacetIndex index(bounds, std::max(0.5 * mean_edge(surface), 1e-3 * bounds.diagonal()));
  for (std::size_t f = 0; f < surface.facets.size(); ++f)
    index.insert(static_cast<std::int32_t>(f), box_of(surface.points, surface.facets[f]));
  return index;
}

/// A point as seen from a face: how high above it, and how far inside of each edge.
struct Place {
  double height = 0;
  std::array<double, 3> inside{};
};

/// A convex polygon of at most a triangle's corners and one more for each of four cuts.
using Polygon = std::vector<Place>;

/// The part of the polygon where `value` is not negative; `value` is linear in the place.
template <typename Value>
Polygon cut(const Polygon& polygon, const Value& value) {
  Polygon kept;
  for (std::size_t i = 0; i < polygon.size(); ++i) {
    const Place &p = polygon[i], &q = polygon[(i + 1) % polygon.size()];
    const double at_p = value(p), at_q = value(q);
    if (at_p >= 0) kept.push_back(p);
    if ((at_p < 0) == (at_q < 0)) continue;
    const double s = at_p / (at_p - at_q);
    Place between{(1 - s) * p.height + s * q.height, {}};
    for (std::size_t k = 0; k < 3; ++k)
      between.inside[k] = (1 - s) * p.inside[k] + s * q.inside[k];
    kept.push_back(between);
  }
  return kept;
}

/// A face with its plane and the inner normals of its edges.
class Base {
 public:
  Base(const std::vector<Vec3>& points, const std::array<std::int32_t, 3>& corners)
      : points_(points), corners_(corners) {
    const Vec3 area2 = area_vector2(corner(0), corner(1), corner(2));
    normal_ = normalized(area2);
    double around = 0;
    for (std::size_t k = 0; k < 3; ++k) {
      inward_[k] = normalized(cross(normal_, corner(k + 1) - corner(k)));
      around += distance(corner(k), corner(k + 1));
    }
    inner_radius_ = around > 0 ? norm(area2) / around : 0;
  }

  [[nodiscard]] double inner_radius() const { return inner_radius_; }

  /// Holds every pyramid over the face up to the slope.
  [[nodiscard]] Box3 box(double slope) const {
    Box3 box = box_of(points_, corners_);
    const double height = slope * inner_radius_;
    box.lo -= Vec3{height, height, height};
    box.hi += Vec3{height, height, height};
    return box;
  }

  /// The slope at which the pyramid over the face meets the facet, `most` where it does not before.
  ///
  /// Inside the pyramid of slope s are the points with 0 < height < s times their distance to the
  /// nearest edge. Where edge k is the nearest, the least height over distance lies at a corner of
  /// the facet's part there, because a ratio of linear functions has no minimum inside.
  [[nodiscard]] double slope_to(const std::array<std::int32_t, 3>& facet, double most) const {
    Polygon triangle;
    for (const std::int32_t v : facet)
      triangle.push_back(place_of(v));
    triangle = cut(triangle, [](const Place& p) { return p.height; });
    for (std::size_t k = 0; k < 3; ++k)
      triangle = cut(triangle, [k](const Place& p) { return p.inside[k]; });
    // Nearer to an edge the ratio is rounding error; corners left out leave the bound too high.
    const double nearest = 1e-9 * inner_radius_;
    for (std::size_t k = 0; k < 3 && !triangle.empty(); ++k) {
      Polygon part = triangle;
      for (const std::size_t other : {(k + 1) % 3, (k + 2) % 3})
        part = cut(part, [&](const Place& p) { return p.inside[other] - p.inside[k]; });
      for (const Place& p : part)
        if (p.inside[k] > nearest) most = std::min(most, p.height / p.inside[k]);
    }
    return most;
  }

 private:
  [[nodiscard]] const Vec3& point(std::int32_t v) const {
    return points_[static_cast<std::size_t>(v)];
  }

  [[nodiscard]] const Vec3& corner(std::size_t k) const { return point(corners_[k % 3]); }

  /// Corners of the face itself are exactly on it and on their two edges.
  [[nodiscard]] Place place_of(std::int32_t v) const {
    const auto own =
        static_cast<std::size_t>(std::find(corners_.begin(), corners_.end(), v) - corners_.begin());
    Place place;
    if (own == 3) place.height = dot(normal_, point(v) - corner(0));
    for (std::size_t k = 0; k < 3; ++k)
      if (own != k && own != (k + 1) % 3) place.inside[k] = dot(inward_[k], point(v) - corner(k));
    return place;
  }

  const std::vector<Vec3>& points_;
  const std::array<std::int32_t, 3>& corners_;
  Vec3 normal_;
  std::array<Vec3, 3> inward_;  // of the edges from corner k to the next
  double inner_radius_ = 0;
};

}  // namespace

AngleBounds::AngleBounds(const InterfaceMesh& surface)
    : surface_(surface), index_(index_of(surface)) {}

double AngleBounds::of_tet_on(const std::array<std::int32_t, 3>& corners, double most_deg) const {
  const Base base(surface_.points, corners);
  double slope = std::tan(most_deg * kDegree);
  if (!(base.inner_radius() > 0)) return 0;
  index_.query(base.box(slope), [&](const FacetIndex::Entry& entry) {
    const auto& facet = surface_.facets[static_cast<std::size_t>(entry.id)];
    if (!std::is_permutation(facet.begin(), facet.end(), corners.begin()))
      slope = base.slope_to(facet, slope);
  });
  return std::min(most_deg, std::atan(slope) / kDegree);
}

}  // namespace cvmesh
