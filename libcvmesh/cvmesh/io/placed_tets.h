// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/io/output_tables.h"
#include "cvmesh/mesh/tet_mesh.h"

#include <array>
#include <cstdint>
#include <vector>

// What the writers of finite elements have in common. Private to io.
namespace cvmesh {

/// One face of an element, 0-based, as Abaqus and CalculiX number them (S1 to S4).
struct ElementFace {
  std::int32_t tet = -1;
  std::size_t face = 0;
};

/// A tet mesh as files have it: under a map, every tet positive, mid nodes numbered after all
/// others.
struct PlacedTets {
  const TetMesh& mesh;
  Placement place;

  [[nodiscard]] bool is_second_order() const { return !mesh.mid_of.empty(); }

  [[nodiscard]] std::size_t node_count() const {
    return mesh.points.size() + mesh.mid_points.size();
  }

  [[nodiscard]] Vec3 node(std::size_t index) const {
    const std::size_t corners = mesh.points.size();
    return place(index < corners ? mesh.points[index] : mesh.mid_points[index - corners]);
  }

  [[nodiscard]] std::array<std::int32_t, 4> corners(std::size_t tet) const {
    return place(mesh.tets[tet]);
  }

  /// Of a mesh of second order: the nodes on the edges, in the order of `TetMesh::mid_of`.
  [[nodiscard]] std::array<std::int32_t, 6> mid_nodes(std::size_t tet) const {
    std::array<std::int32_t, 6> nodes = place(mesh.mid_of[tet]);
    for (std::int32_t& node : nodes)
      node += static_cast<std::int32_t>(mesh.points.size());
    return nodes;
  }

  /// Tets of each material id, ascending.
  [[nodiscard]] std::vector<std::vector<std::size_t>> tets_by_material(
      std::size_t material_count) const;

  /// Per facet of the surface, the face on its inside.
  [[nodiscard]] std::vector<ElementFace> inside_faces() const;

  /// The same by row of the interface table.
  [[nodiscard]] std::vector<std::vector<ElementFace>> inside_faces_by_row(
      const InterfaceTable& table) const;

  /// Nodes of one face, counter-clockwise seen from outside the tet: three corners, then in a mesh
  /// of second order the nodes on the edges between first and second, second and third, third and
  /// first.
  [[nodiscard]] std::vector<std::int32_t> nodes_of(const ElementFace& face) const;

  /// Nodes on the faces of one patch: ascending; on the two sides of a contact in the order of its
  /// node pairs, so that equal places in both lists are one pair.
  [[nodiscard]] std::vector<std::int32_t> nodes_of_patch(
      const PatchKey& patch, const std::vector<ElementFace>& faces) const;
};

}  // namespace cvmesh
