// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/tet/split_contacts.h"

#include "cvmesh/core/disjoint_sets.h"
#include "cvmesh/core/error.h"
#include "cvmesh/core/parallel.h"
#include "cvmesh/mesh/tet_faces.h"

#include <algorithm>
#include <array>
#include <cstdint>
#include <numeric>

namespace cvmesh {
namespace {

constexpr const char* kStage = "contacts";
/// Local nodes of a tet: four corners, then six on its edges in the order of `TetMesh::mid_of`.
constexpr std::size_t kLocals = 10;
/// Local nodes of a face: corners, then the edges 01, 12, 20 of those. Face n lacks corner n.
constexpr std::array<std::array<std::size_t, 6>, 4> kFaceNodes = {
    {{1, 2, 3, 5, 9, 8}, {0, 2, 3, 6, 9, 7}, {0, 1, 3, 4, 8, 7}, {0, 1, 2, 4, 5, 6}}};

using Triple = std::array<std::int32_t, 3>;

/// A face of a tet, to be found by its corners.
struct Face {
  Triple corners;  ///< ascending
  std::int32_t tet = 0;
  std::uint8_t face = 0;
  friend auto operator<=>(const Face&, const Face&) = default;
};

class ContactSplitter {
 public:
  ContactSplitter(TetMesh& mesh, const std::vector<Sides>& contacts)
      : mesh_(mesh), contacts_(contacts), corner_count_(mesh.points.size()) {
    std::sort(contacts_.begin(), contacts_.end());
    contacts_.erase(std::unique(contacts_.begin(), contacts_.end()), contacts_.end());
  }

  SplitContactsStats run();

 private:
  [[nodiscard]] bool is_second_order() const { return !mesh_.mid_of.empty(); }

  [[nodiscard]] std::size_t locals() const { return is_second_order() ? kLocals : 4; }

  /// Old number of a local node; mid nodes after all corners.
  [[nodiscard]] std::int32_t node(std::size_t tet, std::size_t local) const {
    if (local < 4) return mesh_.tets[tet][local];
    return static_cast<std::int32_t>(corner_count_) + mesh_.mid_of[tet][local - 4];
  }

  [[nodiscard]] std::uint32_t wedge(std::size_t tet, std::size_t local) const {
    return static_cast<std::uint32_t>(tet * locals() + local);
  }

  [[nodiscard]] bool is_contact(const PatchKey& patch) const {
    return patch.wall == 0 && std::binary_search(contacts_.begin(), contacts_.end(), patch.sides);
  }

  void sort_faces();
  /// The face of a facet on the side of a material.
  [[nodiscard]] const Face& face_on(const Triple& facet, MaterialId material) const;
  void mark_cut();
  DisjointSets group_wedges();
  void number_copies(DisjointSets& groups);
  void move_points();
  void rewrite_tets();
  void split_surface();

