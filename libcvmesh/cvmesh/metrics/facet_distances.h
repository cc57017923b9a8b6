// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/mesh/interface_mesh.h"
#include "cvmesh/metrics/histogram.h"

#include <vector>

namespace cvmesh {

/// Distances from a surface to another one, facet by facet: what a map of the error shows. The
/// vertices of the final surface lie on the dense one, so it is inside the facets that they differ.
struct FacetDistances {
  std::vector<float> largest_mm;  ///< per facet: the largest of its samples
  double mean_mm = 0;             ///< over the area
  double max_mm = 0;              ///< of all samples
  Histogram area_mm2{0, 1, 1};    ///< area of the surface by distance in mm, from 0 to `max_mm`
};

/// Distances from samples on every facet of `surface` to the nearest point of `reference`,
/// whichever interface that lies on.
///
/// Each facet is divided into n x n equal triangles with edges of at most `sample_spacing_mm`
/// (n at least 2), and their centres are measured, exactly. O(samples log facets).
/// @param reference  at least one facet, unless `surface` has none
FacetDistances measure_facet_distances(const InterfaceMesh& surface,
                                       const InterfaceMesh& reference,
                                       double sample_spacing_mm);

}  // namespace cvmesh
