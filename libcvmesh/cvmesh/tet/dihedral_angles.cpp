// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/tet/dihedral_angles.h"

#include "cvmesh/core/parallel.h"
#include "cvmesh/mesh/tet_faces.h"
#include "cvmesh/tet/angle_bounds.h"
#include "cvmesh/tet/open_tets.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <vector>

namespace cvmesh {
namespace {

using Tet = OpenTets::Tet;

constexpr double kDegree = std::numbers::pi / 180;

/// The dihedral angles of a tet at its edges, in the order of `OpenTets::kEdges`, degrees.
std::array<double, 6> angles_of(const OpenTets& tets, std::int32_t t) {
  const Tet& tet = tets.tet(t);
  std::array<Vec3, 4> normals;
  for (std::size_t k = 0; k < 4; ++k) {
    const auto& f = kTetFaces[k];
    normals[k] = area_vector2(tets.point(tet[f[0]]), tets.point(tet[f[1]]), tets.point(tet[f[2]]));
  }
  std::array<double, 6> angles;
  for (std::size_t e = 0; e < 6; ++e) {
    // The faces on an edge are those opposite the two other corners.
    const Vec3& m = normals[OpenTets::kEdges[e][2]];
    const Vec3& n = normals[OpenTets::kEdges[e][3]];
    angles[e] = std::atan2(norm(cross(m, n)), -dot(m, n)) / kDegree;
  }
  return angles;
}

/// Angle of the material at a surface edge: that of tet t and of all tets that follow it around
/// the edge to the facets on either side. More than 360 for an edge inside the material.
double wedge_at(const OpenTets& tets, std::int32_t t, std::size_t e) {
  const std::int32_t a = tets.tet(t)[OpenTets::kEdges[e][0]];
  const std::int32_t b = tets.tet(t)[OpenTets::kEdges[e][1]];
  double wedge = angles_of(tets, t)[e];
  for (const std::size_t side : {2U, 3U}) {
    std::int32_t now = t, behind = tets.tet(t)[OpenTets::kEdges[e][side]];
    for (;;) {
      const Tet& corners = tets.tet(now);
      const auto opposite = static_cast<std::size_t>(
          std::find(corners.begin(), corners.end(), behind) - corners.begin());
      const std::int32_t next = tets.neighbour(now, opposite);
      if (next == OpenTets::kNone) break;
      if (next == t) return 361;
      for (const std::int32_t v : corners)
        if (v != a && v != b && v != behind) {
          behind = v;
          break;
        }
      const std::array<double, 6> angles = angles_of(tets, next);
      for (std::size_t k = 0; k < 6; ++k) {
        const std::int32_t v = tets.tet(next)[OpenTets::kEdges[k][0]];
        const std::int32_t w = tets.tet(next)[OpenTets::kEdges[k][1]];
        if ((v == a && w == b) || (v == b && w == a)) wedge += angles[k];
      }
      now = next;
    }
  }
  return wedge;
}

/// The least bound on a tet over the facets of tet t; 0 where there is none below poor.
double bound_of(const OpenTets& tets, std::int32_t t, const AngleBounds& bounds) {
  double least = kPoorMinDeg;
  for (std::size_t k = 0; k < 4; ++k) {
    if (tets.neighbour(t, k) != OpenTets::kNone) continue;
    const auto& f = kTetFaces[k];  // seen from outside
    const Tet& tet = tets.tet(t);
    least = std::min(least, bounds.of_tet_on({tet[f[0]], tet[f[2]], tet[f[1]]}, kPoorMinDeg));
  }
  return least < kPoorMinDeg ? least : 0;
}

/// What is told of a poor tet; its bound is looked for in the surface.
PoorTet poor_tet(const OpenTets& tets, std::int32_t t, const AngleBounds& bounds) {
  const std::array<double, 6> angles = angles_of(tets, t);
  const auto [min, max] = std::minmax_element(angles.begin(), angles.end());
  PoorTet poor{{}, tets.material(t), *min, *max, 0, bound_of(tets, t, bounds)};
  for (const std::int32_t v : tets.tet(t))
    poor.position += tets.point(v) / 4;
  double wedge = kNarrowWedgeDeg;
  for (std::size_t e = 0; e < 6; ++e)
    wedge = std::min(wedge, wedge_at(tets, t, e));
  if (wedge < kNarrowWedgeDeg) poor.wedge_deg = wedge;
  return poor;
}

/// Collects the smallest and the largest angle, and tells which tets cannot change them: no angle
/// of a tet is nearer to 0 or 180 degrees than the arc of its smallest sine.
class Extremes {
 public:
  void add(double min_deg, double max_deg) {
    if (min_deg >= min_deg_ && max_deg <= max_deg_) return;
    min_deg_ = std::min(min_deg_, min_deg);
    max_deg_ = std::max(max_deg_, max_deg);
    constexpr double kRounding = 1e-9;
    const double narrowest = std::max({min_deg_, 180 - max_deg_, 180 - kPoorMaxDeg});
    if (narrowest < 90) held_ = std::sin(narrowest * kDegree) + kRounding;
  }

  /// True for a tet that is not poor and has no angle beyond those collected.
  [[nodiscard]] bool holds(const TetScore& score) const { return score.min_sine >= held_; }

  [[nodiscard]] double min_deg() const { return min_deg_; }

  [[nodiscard]] double max_deg() const { return max_deg_; }

 private:
  double min_deg_ = 180, max_deg_ = 0;
  double held_ = std::numeric_limits<double>::infinity();
};

}  // namespace

DihedralAngles measure_dihedral_angles(const OpenTets& tets) {
  Extremes all, outside_wedges;
  std::vector<std::int32_t> poor;
  for (std::int32_t t = 0; static_cast<std::size_t>(t) < tets.slot_count(); ++t) {
    if (tets.is_removed(t) || outside_wedges.holds(tets.score(t))) continue;
    const std::array<double, 6> angles = angles_of(tets, t);
    const auto [min, max] = std::minmax_element(angles.begin(), angles.end());
    all.add(*min, *max);
    if (*min >= kPoorMinDeg && *max <= kPoorMaxDeg)
      outside_wedges.add(*min, *max);
    else
      poor.push_back(t);
  }
  DihedralAngles result;
  if (!poor.empty()) {
    const AngleBounds bounds(tets.surface());
    result.places.resize(poor.size());
    parallel_for_each_index(
        0, poor.size(), [&](std::size_t n) { result.places[n] = poor_tet(tets, poor[n], bounds); },
        16);
  }
  for (const PoorTet& tet : result.places) {
    if (tet.wedge_deg > 0) {
      ++result.poor_in_wedges;
      result.least_share_of_wedge =
          std::min(result.least_share_of_wedge, tet.min_deg / tet.wedge_deg);
      continue;
    }
    ++result.poor;
    if (tet.bound_deg > 0) ++result.poor_bound_by_surface;
    outside_wedges.add(tet.min_deg, tet.max_deg);
  }
  result.min_deg = all.min_deg();
  result.max_deg = all.max_deg();
  result.min_outside_wedges_deg = outside_wedges.min_deg();
  result.max_outside_wedges_deg = outside_wedges.max_deg();
  std::stable_sort(result.places.begin(), result.places.end(),
                   [](const PoorTet& a, const PoorTet& b) { return a.min_deg < b.min_deg; });
  if (result.places.size() > DihedralAngles::kMostPlaces)
    result.places.resize(DihedralAngles::kMostPlaces);
  return result;
}

}  // namespace cvmesh
