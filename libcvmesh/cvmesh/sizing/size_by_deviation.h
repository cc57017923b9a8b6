// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/mesh/interface_mesh.h"

#include <vector>

namespace cvmesh {

/// Edge lengths, at the dense vertices, in mm, that spend about `vertices` surface vertices where
/// they bring the facets nearest to the dense surface.
///
/// A facet with edges h lies off a surface of curvature kappa by an amount that goes with
/// kappa h^2, and takes h^2 of area; the mean distance of a given number of facets is smallest
/// where kappa h^4 is the same everywhere, by Lagrange's multiplier [Chen 2007]. Here kappa is not
/// that of a point, which on voxel data is noise at the scale of a facet, but what a facet will
/// see: how far the surface of one patch lies off its own best plane, within a facet's reach.
/// Nearly flat regions are not told apart by what is left of their noise.
///
/// Rotation-invariant up to the cells it is gathered in; O(facets log facets); parallel.
/// @param voxel_mm  finest reach
/// @return one length per point of `dense`; the common scale holds `vertices` up to gradation,
///         bounds and guards
std::vector<double> size_by_deviation(const InterfaceMesh& dense,
                                      const Strata& strata,
                                      double vertices,
                                      double voxel_mm);

}  // namespace cvmesh
