// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/core/random.h"
#include "cvmesh/particles/sheets.h"

#include <vector>

namespace cvmesh {

/// Covers one sheet with points at distances of h, six around each where the surface allows it.
///
/// The points around a place are completed one place after the other, first placed first served,
/// from the rim or from one random point: the gaps between its neighbours are divided into angles
/// of about 60 degrees, and each new point goes to distance h. So the hexagonal layout grows like
/// a crystal, and is broken only where fronts meet [after Loehner 1998]. A random start (Poisson
/// disks) has no order to begin with, and relaxation cannot make much of it.
/// @param rim      places on the boundary of the sheet, with their normals and h
/// @param h_scale  factor on h of the sheet's points
/// @return the new places, in the order in which they were placed
std::vector<SurfacePoint> advance_front(const Sheets& sheets,
                                        const Sheet& sheet,
                                        const std::vector<SurfacePoint>& rim,
                                        double h_scale,
                                        double clearance_mm,
                                        const CounterRandom& random);

}  // namespace cvmesh
