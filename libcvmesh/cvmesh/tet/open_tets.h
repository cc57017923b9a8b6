// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/mesh/tet_mesh.h"
#include "cvmesh/tet/tet_score.h"

#include <algorithm>
#include <array>
#include <cstdint>
#include <utility>
#include <vector>

namespace cvmesh {

/// A tet mesh with neighbours and scores, open to local changes that fill the same space.
///
/// Facets of the surface stay, but for `hand_over`: a facet, and the
/// outside, is no neighbour, so that what lies beyond never takes part in a change. Everything done
/// since `begin_trial` can be taken back.
class OpenTets {
 public:
  using Tet = std::array<std::int32_t, 4>;
  using Face = std::array<std::int32_t, 3>;
  static constexpr std::int32_t kNone = -1;

  /// The edges, each with the other two corners such that (edge, rest) is an even permutation.
  static constexpr std::size_t kEdges[6][4] = {{0, 1, 2, 3}, {0, 2, 3, 1}, {0, 3, 1, 2},
                                               {1, 2, 0, 3}, {1, 3, 2, 0}, {2, 3, 0, 1}};

  /// The tets that share an edge of the interior, as their ring of opposite corners.
  struct Ring {
    std::int32_t a = kNone, b = kNone;
    std::vector<std::int32_t> corners;  ///< counter-clockwise around a -> b
    std::vector<std::int32_t> tets;     ///< tet k has corners k and k + 1
  };

  explicit OpenTets(TetMesh& mesh);

  /// Writes the mesh back without the gaps that removed tets and vertices left. Nothing may be
  /// changed afterwards.
  void close();

  /// Slots of tets, those of removed ones included.
  [[nodiscard]] std::size_t slot_count() const { return tets_.size(); }

  [[nodiscard]] std::size_t point_count() const { return mesh_.points.size(); }

  [[nodiscard]] bool is_removed(std::int32_t t) const { return tet(t)[0] == kNone; }

  [[nodiscard]] MaterialId material(std::int32_t t) const {
    return materials_[static_cast<std::size_t>(t)];
  }

  [[nodiscard]] bool is_on_surface(std::int32_t v) const {
    return static_cast<std::size_t>(v) < mesh_.surface.points.size();
  }

  [[nodiscard]] const Tet& tet(std::int32_t t) const { return tets_[static_cast<std::size_t>(t)]; }

  /// Beyond face k; kNone at the surface.
  [[nodiscard]] std::int32_t neighbour(std::int32_t t, std::size_t k) const {
    return neighbours_[static_cast<std::size_t>(t)][k];
  }

  [[nodiscard]] const TetScore& score(std::int32_t t) const {
    return scores_[static_cast<std::size_t>(t)];
  }

  [[nodiscard]] const Vec3& point(std::int32_t v) const {
    return mesh_.points[static_cast<std::size_t>(v)];
  }

  [[nodiscard]] const InterfaceMesh& surface() const { return mesh_.surface; }

  /// Looks up the facets around each vertex of the surface, once.
  void find_facets_at_points();

  /// After `find_facets_at_points`; in no special order.
  [[nodiscard]] const std::vector<std::int32_t>& facets_at(std::int32_t v) const {
    return facets_of_[static_cast<std::size_t>(v)];
  }

  /// The score that a tet would have, as `score_tet` gives it.
  [[nodiscard]] TetScore score_of(const Tet& t, double floor = -1) const {
    return score_tet(point(t[0]), point(t[1]), point(t[2]), point(t[3]), floor);
  }

  /// The tets around a vertex, on one side of the surface for one that lies on it.
  void find_star(std::int32_t v, std::vector<std::int32_t>& star) const;

  /// The tets around edge e of tet t; false when the edge lies on the surface or has more tets
  /// than `most`.
  bool find_ring(std::int32_t t, std::size_t e, std::size_t most, Ring& ring) const {
    return find_ring(t, e, most, ring, [](std::int32_t) { return true; });
  }

  /// The same; also false at the first tet, t apart, that `accept` refuses.
  template <typename Accept>
  bool find_ring(
      std::int32_t t, std::size_t e, std::size_t most, Ring& ring, const Accept& accept) const;

  /// Puts tets in the place of others that fill the same space, all of one material.
  void replace(const std::vector<std::int32_t>& removed, const std::vector<Tet>& added);

  /// Looks up which tets lie at which facets, for `hand_over` until other changes are made there.
  void find_tets_at_facets();

  /// Flips a surface edge: tet t fills the corner between the two facets at its edge e, and goes
  /// over to the material beyond them (it goes altogether where that is the exterior). Its other
  /// two faces become the facets, of the same patch. Between filled tets on both sides the flip
  /// cannot make the surface intersect.
  /// @return false, with nothing changed, where there are no such two facets, they lie on the
  ///         border of the image or on a curve, or the flipped edge exists already
  bool hand_over(std::int32_t t, std::size_t e);

