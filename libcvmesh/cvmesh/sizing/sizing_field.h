// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/grid/grid.h"

#include <vector>

namespace cvmesh {

/// Target edge length h: on the dense surface vertices, and on the working grid for the interior.
///
/// `h > 0` everywhere. |h(a) - h(b)| <= delta |a - b| along every edge of the dense surface, and on
/// the grid up to its discretisation: between the nodes of one edge, h differs by delta times the
/// spacing at most.
struct SizingField {
  std::vector<double> lfs_mm;  ///< local feature size at each dense vertex
  std::vector<double> h_mm;    ///< target edge length at each dense vertex
  Grid<float> volume_h_mm;     ///< the same, extended into the volume (maybe a coarser frame)
  double delta = 0.4;          ///< gradation: the Lipschitz bound of h
  /// Small closed parts are to have h low enough for their topology, and short loops that particles
  /// are placed by, too. If not, guards among the particles alone keep it, with far fewer.
  bool leaves_room = true;

  /// Trilinear h at a point (grid mm), clamped to the grid.
  [[nodiscard]] double at(const Vec3& p) const;

  /// The median of h over the local feature size: the epsilon that the field amounts to; 0 without
  /// vertices.
  [[nodiscard]] double median_epsilon() const;
};

}  // namespace cvmesh
