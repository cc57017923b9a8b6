// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/core/label.h"
#include "cvmesh/core/vec3.h"

#include <cstddef>
#include <span>
#include <vector>

namespace cvmesh {

/// Distances from one surface to another.
///
/// The largest distance is proven: it lies between `max`, which `worst_mm` attains, and
/// `max + max_error`. The others are means over the area, from samples spread evenly over it;
/// `mean_standard_error` is that of as many independent samples, sd / sqrt(n) for equal weights:
/// an upper estimate, since spread samples vary less.
struct DistanceStats {
  double max = 0, max_error = 0;
  double p95 = 0;  ///< a twentieth of the area is farther away
  double mean = 0, mean_standard_error = 0, rms = 0;
  std::size_t samples = 0;  ///< 0: nothing to measure
  Vec3 worst_mm;            ///< where `max` is, on the surface that is measured; grid mm
  Sides worst_sides;        ///< materials on either side there
};

/// Sampled distances that stand for `weight` of area each.
struct SampleRun {
  std::span<const float> distances;
  float weight = 0;
};

/// All but the maximum, the same at any number of threads.
DistanceStats sample_stats(const std::vector<SampleRun>& runs);

}  // namespace cvmesh