  std::int32_t add_point(const Vec3& position);

  /// Moves a vertex, and the surface with it where it lies there; `star` holds all tets around it,
  /// on all sides of the surface.
  void move_point(std::int32_t v, const Vec3& position, const std::vector<std::int32_t>& star);

  /// Time of the last change at a vertex, and the time now: one tick per change.
  [[nodiscard]] std::uint64_t changed_at(std::int32_t v) const {
    return changed_at_[static_cast<std::size_t>(v)];
  }

  [[nodiscard]] std::uint64_t now() const { return clock_; }

  /// All changes from here on can be taken back together.
  void begin_trial();
  void keep_trial();
  void undo_trial();

  /// What the trial has touched, before it and now.
  struct Poorness {
    double worst = 0;  ///< smallest sine
    double sum = 0;    ///< of the squares of what each tet's sine lacks to `enough`
  };

  [[nodiscard]] std::pair<Poorness, Poorness> compare_trial(double enough);

 private:
  struct SlotBefore {
    std::int32_t t;
    Tet tet;
    MaterialId material;
    std::array<std::int32_t, 4> neighbours;
    TetScore score;
  };

  struct FacetBefore {
    std::int32_t facet;
    Face corners;
  };

  struct FaceOfTet {
    Face face;  ///< sorted
    std::int32_t tet;
    std::size_t place;
  };

  struct PointBefore {
    std::int32_t v;
    Vec3 position;
  };

  struct HintBefore {
    std::int32_t v, t;
  };

  struct ChangeBefore {
    std::int32_t v;
    std::uint64_t time;
  };

  void connect();
  void set_position(std::int32_t v, const Vec3& position);
  void mark_changed(std::int32_t v);
  void remember_slot(std::int32_t t);
  void set_hint(std::int32_t v, std::int32_t t);
  std::int32_t new_slot(MaterialId material);
  void compact_points();
  [[nodiscard]] std::int32_t find_facet(const Face& face) const;
  [[nodiscard]] int count_facets_at(std::int32_t v, std::int32_t w) const;
  void set_facet(std::int32_t facet, const Face& corners);
  [[nodiscard]] const FaceOfTet* find_beyond(const Face& face, std::int32_t t) const;

  TetMesh& mesh_;
  std::vector<Tet> tets_;
  std::vector<MaterialId> materials_;
  std::vector<std::array<std::int32_t, 4>> neighbours_;
  std::vector<TetScore> scores_;
  std::vector<std::vector<std::int32_t>> facets_of_;  ///< of each surface vertex
  std::vector<FaceOfTet> faces_at_facets_;            ///< sorted; may be out of date
  std::vector<std::int32_t> tet_of_;                  ///< one tet of each vertex
  std::vector<std::int32_t> free_;
  std::uint64_t clock_ = 1;
  std::vector<std::uint64_t> changed_at_;
  std::vector<std::uint32_t> stamps_;
  std::uint32_t stamp_ = 0;

  bool is_trial_ = false;
  std::vector<SlotBefore> slots_before_;
  std::vector<PointBefore> points_before_;
  std::vector<FacetBefore> facets_before_;
  std::vector<HintBefore> hints_before_;
  std::vector<ChangeBefore> changes_before_;
  std::vector<std::int32_t> freed_in_trial_, taken_in_trial_;
  std::size_t points_at_trial_ = 0;
};

template <typename Accept>
bool OpenTets::find_ring(
    std::int32_t t, std::size_t e, std::size_t most, Ring& ring, const Accept& accept) const {
  const Tet& first = tet(t);
  ring.a = first[kEdges[e][0]];
  ring.b = first[kEdges[e][1]];
  std::int32_t behind = first[kEdges[e][2]], ahead = first[kEdges[e][3]];
  ring.corners.assign(1, behind);
  ring.tets.assign(1, t);
  for (std::int32_t now = t;;) {
    const Tet& corners = tet(now);
    const auto opposite = static_cast<std::size_t>(
        std::find(corners.begin(), corners.end(), behind) - corners.begin());
    const std::int32_t next = neighbour(now, opposite);
    if (next == kNone) return false;
    if (next == t) break;
    if (!accept(next)) return false;
    ring.corners.push_back(ahead);
    ring.tets.push_back(next);
    if (ring.tets.size() > most) return false;
    behind = ahead;
    for (const std::int32_t v : tet(next))
      if (v != ring.a && v != ring.b && v != behind) ahead = v;
    now = next;
  }
  return ring.tets.size() >= 3;
}

}  // namespace cvmesh
