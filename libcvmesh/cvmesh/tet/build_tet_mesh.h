// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/core/context.h"
#include "cvmesh/mesh/interface_mesh.h"
#include "cvmesh/mesh/mesh_names.h"
#include "cvmesh/mesh/tet_mesh.h"
#include "cvmesh/tet/tetgen_protocol.h"

#include <cstddef>
#include <string>

namespace cvmesh {

struct BuildTetMeshResult {
  TetMesh mesh;
  double volume_error = 0;        ///< largest |tets - surface integral| / integral of a material
  std::string fault;              ///< what is wrong with the reply; empty: nothing, `mesh` is good
  bool leaves_facet_out = false;  ///< what is wrong: a facet of the surface is no face of a tet
};

/// The checked mesh of what TetGen returned for `surface`: the surface's points bit-identical and
/// first, every facet a face of a tet, all tets positive, each connected part bounded by sides of
/// one material, which it gets, volumes equal to the surface integrals. Parts in the exterior are
/// dropped; tets that are flat to double precision go by flips.
///
/// @throws Error Limit when `context.cancel` is set
BuildTetMeshResult build_tet_mesh(tetgen_protocol::Reply reply,
                                  const InterfaceMesh& surface,
                                  std::size_t material_count,
                                  const MeshNames& names,
                                  const StageContext& context);

}  // namespace cvmesh
