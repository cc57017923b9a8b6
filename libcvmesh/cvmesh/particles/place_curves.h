// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/particles/sheets.h"

#include <vector>

namespace cvmesh {

/// A particle on every corner, moved onto the point where its four materials meet if that is
/// within half a voxel; corners on the border of the image, and those of other than four
/// materials, stay on their dense vertex. In the order of the vertices.
std::vector<Particle> place_corners(const ParticleDomain& domain);

/// Particles along every junction curve, at equal steps of the integral of ds / h, in the order
/// of the curves. Solving for the places beats relaxing them: no sweeps, nothing random, and the
/// interfaces start from neighbours that no longer move.
///
/// Every closed curve gets at least three (four, if it has eight dense vertices), an open one from
/// a corner to itself two, one whose end points another curve joins as well one: fewer could not
/// be the edges of a surface. Those beyond the integral are of origin Guard. Where an arc between
/// two particles is higher than half its chord (a semicircle) and half a voxel, its farthest vertex
/// gets a particle of origin Bend: without it the groove that the interfaces form around the corner
/// of a block would be cut by a chord, deep below the dense surface.
/// @param corners  of `place_corners`
std::vector<Particle> place_curves(const ParticleDomain& domain,
                                   const std::vector<Particle>& corners);

}  // namespace cvmesh
