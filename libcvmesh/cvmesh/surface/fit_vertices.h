// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/core/context.h"
#include "cvmesh/mesh/material_surfaces.h"

#include <cstddef>

namespace cvmesh {

struct FitVerticesOptions {
  double max_shift_vox = 0.5;  ///< farthest that a vertex goes from where it was; 0 for no fit
  int max_sweeps = 4;
};

struct FitVerticesStats {
  std::size_t vertices = 0;  ///< that ended elsewhere
  std::size_t refused = 0;   ///< moves that an intersection, a fold or a poor facet forbade
  int sweeps = 0;
  double mean_shift_mm = 0, max_shift_mm = 0;  ///< over the vertices that ended elsewhere
  /// Root mean square distance of the dense vertices from their facets.
  double rms_before_mm = 0, rms_after_mm = 0;
};

struct FitVerticesResult {
  MaterialSurfaces surfaces;
  FitVerticesStats stats;
};

/// Moves the vertices of the sparse surfaces to where their facets fit the dense surface best, in
/// the sense of least squares over the samples that the facets carry [Hoppe 1993, "Mesh
/// optimization", §4.1: the inner problem].
///
/// A facet whose corners lie on a curved surface lies wholly on one side of it: convex parts lose
/// volume, and the distance is all of one sign. Half of it goes when the corners leave the surface
/// by a part of that distance. Where a vertex was counts as one more sample, so that it moves off
/// the surface and hardly along it. Vertices on the border of the image stay.
///
/// Vertices move one after the other, each only if the sum of squares around it falls, no facet
/// folds or becomes poorer than it was, none intersects or comes near another, and nothing is
/// jumped over. So every invariant of `MaterialSurfaces` is kept, and the sum over the whole
/// surface falls with every move. In parallel where moves cannot see each other; equal bytes for
/// any number of threads.
FitVerticesResult fit_vertices(MaterialSurfaces surfaces,
                               double voxel_mm,
                               const FitVerticesOptions& options,
                               const StageContext& context);

}  // namespace cvmesh
