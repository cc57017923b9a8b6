// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/core/context.h"
#include "cvmesh/mesh/material_surfaces.h"
#include "cvmesh/particles/particle_set.h"

namespace cvmesh {

struct InsertParticlesStats {
  std::size_t snapped = 0;       ///< a dense vertex moved onto the particle
  std::size_t edge_splits = 0, facet_splits = 0;
  std::size_t off_position = 0;  ///< kept at its place on the dense surface: moving would fold it
};

}  // namespace cvmesh