  TetMesh& mesh_;
  std::vector<Sides> contacts_;
  std::size_t corner_count_;
  std::vector<Face> faces_;                ///< of all tets, ascending
  std::vector<Triple> cut_;                ///< corners of the cut facets, ascending each and all
  std::vector<bool> is_on_cut_;            ///< per old node
  std::vector<std::int32_t> node_of_;      ///< per wedge: the new number of its node
  std::vector<std::int32_t> copied_from_;  ///< per copy, in the order of copies: the old number
  std::size_t corner_copies_ = 0;          ///< the first of them are corners
  SplitContactsStats stats_;
};

void ContactSplitter::sort_faces() {
  faces_.resize(4 * mesh_.tets.size());
  parallel_for_each_index(0, mesh_.tets.size(), [&](std::size_t tet) {
    for (std::size_t f = 0; f < 4; ++f) {
      const auto& locals = kFaceNodes[f];
      faces_[4 * tet + f] = {
          sorted({node(tet, locals[0]), node(tet, locals[1]), node(tet, locals[2])}),
          static_cast<std::int32_t>(tet), static_cast<std::uint8_t>(f)};
    }
  });
  parallel_sort(faces_.begin(), faces_.end());
}

const Face& ContactSplitter::face_on(const Triple& facet, MaterialId material) const {
  const Triple corners = sorted(facet);
  auto face = std::lower_bound(faces_.begin(), faces_.end(), Face{corners, 0, 0});
  for (; face != faces_.end() && face->corners == corners; ++face)
    if (mesh_.material_of[face->tet] == material) return *face;
  throw Error(ErrorCode::Internal, kStage, "a facet has no tet on one of its sides");
}

void ContactSplitter::mark_cut() {
  is_on_cut_.assign(corner_count_ + mesh_.mid_points.size(), false);
  const InterfaceMesh& surface = mesh_.surface;
  for (std::size_t i = 0; i < surface.facets.size(); ++i) {
    if (!is_contact(surface.patch_of[i])) continue;
    cut_.push_back(sorted(surface.facets[i]));
    const Face& face = face_on(surface.facets[i], surface.patch_of[i].sides.inside);
    for (const std::size_t local : kFaceNodes[face.face])
      if (local < locals()) is_on_cut_[node(static_cast<std::size_t>(face.tet), local)] = true;
  }
  std::sort(cut_.begin(), cut_.end());
  stats_.facets_cut = cut_.size();
}

/// Wedges (a tet at one of its nodes) that stay together.
DisjointSets ContactSplitter::group_wedges() {
  DisjointSets groups(mesh_.tets.size() * locals());
  const auto local_of = [&](std::size_t tet, std::int32_t wanted) {
    std::size_t local = 0;
    while (node(tet, local) != wanted)
      ++local;
    return local;
  };
  for (std::size_t i = 0; i + 1 < faces_.size(); ++i) {
    const Face &a = faces_[i], &b = faces_[i + 1];
    if (a.corners != b.corners) continue;
    if (std::binary_search(cut_.begin(), cut_.end(), a.corners)) continue;
    for (const std::size_t local : kFaceNodes[a.face]) {
      if (local >= locals()) continue;
      const std::int32_t shared = node(static_cast<std::size_t>(a.tet), local);
      if (!is_on_cut_[shared]) continue;
      groups.join(wedge(static_cast<std::size_t>(a.tet), local),
                  wedge(static_cast<std::size_t>(b.tet),
                        local_of(static_cast<std::size_t>(b.tet), shared)));
    }
  }
  return groups;
}

/// New numbers of all wedges' nodes. Corners on a cut are points of the surface, so their copies
/// follow these.
void ContactSplitter::number_copies(DisjointSets& groups) {
  constexpr std::int32_t kNone = -1;
  const std::size_t wedges = mesh_.tets.size() * locals();
  std::vector<std::int32_t> copy_of_group(wedges, kNone);  // index into copies, of its first wedge
  std::vector<std::int64_t> keeper(is_on_cut_.size(), kNone);  // the group that keeps the node
  std::vector<std::int32_t> corners, mids;                     // old numbers of what is copied
  for (std::size_t tet = 0; tet < mesh_.tets.size(); ++tet)
    for (std::size_t local = 0; local < locals(); ++local) {
      const std::int32_t old = node(tet, local);
      if (!is_on_cut_[old]) continue;
      const std::uint32_t group = groups.find(wedge(tet, local));
      if (keeper[old] == kNone) keeper[old] = group;
      if (keeper[old] == group || copy_of_group[group] != kNone) continue;
      std::vector<std::int32_t>& copies = local < 4 ? corners : mids;
      copy_of_group[group] = static_cast<std::int32_t>(copies.size());
      copies.push_back(old);
    }
  corner_copies_ = corners.size();
  const auto surface_points = static_cast<std::int32_t>(mesh_.surface.points.size());
  const auto shift = static_cast<std::int32_t>(corners.size());
  const auto all_old = static_cast<std::int32_t>(is_on_cut_.size());
  node_of_.resize(wedges);
  for (std::size_t tet = 0; tet < mesh_.tets.size(); ++tet)
    for (std::size_t local = 0; local < locals(); ++local) {
      const std::int32_t old = node(tet, local);
      std::int32_t number = old < surface_points ? old : old + shift;
      if (is_on_cut_[old]) {
        const std::int32_t copy = copy_of_group[groups.find(wedge(tet, local))];
        if (copy != kNone) number = copy + (local < 4 ? surface_points : all_old + shift);
      }
      node_of_[wedge(tet, local)] = number;
    }
  copied_from_ = std::move(corners);
  copied_from_.insert(copied_from_.end(), mids.begin(), mids.end());
  stats_.nodes_added = copied_from_.size();
}

void ContactSplitter::move_points() {
  std::vector<Vec3> copies;
  for (std::size_t i = 0; i < corner_copies_; ++i)
    copies.push_back(mesh_.points[copied_from_[i]]);
  const std::size_t surface_points = mesh_.surface.points.size();
  mesh_.points.insert(mesh_.points.begin() + static_cast<std::ptrdiff_t>(surface_points),
                      copies.begin(), copies.end());
  mesh_.surface.points.insert(mesh_.surface.points.end(), copies.begin(), copies.end());
  for (std::size_t i = corner_copies_; i < copied_from_.size(); ++i) {
    const Vec3 copied = mesh_.mid_points[static_cast<std::size_t>(copied_from_[i]) - corner_count_];
    mesh_.mid_points.push_back(copied);
  }
  const auto shifted = [&](std::int32_t old) {
    return static_cast<std::size_t>(old) < surface_points
               ? old
               : old + static_cast<std::int32_t>(corner_copies_);
  };
  mesh_.original_of.resize(mesh_.points.size() + mesh_.mid_points.size());
  std::iota(mesh_.original_of.begin(), mesh_.original_of.end(), 0);
  for (std::size_t i = 0; i < copied_from_.size(); ++i) {
    const std::size_t number = i < corner_copies_
                                   ? surface_points + i
                                   : mesh_.original_of.size() - copied_from_.size() + i;
    mesh_.original_of[number] = shifted(copied_from_[i]);
  }
}

void ContactSplitter::rewrite_tets() {
  const auto corners = static_cast<std::int32_t>(mesh_.points.size());
  for (std::size_t tet = 0; tet < mesh_.tets.size(); ++tet) {
    for (std::size_t local = 0; local < 4; ++local)
      mesh_.tets[tet][local] = node_of_[wedge(tet, local)];
    for (std::size_t local = 4; local < locals(); ++local)
      mesh_.mid_of[tet][local - 4] = node_of_[wedge(tet, local)] - corners;
  }
}

/// Facets get the nodes of their inside; those that are cut appear a second time.
void ContactSplitter::split_surface() {
  InterfaceMesh& surface = mesh_.surface;
  const InterfaceMesh old = surface;
  for (const Sides& sides : contacts_)
    mesh_.contacts.push_back({sides, {}});
  // What the corner `wanted` of a face is called now.
  const auto renamed = [&](const Face& face, std::int32_t wanted) {
    const auto& corners = mesh_.tets[face.tet];
    const auto local = std::find(corners.begin(), corners.end(), wanted) - corners.begin();
    return node_of_[wedge(static_cast<std::size_t>(face.tet), static_cast<std::size_t>(local))];
  };
  for (std::size_t i = 0; i < old.facets.size(); ++i) {
    const PatchKey& patch = old.patch_of[i];
    const Face& inner = face_on(old.facets[i], patch.sides.inside);
    for (std::int32_t& v : surface.facets[i])
      v = renamed(inner, v);
    if (!is_contact(patch)) continue;
    const Face& outer = face_on(old.facets[i], patch.sides.outside);
    Triple facet = old.facets[i];
    std::swap(facet[1], facet[2]);
    for (std::int32_t& v : facet)
      v = renamed(outer, v);
    surface.facets.push_back(facet);
    surface.patch_of.push_back({{patch.sides.outside, patch.sides.inside}, 0});
    const auto contact = std::lower_bound(contacts_.begin(), contacts_.end(), patch.sides);
    auto& pairs = mesh_.contacts[static_cast<std::size_t>(contact - contacts_.begin())].pairs;
    for (const std::size_t local : kFaceNodes[inner.face]) {
      if (local >= locals()) continue;
      const std::int32_t shared = node(static_cast<std::size_t>(inner.tet), local);
      std::size_t other = 0;
      while (node(static_cast<std::size_t>(outer.tet), other) != shared)
        ++other;
      pairs.push_back({node_of_[wedge(static_cast<std::size_t>(inner.tet), local)],
                       node_of_[wedge(static_cast<std::size_t>(outer.tet), other)]});
    }
  }
  for (Contact& contact : mesh_.contacts) {
    std::sort(contact.pairs.begin(), contact.pairs.end());
    contact.pairs.erase(std::unique(contact.pairs.begin(), contact.pairs.end()),
                        contact.pairs.end());
    for (const auto& [inner, outer] : contact.pairs)
      stats_.node_pairs += inner != outer ? 1 : 0;
  }
  std::erase_if(mesh_.contacts, [](const Contact& contact) { return contact.pairs.empty(); });
}

SplitContactsStats ContactSplitter::run() {
  sort_faces();
  mark_cut();
  if (cut_.empty()) return stats_;
  DisjointSets groups = group_wedges();
  number_copies(groups);
  split_surface();
  move_points();
  rewrite_tets();
  return stats_;
}

}  // namespace

SplitContactsStats split_contacts(TetMesh& mesh, const std::vector<Sides>& contacts) {
  require(mesh.tets.size() <= UINT32_MAX / kLocals, ErrorCode::Limit, kStage,
          std::to_string(mesh.tets.size()) +
              " tets are more than contacts can be cut in; make "
              "the mesh coarser");
  return ContactSplitter(mesh, contacts).run();
}

}  // namespace cvmesh
