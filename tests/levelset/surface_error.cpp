// SPDX-License-Identifier: AGPL-3.0-or-later
#include "levelset/surface_error.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

namespace cvmesh::label_grids {

void SurfaceError::add(const Smooth& s,
                       const std::function<std::optional<TruthAt>(const Vec3&)>& truth) {
  std::vector<double> share(s.mesh.points.size());
  for (const auto& [a, b, c] : s.mesh.facets)
    for (const auto v : {a, b, c})
      share[v] += norm(area_vector2(s.mesh.points[a], s.mesh.points[b], s.mesh.points[c])) / 6;
  for (std::size_t v = 0; v < s.mesh.points.size(); ++v) {
    const auto expected = truth(s.mesh.points[v]);
    if (!expected) continue;
    sum_ += expected->distance;
    sum2_ += expected->distance * expected->distance;
    ++count_;
    const Vec3 gradient = s.level_sets.smooth_gradient(0, 1, s.mesh.points[v]);
    const double cosine = std::clamp(dot(normalized(gradient), expected->normal), -1.0, 1.0);
    angle_times_area_ += share[v] * std::acos(cosine) * 180 / std::numbers::pi;
    area_ += share[v];
  }
}

double SurfaceError::rms() const {
  return std::sqrt(sum2_ / count_);
}

double SurfaceError::bias() const {
  return sum_ / count_;
}

double SurfaceError::normal_deg() const {
  return angle_times_area_ / area_;
}

double volume_inside(const InterfaceMesh& mesh, MaterialId m) {
  double six = 0;
  for (std::size_t f = 0; f < mesh.facets.size(); ++f) {
    const auto& [a, b, c] = mesh.facets[f];
    const double v = volume6({}, mesh.points[a], mesh.points[b], mesh.points[c]);
    if (mesh.patch_of[f].sides.inside == m) six += v;
    if (mesh.patch_of[f].sides.outside == m) six -= v;
  }
  return six / 6;
}

}  // namespace cvmesh::label_grids
