// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/core/context.h"
#include "cvmesh/levelset/level_sets.h"
#include "cvmesh/medial/medial_axis.h"
#include "cvmesh/mesh/interface_mesh.h"

#include <cstddef>

namespace cvmesh {

struct MedialAxisOptions {
  double min_chord_vox = 2.0;          ///< pairs of sites closer than this are noise
  double min_chord_ratio = 0.7;        ///< linear pruning: chord over ||(p - fp) + (q - fq)||
  double min_opposed_chord_vox = 0.5;  ///< for opposed walls (normals more than 120 degrees apart)
};

struct MedialAxisStats {
  std::size_t sites = 0;
  std::size_t pairs_tested = 0;             ///< neighbours of one material with different sites
  std::size_t pairs_kept = 0;               ///< points of the axis
  std::size_t pairs_dropped_at_curves = 0;  ///< passed the pruning, but span a wedge at a curve
};

struct MedialAxisResult {
  MedialAxis medial_axis;
  MedialAxisStats stats;
};

/// The integer medial axis of every material [Hesselink 2008], from sub-voxel sites on the
/// smoothed zero sets.
///
/// Two 6-neighbours p, q of one material whose nearest sites fp, fq differ enough see two different
/// walls, and the medial axis passes between them. We leave the paper in four places: the sites lie
/// on the smooth interfaces instead of on voxels (the axis of the bare staircase reaches the
/// surface everywhere); opposed walls count however close they are (sheets thinner than three
/// voxels would have no axis); the walls of a wedge at a junction curve do not count (its bisector
/// reaches the curve, and the feature size would be zero there); and the point is the centre of the
/// ball that touches both walls instead of a voxel centre.
///
/// Pairs of the shortest chords count only where another point of the axis is within reach: two
/// sites on one bump make a point that stands alone.
///
/// `dense` and `strata` are the dense surfaces of `level_sets`; only their junction curves are
/// used. Linear in the number of voxels; 4 bytes per voxel and 28 per site while it runs.
MedialAxisResult extract_medial_axis(const LevelSets& level_sets,
                                     const InterfaceMesh& dense,
                                     const Strata& strata,
                                     const MedialAxisOptions& options,
                                     const StageContext& context);

}  // namespace cvmesh
