// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/labels/label_volume.h"
#include "cvmesh/params/parameters.h"

#include <cstddef>
#include <optional>

namespace cvmesh {

/// What a run is going to take: vertices, memory and time within a factor of two where they were
/// measured (docs/robustness.md).
struct Forecast {
  std::size_t dense_facets = 0;  ///< exactly
  double surface_vertices = 0;
  double tets = 0;       ///< a rule of thumb
  double memory_mb = 0;  ///< largest resident memory of cvmesh and its helper
  double seconds = 0;    ///< on idle cores of 2023
};

/// The first stages of the run give the forecast's sizes: level sets, which are smoothed less where
/// they are large, dense surfaces, medial axis and sizing field. Memory and time follow facets,
/// vertices and voxels.
///
/// @param labels   on the grid of the volume
/// @param threads  of the run
/// @note  about a tenth of the run's time and a third of its memory; parallel
Forecast make_forecast(const LabelVolume& labels, const Parameters& parameters, int threads);

/// What no forecast exceeds: facets by the voxel faces, vertices as if all edges were as short as
/// the finest anywhere. Takes no time; nothing is known for a working grid that is not the
/// volume's, nor where a largest distance rules the sizes.
std::optional<Forecast> bound_forecast(const LabelVolume& labels,
                                       const Parameters& parameters,
                                       int threads);

}  // namespace cvmesh
