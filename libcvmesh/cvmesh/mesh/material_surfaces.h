// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/core/label.h"
#include "cvmesh/core/vec3.h"
#include "cvmesh/mesh/interface_mesh.h"
#include "cvmesh/mesh/validate.h"

#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Surface_mesh.h>
#include <boost/container/small_vector.hpp>

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <span>
#include <vector>

namespace cvmesh {

using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
using HalfedgeMesh = CGAL::Surface_mesh<Kernel::Point_3>;

/// One closed halfedge mesh per material (the exterior included), edited in lock-step.
///
/// A *vertex* has one global id and one copy in every material mesh it lies on. A *facet* has one
/// global id and two mirrored copies, in the meshes of its inside and its outside material. Every
/// edit is a transaction over all incident meshes, by CGAL's Euler operations only, so conformity
/// and closedness are never lost and never repaired.
///
/// Each facet also carries the *samples* it stands for: dense vertices that were removed and now
/// lie nearest to it. They measure the distance to the dense surface while it is thinned out.
///
/// Points are in grid mm and stored once, outside the halfedge meshes. Edits are not thread-safe.
class MaterialSurfaces {
 public:
  using Face = HalfedgeMesh::Face_index;
  using Halfedge = HalfedgeMesh::Halfedge_index;
  using VertexCopy = HalfedgeMesh::Vertex_index;

  struct Facet {
    std::array<std::int32_t, 3> vertices;  ///< counter-clockwise seen from the outside material
    PatchKey patch;
    Face inside_face, outside_face;  ///< mirrored copies
    std::int32_t first_sample = -1;  ///< head of the list through `next_sample`
    bool is_alive = true;
  };

  /// Where a vertex lies in one material mesh.
  struct Copy {
    MaterialId material;
    VertexCopy vertex;
  };

  /// The facets of one patch around a vertex, in counter-clockwise order seen from outside.
  ///
  /// A disk (closed) has as many ring vertices as facets; facet i spans ring i and i + 1. A
  /// half-disk on a curve runs from one curve neighbour of the vertex to the other and has one ring
  /// vertex more.
  struct Sheet {
    PatchKey patch;
    bool is_disk = true;
    boost::container::small_vector<std::int32_t, 12> ring, facets;
  };

  /// Triangles that replace a sheet, as positions in its ring.
  using Triangulation = boost::container::small_vector<std::array<std::uint8_t, 3>, 12>;

  /// One of the removals of `remove_vertices`.
  struct Removal {
    std::int32_t vertex;
    std::span<const Sheet> sheets;  ///< of `collect_sheets`
    std::span<const Triangulation> triangulations;
    /// Which of all triangles takes over a sample: for the vertex itself, then for each sample of
    /// the sheets' facets, in their order.
    std::span<const std::uint16_t> heirs;
  };

  MaterialSurfaces() = default;

  /// @pre every material's facets in `mesh` form a closed 2-manifold
  /// @throws Error Internal when they do not
  MaterialSurfaces(const InterfaceMesh& mesh, std::size_t material_count);

  [[nodiscard]] std::size_t material_count() const { return meshes_.size(); }

  [[nodiscard]] const HalfedgeMesh& mesh(MaterialId m) const { return meshes_[m]; }

  [[nodiscard]] const std::vector<Vec3>& points() const { return points_; }

  [[nodiscard]] const std::vector<Facet>& facets() const { return facets_; }

  [[nodiscard]] bool is_alive(std::int32_t vertex) const { return !copies_[vertex].empty(); }

  [[nodiscard]] std::size_t vertex_count() const { return vertex_count_; }

  [[nodiscard]] const auto& copies(std::int32_t vertex) const { return copies_[vertex]; }

  /// The sheets around a vertex; false (and nothing useful in `sheets`) for a corner, where other
  /// than none or two curve edges end.
  bool collect_sheets(std::int32_t vertex, std::vector<Sheet>& sheets) const;

  /// Facets around a vertex, each once, in no particular order.
  void collect_star(std::int32_t vertex, std::vector<std::int32_t>& facets) const;

  /// The two facets of an edge inside a patch, or false when (a, b) is no edge or a curve edge.
  /// `first` is the facet in which a precedes b.
  bool facets_of_edge(std::int32_t a,
                      std::int32_t b,
                      std::int32_t& first,
                      std::int32_t& second) const;

  /// The facet of the same patch on the other side of edge (a, b) of `facet`; -1 where (a, b) is a
  /// curve edge or none of its edges. Does not search, as `facets_of_edge` has to.
  [[nodiscard]] std::int32_t facet_across(std::int32_t facet, std::int32_t a, std::int32_t b) const;

