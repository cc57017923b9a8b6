// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/metrics/facet_distances.h"

#include "cvmesh/core/parallel.h"
#include "cvmesh/mesh/facet_shapes.h"
#include "cvmesh/mesh/shape_tree.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace cvmesh {
namespace {

constexpr std::size_t kBins = 60;
constexpr std::size_t kGrain = 64;  // facets that are measured one after the other

}  // namespace

FacetDistances measure_facet_distances(const InterfaceMesh& surface,
                                       const InterfaceMesh& reference,
                                       double sample_spacing_mm) {
  const std::size_t count = surface.facets.size();
  const FacetShapes shapes{reference}, own{surface};
  const ShapeTree<FacetShapes> tree(shapes);
  std::vector<std::vector<float>> samples(count);
  parallel_for_each_index(
      0, count,
      [&](std::size_t f) {
        const std::array<Vec3, 3> corners = own.corners(f);
        std::int64_t guess = -1;
        for_each_centre(corners, std::max(2, divisions(corners, sample_spacing_mm)),
                        [&](const Vec3& p) {
                          const auto hit = tree.nearest(p, guess, [](std::size_t) { return true; });
                          guess = hit.shape;
                          samples[f].push_back(static_cast<float>(std::sqrt(hit.squared_distance)));
                        });
      },
      kGrain);

  FacetDistances result;
  for (const std::vector<float>& of_facet : samples)
    result.largest_mm.push_back(*std::max_element(of_facet.begin(), of_facet.end()));
  for (const float largest : result.largest_mm)
    result.max_mm = std::max(result.max_mm, static_cast<double>(largest));
  // Surfaces that coincide still need bins of some width.
  result.area_mm2 = Histogram(0, result.max_mm > 0 ? result.max_mm : 1, kBins);
  double area_sum = 0;
  for (std::size_t f = 0; f < count; ++f) {
    const auto [a, b, c] = own.corners(f);
    const double area = norm(area_vector2(a, b, c)) / 2;
    const double share = area / static_cast<double>(samples[f].size());
    area_sum += area;
    for (const float d : samples[f]) {
      result.area_mm2.add(d, share);
      result.mean_mm += share * d;
    }
  }
  if (area_sum > 0) result.mean_mm /= area_sum;
  return result;
}

}  // namespace cvmesh
