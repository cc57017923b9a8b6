// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/metrics/tet_quality.h"

#include "cvmesh/core/parallel.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace cvmesh {
namespace {

constexpr double kDegrees = 180 / std::numbers::pi;
constexpr double kHistogramBinDeg = 180.0 / TetQuality::kHistogramBins;

double angle_deg(const Vec3& a, const Vec3& b) {
  return std::atan2(norm(cross(a, b)), dot(a, b)) * kDegrees;
}

// The angle at edge ab between the faces that lead on to c and to d.
double dihedral_deg(const Vec3& a, const Vec3& b, const Vec3& c, const Vec3& d) {
  const Vec3 edge = b - a;
  return angle_deg(cross(edge, c - a), cross(edge, d - a));
}

double min_angle_deg(const Vec3& a, const Vec3& b, const Vec3& c) {
  return std::min({angle_deg(b - a, c - a), angle_deg(c - b, a - b), angle_deg(a - c, b - c)});
}

// What the distributions need of one tet; of the dihedral angles only the extremes are kept.
struct TetValues {
  double radius_ratio = 0, scaled_jacobian = 0, min_dihedral_deg = 0, max_dihedral_deg = 0;
  std::array<std::uint8_t, 6> bins{};
};

TetValues values_of(const TetShape& shape) {
  TetValues v;
  v.radius_ratio = shape.radius_ratio;
  v.scaled_jacobian = shape.scaled_jacobian;
  const auto [min, max] = std::minmax_element(shape.dihedral_deg.begin(), shape.dihedral_deg.end());
  v.min_dihedral_deg = *min;
  v.max_dihedral_deg = *max;
  for (int e = 0; e < 6; ++e) {
    const int bin = static_cast<int>(shape.dihedral_deg[e] / kHistogramBinDeg);
    v.bins[e] = static_cast<std::uint8_t>(std::clamp(bin, 0, TetQuality::kHistogramBins - 1));
  }
  return v;
}

TetQuality summarise(const std::vector<TetValues>& values) {
  TetQuality quality;
  const auto describe_all = [&](double TetValues::*member) {
    std::vector<double> column(values.size());
    for (std::size_t i = 0; i < values.size(); ++i)
      column[i] = values[i].*member;
    return describe(std::move(column));
  };
  quality.radius_ratio = describe_all(&TetValues::radius_ratio);
  quality.scaled_jacobian = describe_all(&TetValues::scaled_jacobian);
  quality.min_dihedral_deg = describe_all(&TetValues::min_dihedral_deg);
  quality.max_dihedral_deg = describe_all(&TetValues::max_dihedral_deg);
  for (const TetValues& v : values) {
    for (const std::uint8_t bin : v.bins)
      ++quality.dihedral_histogram[bin];
    if (v.min_dihedral_deg < 5) ++quality.below_5_deg;
    if (v.min_dihedral_deg < 10) ++quality.below_10_deg;
    if (v.min_dihedral_deg < 20) ++quality.below_20_deg;
    if (v.max_dihedral_deg > 165) ++quality.above_165_deg;
  }
  return quality;
}

struct TriangleValues {
  double radius_ratio = 0, min_angle_deg = 0;
};

TriangleQuality summarise(const std::vector<TriangleValues>& values) {
  std::vector<double> ratio(values.size()), angle(values.size());
  for (std::size_t i = 0; i < values.size(); ++i) {
    ratio[i] = values[i].radius_ratio;
    angle[i] = values[i].min_angle_deg;
  }
  return {describe(std::move(ratio)), describe(std::move(angle))};
}

}  // namespace

TetShape tet_shape(const Vec3& a, const Vec3& b, const Vec3& c, const Vec3& d) {
  TetShape shape;
  shape.dihedral_deg = {dihedral_deg(a, b, c, d), dihedral_deg(a, c, b, d),
                        dihedral_deg(a, d, b, c), dihedral_deg(b, c, a, d),
                        dihedral_deg(b, d, a, c), dihedral_deg(c, d, a, b)};
  const Vec3 u = b - a, v = c - a, w = d - a;
  const double volume = volume6(a, b, c, d);
  const double lu = norm(u), lv = norm(v), lw = norm(w);
  const double lbc = distance(b, c), lbd = distance(b, d), lcd = distance(c, d);
  const double largest = std::max({lu * lv * lw, lu * lbc * lbd, lv * lbc * lcd, lw * lbd * lcd});
  shape.scaled_jacobian = largest > 0 ? std::numbers::sqrt2 * volume / largest : 0;
  // r = 3 V / S with V = volume / 6; the circumcentre, seen from a, is `centre` / (2 volume).
  const double surface = (norm(area_vector2(a, b, c)) + norm(area_vector2(a, b, d)) +
                          norm(area_vector2(a, c, d)) + norm(area_vector2(b, c, d))) /
                         2;
  const Vec3 centre =
      squared_norm(u) * cross(v, w) + squared_norm(v) * cross(w, u) + squared_norm(w) * cross(u, v);
  if (volume > 0 && norm(centre) > 0) {
    const double r = volume / 2 / surface;
    const double R = norm(centre) / (2 * volume);
    shape.radius_ratio = std::min(1.0, 3 * r / R);
  }
  return shape;
}

MeshQuality measure_quality(const InterfaceMesh& surface, std::size_t material_count) {
  MeshQuality quality;
  std::vector<TriangleValues> values(surface.facets.size());
  parallel_for_each_index(0, values.size(), [&](std::size_t f) {
    const auto& [i, j, k] = surface.facets[f];
    const Vec3 &a = surface.points[i], &b = surface.points[j], &c = surface.points[k];
    values[f] = {triangle_quality(a, b, c), min_angle_deg(a, b, c)};
  });
  std::vector<std::vector<TriangleValues>> values_of_material(material_count);
  for (std::size_t f = 0; f < values.size(); ++f) {
    const Sides sides = surface.patch_of[f].sides;
    for (const MaterialId m : {sides.inside, sides.outside}) {
      if (m != kExterior) values_of_material[m].push_back(values[f]);
    }
  }
  quality.triangles = summarise(values);
  for (const auto& v : values_of_material)
    quality.triangles_of.push_back(summarise(v));
  return quality;
}

MeshQuality measure_quality(const TetMesh& mesh, std::size_t material_count) {
  MeshQuality quality = measure_quality(mesh.surface, material_count);
  std::vector<TetValues> values(mesh.tets.size());
  parallel_for_each_index(0, values.size(), [&](std::size_t t) {
    const auto& [a, b, c, d] = mesh.tets[t];
    values[t] =
        values_of(tet_shape(mesh.points[a], mesh.points[b], mesh.points[c], mesh.points[d]));
  });
  std::vector<std::vector<TetValues>> values_of_material(material_count);
  for (std::size_t t = 0; t < values.size(); ++t) {
    values_of_material[mesh.material_of[t]].push_back(values[t]);
  }
  quality.tets = summarise(values);
  for (const auto& v : values_of_material)
    quality.tets_of.push_back(summarise(v));
  return quality;
}

}  // namespace cvmesh
