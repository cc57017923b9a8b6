// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/grid/grid_frame.h"
#include "cvmesh/mesh/tet_mesh.h"
#include "cvmesh/metrics/facet_distances.h"
#include "cvmesh/report/report.h"

#include <cstddef>
#include <string>

namespace cvmesh {

/// With more tets the page draws the surface only: a browser would take many seconds and gigabytes
/// to match the faces of more.
inline constexpr std::size_t kMostTetsInView = 2'000'000;

/// The report of a finished run as one HTML page that needs nothing else: NAME.report.html.
///
/// The page holds the figures of `report_json`, histograms, and the mesh, which it draws in 3-D
/// with a cut plane. It asks no network for anything, and its content policy forbids it to. Texts
/// of the user (file and label names, warnings) are data in it, never markup. Without WebGL it
/// shows all but the view.
///
/// Points are stored in 16 bits an axis, enough to draw them; figures come from the exact mesh.
/// About 16 bytes a tet, plus 1 MB of scripts.
///
/// @param mesh       in grid mm; without tets, or with more than `most_tets`, the page draws the
///                   surface
/// @param distances  of the facets of `mesh.surface` to the dense surface
/// @param mm_to_out  from grid mm to the space of the written files
std::string html_report(const Report& report,
                        const TetMesh& mesh,
                        const FacetDistances& distances,
                        const Affine& mm_to_out,
                        std::size_t most_tets = kMostTetsInView);

}  // namespace cvmesh