  void move_vertex(std::int32_t vertex, const Vec3& position) { points_[vertex] = position; }

  /// Puts a new vertex into a facet (three facets instead of one). @return its id
  std::int32_t split_facet(std::int32_t facet, const Vec3& position);

  /// Puts a new vertex on edge (a, b) of all incident facets. @return its id
  std::int32_t split_edge(std::int32_t a, std::int32_t b, const Vec3& position);

  /// Turns the edge between two facets of one patch to their opposite vertices.
  /// @pre no edge joins those vertices yet
  void flip_edge(std::int32_t a, std::int32_t b);

  /// Removes vertices: each sheet's facets are replaced by its triangulation, whose facets take
  /// over the samples of the sheet and the removed vertex itself as a sample. The triangles of a
  /// sheet get the ids of its first facets. In the order of the removals, the materials in
  /// parallel.
  /// @pre no two of the stars have a facet or a vertex of their rings in common
  /// @pre every diagonal (and for half-disks of more than one facet the closing edge) is new
  /// @param meanwhile  called at the same time; may read points, and the vertices and patches of
  ///                   facets, as they are afterwards
  void remove_vertices(std::span<const Removal> removals, const std::function<void()>& meanwhile);

  /// Lets a facet stand for one more removed vertex.
  void add_sample(std::int32_t facet, const Vec3& position);

  /// Calls `visit(sample position)` for the samples that a facet carries.
  template <typename Visit>
  void for_each_sample(std::int32_t facet, const Visit& visit) const {
    for (auto s = facets_[facet].first_sample; s >= 0; s = next_sample_[s])
      visit(samples_[s]);
  }

  /// All samples, by id.
  [[nodiscard]] const std::vector<Vec3>& samples() const { return samples_; }

  /// Gives back the memory of removed facets and of their copies: most of it once the surfaces are
  /// sparse. Facets get other ids, in the same order; vertices and samples keep theirs.
  void drop_removed();

  /// Which samples a facet carries, by their ids.
  [[nodiscard]] std::vector<std::int32_t> samples_of(std::int32_t facet) const;

  /// Makes a facet carry these samples instead of those it has: for handing the samples of some
  /// facets out anew among them, each to one facet.
  void set_samples(std::int32_t facet, std::span<const std::int32_t> samples);

  /// Flat copy, facets in order of (patch, vertices), vertices in order of their ids.
  /// @param vertex_ids  if given, filled with the id in this object of every point of the copy
  [[nodiscard]] InterfaceMesh to_interface_mesh(
      std::vector<std::int32_t>* vertex_ids = nullptr) const;

  /// Every halfedge mesh valid, closed and without garbage references; every facet mirrored in
  /// exactly the meshes of its two materials, with the same vertices in opposite order.
  [[nodiscard]] Validation validate() const;

 private:
  using VertexIdMap = HalfedgeMesh::Property_map<VertexCopy, std::int32_t>;
  using FaceIdMap = HalfedgeMesh::Property_map<Face, std::int32_t>;

  void build_material(MaterialId m, const std::vector<std::int32_t>& facet_ids);
  std::int32_t add_vertex(const Vec3& position);
  std::int32_t add_facet(const Facet& facet);
  VertexCopy copy_in(std::int32_t vertex, MaterialId m) const;
  Halfedge halfedge_between(MaterialId m, std::int32_t source, std::int32_t target) const;
  void attach(MaterialId m, Halfedge h, const std::vector<std::int32_t>& facets);
  void give_samples(std::int32_t sample, const std::vector<std::int32_t>& facets);
  void give_to_heirs(std::int32_t sample,
                     std::span<const std::uint16_t> heirs,
                     const std::vector<std::int32_t>& facets);
  std::int32_t take_samples(std::span<const std::int32_t> facets);
  void replace_facets(const Removal& removal);
  void remove_copy(MaterialId m, const Removal& removal);
  template <typename Cut>
  static void cut_closing_edge(MaterialId m, const Removal& removal, const Cut& cut);
  static std::vector<std::int32_t> created_by(const Removal& removal);
  static bool is_beside(const Sheet& sheet, MaterialId m);

  std::vector<HalfedgeMesh> meshes_;
  std::vector<VertexIdMap> vertex_id_;  // per material
  std::vector<FaceIdMap> facet_id_;     // per material
  std::vector<Vec3> points_;
  std::vector<boost::container::small_vector<Copy, 2>> copies_;
  std::vector<Facet> facets_;
  std::vector<std::int32_t> free_facets_;
  std::vector<Vec3> samples_;
  std::vector<std::int32_t> next_sample_;
  std::size_t vertex_count_ = 0;
};

}  // namespace cvmesh
