// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/core/vec3.h"
#include "cvmesh/mesh/facet_index.h"
#include "cvmesh/tet/open_tets.h"

#include <array>
#include <cstdint>
#include <optional>
#include <utility>
#include <vector>

namespace cvmesh {

/// Vertices of a surface that are not where they were at first, and the longest way of one.
std::pair<std::size_t, double> shifts_from(const std::vector<Vec3>& home,
                                           const InterfaceMesh& surface);

/// Moves vertices of the surface by a little, where it presses tets flat.
///
/// Between two sheets that nearly touch, and in caps of three facets, tets have all corners on the
/// surface, and nothing that is done inside helps; but the gap is so narrow that a fraction of a
/// voxel makes a sound tet of a flat one. The vertices of poor tets, those of the interior among
/// them, go down the gradient of what the tets around them lack, 1/sine over 1/`enough_sine`,
/// while none of these tets becomes worse than the worst of them is.
///
/// A vertex of the surface stays within `max_shift_mm` of where it was at first, so that no point
/// of the surface moves farther; and it goes no farther than it has to. On the border of the image
/// they move along it. Between tets on both sides the surface cannot intersect. Where it borders on
/// the exterior, the space that its facets sweep must hold no other facet.
class GapOpener {
 public:
  /// Of a move that the rest of the surface bars: none, or a part of it, down to a 32nd. A part
  /// often is enough, as what bars the move is itself as near as the tets are flat.
  enum class Barred { Stays, GoesInPart };

  /// @param tets        is referred to
  /// @param home        where the surface's vertices were at first
  /// @param is_frozen   those of them that stay; the first ones, others do not
  /// @param most_tries  of vertices, those of the poorest tets first
  GapOpener(OpenTets& tets,
            std::vector<Vec3> home,
            const std::vector<bool>& is_frozen,
            double max_shift_mm,
            double enough_sine,
            std::size_t most_tries);

  /// Rounds of moves until none helps, by at most a share of `max_shift_mm`; returns how many moves
  /// there were. A short reach first lets neighbours share what has to be done.
  std::size_t open(double share, Barred barred);

 private:
  using Tet = OpenTets::Tet;
  using Face = OpenTets::Face;

  /// The tets around a vertex on all sides of the surface, the worst first.
  struct Star {
    std::int32_t v;
    std::vector<std::int32_t> tets;
    std::vector<Tet> corners;
    double worst = 0;  ///< sine
    double edge = 0;   ///< mean length
  };

  std::size_t open_once(Barred barred);
  [[nodiscard]] std::vector<Star> stars_of_poor_tets() const;
  void sort(Star& star) const;
  [[nodiscard]] double sine_at(const Star& star, std::size_t tet, const Vec3& p) const;
  [[nodiscard]] double lack(double sine) const;
  /// What the tets around the vertex lack if it is at p; infinite when one falls below `floor`.
  [[nodiscard]] double lack_at(const Star& star, const Vec3& p, double floor) const;
  [[nodiscard]] Vec3 descent(const Star& star, const Vec3& p, double step) const;
  [[nodiscard]] Vec3 within_reach(const Star& star, const Vec3& p) const;
  [[nodiscard]] Vec3 find_place(const Star& star) const;
  /// The first place that is allowed on the way back from p; where the vertex is if there is none.
  Vec3 allowed_place(const Star& star, const Vec3& p, Barred barred);
  [[nodiscard]] bool keeps_shapes(const Star& star, const Vec3& p) const;
  /// False where the outer surface around the vertex could meet itself on the way to p.
  bool is_free(const Star& star, const Vec3& p);
  [[nodiscard]] bool keeps_outer_angles(const Star& star,
                                        const Vec3& p,
                                        const std::vector<Face>& fan) const;
  /// The facets on the exterior around v, each turned to begin with v; none where they are not one
  /// closed fan.
  [[nodiscard]] std::optional<std::vector<Face>> outer_fan(std::int32_t v) const;
  [[nodiscard]] bool is_swept_free(std::int32_t v, const Face& facet);
  void index_outer_facets();
  void move(const Star& star, const Vec3& p);

  OpenTets& tets_;
  const double max_shift_, enough_;
  double reach_ = 0;  ///< of the moves at present
  std::size_t tries_left_;
  std::vector<Vec3> home_;                     ///< of the surface's vertices
  std::vector<std::array<bool, 3>> is_fixed_;  ///< axes across the image's border there
  std::vector<std::uint64_t> tried_;           ///< when a vertex was last tried
  std::vector<Vec3> points_;                   ///< the surface's, and last the place of a trial
  std::optional<FacetIndex> outer_;            ///< facets on the exterior, once one is asked for
};

}  // namespace cvmesh
