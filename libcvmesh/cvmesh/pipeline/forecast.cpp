// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/pipeline/forecast.h"

#include <algorithm>
#include <cmath>
#include <vector>

namespace cvmesh {
namespace {

// Measured on volumes of 28^3 to 40 million voxels, 1 to 116 labels, two threads.
constexpr double kVerticesPerSquare =
    1.0;  ///< of h: hexagonal packing (1.15) over the excess of stairs
constexpr double kTetsPerVertex = 12;
constexpr double kBaseMb = 15;
constexpr double kBytesPerVoxel = 3, kBytesPerFacet = 480, kBytesPerVertex = 4500;
constexpr double kSecondsPerFacet = 17e-6, kSecondsPerVoxel = 0.3e-6, kSecondsPerVertex = 4e-4;
constexpr double kSequentialShare = 0.5;  ///< of the time on two threads
constexpr double kMebi = 1 << 20;

/// epsilon and bounds of one material.
struct Sizes {
  double epsilon = 1, least_mm = 0, most_mm = INFINITY;
};

std::vector<Sizes> sizes_of(const LabelVolume& labels, const Parameters& parameters) {
  const SizingOptions& all = parameters.sizing;
  std::vector<Sizes> sizes(labels.material_count(), {all.epsilon, all.min_edge_mm.value_or(0),
                                                     all.max_edge_mm.value_or(INFINITY)});
  for (std::size_t m = 1; m < sizes.size(); ++m) {
    const auto own = parameters.labels.find(labels.label_of[m]);
    if (own == parameters.labels.end()) continue;
    sizes[m] = {own->second.epsilon.value_or(sizes[m].epsilon),
                own->second.min_edge_mm.value_or(sizes[m].least_mm),
                own->second.max_edge_mm.value_or(sizes[m].most_mm)};
  }
  return sizes;
}

/// Vertices that the sizes of the faces lead to: the integral of dA / h^2.
double expected_vertices(const LabelVolume& labels,
                         const VoxelFeatures& features,
                         const Parameters& parameters) {
  const std::vector<Sizes> sizes = sizes_of(labels, parameters);
  const double floor_mm = parameters.sizing.min_feature_vox * labels.frame().voxel_mm();
  const auto edge = [&](MaterialId material, double feature_mm) {
    const Sizes& own = sizes[material];
    return std::clamp(own.epsilon * feature_mm, own.least_mm, std::max(own.least_mm, own.most_mm));
  };
  double vertices = 0;
  for (const VoxelFace& face : features.faces) {
    const double feature_mm = std::max<double>(face.feature_mm, floor_mm);
    // The exterior, which is the smaller id, has no sizes of its own.
    const double h = face.low == kExterior
                         ? edge(face.high, feature_mm)
                         : std::min(edge(face.low, feature_mm), edge(face.high, feature_mm));
    vertices += kVerticesPerSquare * face.area_mm2 / (h * h);
  }
  return vertices;
}

}  // namespace

Forecast make_forecast(const LabelVolume& labels,
                       const VoxelFeatures& features,
                       const Parameters& parameters,
                       int threads) {
  const auto voxels = static_cast<double>(labels.frame().size());
  Forecast forecast;
  forecast.dense_facets = features.dense_facets;
  const auto facets = static_cast<double>(features.dense_facets);
  if (parameters.target_vertices)
    forecast.surface_vertices = static_cast<double>(*parameters.target_vertices);
  else if (parameters.target_tets)
    forecast.surface_vertices = static_cast<double>(*parameters.target_tets) / kTetsPerVertex;
  else
    forecast.surface_vertices = expected_vertices(labels, features, parameters);
  forecast.tets = kTetsPerVertex * forecast.surface_vertices;
  forecast.memory_mb =
      kBaseMb + (kBytesPerVoxel * voxels +
                 std::max(kBytesPerFacet * facets, kBytesPerVertex * forecast.surface_vertices)) /
                    kMebi;
  const double on_two_threads = kSecondsPerFacet * facets + kSecondsPerVoxel * voxels +
                                kSecondsPerVertex * forecast.surface_vertices;
  forecast.seconds =
      on_two_threads * (kSequentialShare + (1 - kSequentialShare) * 2 / std::max(1, threads));
  return forecast;
}

}  // namespace cvmesh
