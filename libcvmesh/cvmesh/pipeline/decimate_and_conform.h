// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/labels/label_volume.h"
#include "cvmesh/mesh/material_surfaces.h"
#include "cvmesh/pipeline/run.h"
#include "cvmesh/surface/conform_edges.h"
#include "cvmesh/surface/decimate.h"

#include <vector>

namespace cvmesh {

/// The sequential schedule: every material's boundary thinned out on its own, then edge flips until
/// they are conformal, then the patches of all masters joined. Two stages of the run.
/// @param augmented  the dense surfaces with the particles as vertices
/// @param keep       one entry per vertex of `augmented`: true for particles
/// @throws Error as `decimate_sequential` and `require_conformal`
DecimateResult decimate_and_conform(Run& run,
                                    const LabelVolume& labels,
                                    MaterialSurfaces augmented,
                                    const std::vector<bool>& keep,
                                    const DecimateOptions& options);

/// Nothing, if the patches of all masters make one valid surface.
/// @throws Error StageFailed, with how many, between which labels and where, if vertices or edges
///         are not the same in both boundaries, an edge lies on two interfaces, or facets intersect
void require_conformal(const ConformEdgesResult& conformed,
                       const MeshNames& names,
                       std::size_t material_count);

}  // namespace cvmesh
