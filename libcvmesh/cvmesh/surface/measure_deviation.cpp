// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/surface/measure_deviation.h"

#include "cvmesh/core/parallel.h"
#include "cvmesh/mesh/facet_shapes.h"
#include "cvmesh/mesh/shape_tree.h"

#include <algorithm>
#include <array>
#include <cstdint>

namespace cvmesh {
namespace {

/// A surface to which points are near.
class Target {
 public:
  explicit Target(const InterfaceMesh& surface) : shapes_{surface}, tree_(shapes_) {}

  /// The nearest point of the surface.
  /// @param guess  a facet near p, or -1; then the facet that was found
  [[nodiscard]] Vec3 nearest(const Vec3& p, std::int64_t& guess) const {
    guess = tree_.nearest(p, guess, [](std::size_t) { return true; }).shape;
    return shapes_.nearest(static_cast<std::size_t>(guess), p);
  }

 private:
  FacetShapes shapes_;
  ShapeTree<FacetShapes> tree_;
};

void note(const Vec3& place, double distance_mm, double limit_mm, Deviation& deviation) {
  deviation.max_mm = std::max(deviation.max_mm, distance_mm);
  if (distance_mm > limit_mm) deviation.above.push_back({place, distance_mm});
}

}  // namespace

Deviation measure_deviation(const InterfaceMesh& surface,
                            const InterfaceMesh& dense,
                            double limit_mm,
                            double spacing_mm) {
  if (surface.facets.empty() || dense.facets.empty()) return {};
  const Target on_surface(surface), on_dense(dense);
  // Blocks do not depend on the number of threads, nor do the guesses.
  constexpr std::size_t kBlock = 64;
  const auto blocks_of = [](std::size_t count) { return (count + kBlock - 1) / kBlock; };
  const std::size_t vertex_blocks = blocks_of(dense.points.size());
  std::vector<Deviation> parts(vertex_blocks + blocks_of(surface.facets.size()));
  parallel_for_each_index(
      0, parts.size(),
      [&](std::size_t n) {
        Deviation& part = parts[n];
        std::int64_t guess = -1;
        if (n < vertex_blocks) {
          for (std::size_t v = n * kBlock; v < std::min(dense.points.size(), (n + 1) * kBlock); ++v)
            note(dense.points[v],
                 distance(dense.points[v], on_surface.nearest(dense.points[v], guess)), limit_mm,
                 part);
          return;
        }
        const FacetShapes shapes{surface};
        const std::size_t begin = (n - vertex_blocks) * kBlock;
        for (std::size_t f = begin; f < std::min(shapes.size(), begin + kBlock); ++f) {
          const std::array<Vec3, 3> p = shapes.corners(f);
          const auto look_from = [&](const Vec3& q) {
            const Vec3 place = on_dense.nearest(q, guess);
            note(place, distance(place, q), limit_mm, part);
          };
          for_each_centre(p, divisions(p, spacing_mm), look_from);
          for (std::size_t k = 0; k < 3; ++k) {
            look_from(p[k]);
            look_from(0.5 * (p[k] + p[(k + 1) % 3]));
          }
        }
      },
      1);
  Deviation all;
  for (const Deviation& part : parts) {
    all.max_mm = std::max(all.max_mm, part.max_mm);
    all.above.insert(all.above.end(), part.above.begin(), part.above.end());
  }
  return all;
}

}  // namespace cvmesh
