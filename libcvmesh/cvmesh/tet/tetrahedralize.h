// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/core/context.h"
#include "cvmesh/mesh/interface_mesh.h"
#include "cvmesh/mesh/mesh_names.h"
#include "cvmesh/mesh/tet_mesh.h"
#include "cvmesh/sizing/sizing_field.h"
#include "cvmesh/tet/improve_tets.h"

#include <string>
#include <vector>

namespace cvmesh {

struct TetrahedralizeOptions {
  double radius_edge_ratio = 1.4;    ///< TetGen's -q; larger is looser
  double min_dihedral_deg = 10;      ///< TetGen's second -q value
  double interior_growth = 0.75;     ///< interior edge length over the sizing field; 0: no bound
  double time_limit_s = 1800;        ///< of one TetGen run; 0: none
  double memory_limit_mb = 0;        ///< of the TetGen process; 0: none
  int improvement_passes = 6;        ///< of `improve_tets` over the result; 0 turns it off
  double max_surface_shift_mm = 0;   ///< of `improve_tets`: flips of surface edges under flat tets
  double max_vertex_shift_mm = 0;    ///< of `improve_tets`: of vertices of the surface
  double min_split_edge_mm = 0;      ///< of `improve_tets`: shorter edges are not split
  double max_splits_per_vertex = 0;  ///< of `improve_tets`: of edges of the surface
  MeshNames names{};                 ///< for messages
};

struct TetrahedralizeStats {
  std::string switches;  ///< those of the run whose result was used
  int attempts = 0;
  int surfaces_tried = 1;  ///< decimations, in orders of their own, until TetGen filled one
  std::vector<std::string> failed_attempts;  ///< "switches: what happened", in order
  std::size_t steiner_points = 0;            ///< points that are not on the input surfaces
  double volume_error = 0;  ///< largest |tets - surface integral| / integral of a material
  ImproveTetsStats improvement;
};

struct TetrahedralizeResult {
  TetMesh tets;
  TetrahedralizeStats stats;
};

/// Tets that fill every material of `surface`. Its points and facets stay as they are, but for the
/// edge flips that `max_surface_shift_mm` allows and the moves that `max_vertex_shift_mm` does.
///
/// The surface is certified first (closed, oriented, free of intersections). TetGen [Si 2015] then
/// fills it in a helper program, adding points in the interior only, by sets of switches from
/// strict to loose, each with three ways to recover the surface's edges; the first result that
/// passes every check of `build_tet_mesh` is taken. After a limit of time or memory the next set
/// follows; a way that left a facet out is tried no more but with another tolerance. Interior edges
/// follow `interior_growth` times the sizing field (no bound where the field is empty). Last,
/// `improve_tets`.
///
/// @throws Error BadParameter for options out of range; StageFailed when the surface is not valid,
///         or no set of switches gives a valid result; Limit for the last attempt's time or memory
///         limit and for a cancel
TetrahedralizeResult tetrahedralize(const InterfaceMesh& surface,
                                    std::size_t material_count,
                                    const SizingField& sizing_field,
                                    const TetrahedralizeOptions& options,
                                    const StageContext& context);

}  // namespace cvmesh
