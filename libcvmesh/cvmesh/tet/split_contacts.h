// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/mesh/tet_mesh.h"

#include <cstddef>
#include <vector>

namespace cvmesh {

struct SplitContactsStats {
  std::size_t facets_cut = 0;
  std::size_t nodes_added = 0;  ///< copies, those on edges of a mesh of second order among them
  std::size_t node_pairs = 0;   ///< of two different nodes
};

/// Cuts the mesh open along whole interfaces, so that their two sides can slide and gap.
///
/// Around each node of such an interface, tets stay together that share a facet which is not cut;
/// every other group of them gets a copy of the node in the same place. So a node on the rim of an
/// interface, around which a third material holds both sides together, stays one node, while a
/// curve where three interfaces are cut has three. Nodes on edges are split in the same way. The
/// group of the tet that comes first keeps the node.
///
/// Copies of the surface's points follow them, so points inside move up; copies of mid nodes come
/// last. Each cut facet keeps the nodes of its inner material and appears a second time, after all
/// others, with its sides swapped and the nodes of its outer material. Tets, volumes and the shape
/// of the surface do not change, but the surface is no longer closed by shared nodes.
///
/// @param contacts  interfaces of two materials, neither of them the exterior
/// @note  O(tets log tets)
SplitContactsStats split_contacts(TetMesh& mesh, const std::vector<Sides>& contacts);

}  // namespace cvmesh
