// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/core/context.h"
#include "cvmesh/levelset/level_sets.h"
#include "cvmesh/medial/medial_axis.h"
#include "cvmesh/mesh/interface_mesh.h"

namespace cvmesh {

struct MedialAxisOptions {
  double min_chord_vox = 3.0;        ///< pairs of sites closer than this are noise
  double min_chord_ratio = 0.7;      ///< linear pruning: chord over ||(p - fp) + (q - fq)||
  double min_opposed_chord_vox = 0.5;///< for opposed walls (normals more than 120 degrees apart)
};

struct MedialAxisStats {
  std::size_t sites = 0, pairs_tested = 0, pairs_kept = 0, pairs_dropped_at_curves = 0;
};

struct MedialAxisResult {
  MedialAxis medial_axis;
  MedialAxisStats stats;
};

/// The integer medial axis of every material [Hesselink 2008], from sub-voxel sites on the
/// smoothed zero sets.
MedialAxisResult extract_medial_axis(const LevelSets& level_sets, const InterfaceMesh& dense,
                                     const Strata& strata, const MedialAxisOptions& options,
                                     const StageContext& context);

}  // namespace cvmesh
