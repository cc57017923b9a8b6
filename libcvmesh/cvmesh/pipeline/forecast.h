// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/labels/label_volume.h"
#include "cvmesh/metrics/voxel_features.h"
#include "cvmesh/params/parameters.h"

#include <cstddef>

namespace cvmesh {

/// What a run is going to take, from its voxels alone.
struct Forecast {
  std::size_t dense_facets = 0;
  double surface_vertices = 0;  ///< within a factor of three
  double tets = 0;
  double memory_mb = 0;  ///< largest resident memory of cvmesh and its helper
  double seconds = 0;    ///< on idle cores of 2023
};

/// Time and memory follow the dense surface, the number of vertices and the number of voxels; the
/// factors are measured (docs/robustness.md). Sizes of interfaces and boxes are not looked at.
/// @param threads  of the run; half of the work is on one core
Forecast make_forecast(const LabelVolume& labels,
                       const VoxelFeatures& features,
                       const Parameters& parameters,
                       int threads);

}  // namespace cvmesh
