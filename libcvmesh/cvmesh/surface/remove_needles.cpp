// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/surface/remove_needles.h"

#include "cvmesh/surface/vertex_remover.h"

#include <spdlog/spdlog.h>

#include <algorithm>
#include <array>
#include <cstdint>
#include <utility>
#include <vector>

namespace cvmesh {
namespace {

// Facets this flat are needles or caps: one corner lies at another one, or between the two others.
// From the first bound to the second, by twos.
constexpr double kFlattest = 1e-4, kLeastFlat = 0.0128;
// Dihedral angles over 20 degrees; a needle beside a ridge has no normal to speak of.
constexpr double kMinNormalCosine = -0.50, kMinFoldCosine = -0.94;

// The corner at which the longest side does not end: of a needle's short side one end, of a cap its
// tip.
std::int32_t blunt_corner(const std::vector<Vec3>& points,
                          const std::array<std::int32_t, 3>& corners) {
  const auto& [a, b, c] = corners;
  const double ab = squared_norm(points[b] - points[a]), bc = squared_norm(points[c] - points[b]);
  const double ca = squared_norm(points[a] - points[c]);
  if (ab >= bc && ab >= ca) return c;
  return bc >= ca ? a : b;
}

// The blunt corners of facets poorer than `below`, ascending; only those inside a patch: corners
// and curves keep their vertices.
std::vector<std::int32_t> find_blunt_corners(const MaterialSurfaces& surfaces, double below) {
  const auto& points = surfaces.points();
  std::vector<std::int32_t> vertices;
  for (const auto& facet : surfaces.facets()) {
    const auto& [a, b, c] = facet.vertices;
    if (facet.is_alive && triangle_quality(points[a], points[b], points[c]) < below)
      vertices.push_back(blunt_corner(points, facet.vertices));
  }
  std::sort(vertices.begin(), vertices.end());
  vertices.erase(std::unique(vertices.begin(), vertices.end()), vertices.end());
  std::vector<MaterialSurfaces::Sheet> sheets;
  std::erase_if(vertices, [&](std::int32_t v) {
    return !surfaces.collect_sheets(v, sheets) || sheets.size() != 1 || !sheets.front().is_disk;
  });
  return vertices;
}

}  // namespace

RemoveNeedlesResult remove_needles(MaterialSurfaces surfaces,
                                   double voxel_mm,
                                   double deviation_vox,
                                   const StageContext& context) {
  RemoveNeedlesResult result;
  {
    VertexRemover remover(surfaces, voxel_mm, deviation_vox * voxel_mm);
    for (double below = kFlattest; below <= kLeastFlat; below *= 2) {
      // again while some go: their neighbours may have become blunt corners
      for (std::size_t gone = 1; gone > 0; result.stats.removed += gone) {
        report_progress(context, "edge flipping", 1);
        gone = 0;
        remover.try_each(find_blunt_corners(surfaces, below),
                         {below, kMinNormalCosine, kMinFoldCosine},
                         [&](std::int32_t, Refusal refusal) {
                           if (refusal == Refusal::None) ++gone;
                         });
      }
    }
  }
  context.log->debug("needles: {} vertices removed", result.stats.removed);
  result.surfaces = std::move(surfaces);
  return result;
}

}  // namespace cvmesh
