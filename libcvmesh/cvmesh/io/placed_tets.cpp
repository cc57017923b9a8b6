// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/io/placed_tets.h"

#include "cvmesh/core/error.h"

#include <algorithm>

namespace cvmesh {
namespace {

/// A face of a tet, clockwise seen from outside as the manuals of Abaqus and CalculiX list it.
struct TetFace {
  std::array<std::size_t, 3> corners;  ///< of the tet
  std::array<std::size_t, 3> edges;    ///< of `TetMesh::mid_of`, between those corners
};

constexpr std::array<TetFace, 4> kFaces = {{{{0, 1, 2}, {0, 1, 2}},
                                            {{0, 3, 1}, {3, 4, 0}},
                                            {{1, 3, 2}, {4, 5, 1}},
                                            {{2, 3, 0}, {5, 3, 2}}}};

}  // namespace

std::vector<std::vector<std::size_t>> PlacedTets::tets_by_material(
    std::size_t material_count) const {
  std::vector<std::vector<std::size_t>> tets_of(material_count);
  for (std::size_t tet = 0; tet < mesh.tets.size(); ++tet)
    tets_of[mesh.material_of[tet]].push_back(tet);
  return tets_of;
}

std::vector<ElementFace> PlacedTets::inside_faces() const {
  using Key = std::array<std::int32_t, 3>;
  const InterfaceMesh& surface = mesh.surface;
  std::vector<std::pair<Key, std::size_t>> facets;
  facets.reserve(surface.facets.size());
  for (std::size_t i = 0; i < surface.facets.size(); ++i) {
    facets.emplace_back(surface.facets[i], i);
    std::sort(facets.back().first.begin(), facets.back().first.end());
  }
  std::sort(facets.begin(), facets.end());

  std::vector<ElementFace> faces(surface.facets.size());
  for (std::size_t tet = 0; tet < mesh.tets.size(); ++tet) {
    const std::array<std::int32_t, 4> nodes = corners(tet);
    for (std::size_t face = 0; face < kFaces.size(); ++face) {
      const auto& [a, b, c] = kFaces[face].corners;
      Key key = {nodes[a], nodes[b], nodes[c]};
      std::sort(key.begin(), key.end());
      // The surface's points come first: most faces have another one.
      if (key[2] >= static_cast<std::int32_t>(surface.points.size())) continue;
      const auto facet =
          std::lower_bound(facets.begin(), facets.end(), std::pair(key, std::size_t{0}));
      if (facet == facets.end() || facet->first != key) continue;
      if (surface.patch_of[facet->second].sides.inside == mesh.material_of[tet])
        faces[facet->second] = {static_cast<std::int32_t>(tet), face};
    }
  }
  for (const ElementFace& face : faces)
    require(face.tet >= 0, ErrorCode::Internal, "write", "a facet has no tet on its inside");
  return faces;
}

std::vector<std::vector<ElementFace>> PlacedTets::inside_faces_by_row(
    const InterfaceTable& table) const {
  const std::vector<ElementFace> all = inside_faces();
  std::vector<std::vector<ElementFace>> faces_of(table.patches.size());
  for (std::size_t i = 0; i < all.size(); ++i)
    faces_of[static_cast<std::size_t>(table.index_of[i] - 1)].push_back(all[i]);
  return faces_of;
}

std::vector<std::int32_t> PlacedTets::nodes_of(const ElementFace& face) const {
  const auto tet = static_cast<std::size_t>(face.tet);
  const std::array<std::int32_t, 4> ends = corners(tet);
  const auto& [a, b, c] = kFaces[face.face].corners;
  if (!is_second_order()) return {ends[a], ends[c], ends[b]};
  const std::array<std::int32_t, 6> mids = mid_nodes(tet);
  const auto& [ab, bc, ca] = kFaces[face.face].edges;
  return {ends[a], ends[c], ends[b], mids[ca], mids[bc], mids[ab]};
}

std::vector<std::int32_t> PlacedTets::nodes_of_patch(const PatchKey& patch,
                                                     const std::vector<ElementFace>& faces) const {
  std::vector<std::int32_t> nodes;
  if (patch.wall == 0)
    for (const Contact& contact : mesh.contacts) {
      const bool is_inside = contact.sides == patch.sides;
      const Sides swapped{contact.sides.outside, contact.sides.inside};
      if (!is_inside && swapped != patch.sides) continue;
      for (const std::array<std::int32_t, 2>& pair : contact.pairs)
        nodes.push_back(pair[is_inside ? 0 : 1]);
      return nodes;
    }
  for (const ElementFace& face : faces)
    for (const std::int32_t node : nodes_of(face))
      nodes.push_back(node);
  std::sort(nodes.begin(), nodes.end());
  nodes.erase(std::unique(nodes.begin(), nodes.end()), nodes.end());
  return nodes;
}

}  // namespace cvmesh
