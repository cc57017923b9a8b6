// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/tet/open_tets.h"
#include "cvmesh/tet/star_scores.h"
#include "cvmesh/tet/tet_goal.h"

#include <cstdint>
#include <vector>

namespace cvmesh {

/// Finds better places for vertices of the interior.
class MoveFinder {
 public:
  /// The tets around a vertex, their corners and faces, so that the search need not look them up.
  struct Star {
    std::vector<std::int32_t> tets;  ///< the worst first
    std::vector<OpenTets::Tet> corners;
    StarScores scores;   ///< in the same order
    TetQuality quality;  ///< as it is now
  };

  struct Move {
    bool is_found = false;
    Vec3 position;
  };

  /// @param tets  is referred to, never changed
  MoveFinder(const OpenTets& tets, const TetGoal& goal) : tets_(tets), goal_(goal) {}

  void gather(std::int32_t v, Star& star) const;

  /// Pattern search for the best place of v: towards the centroid of the star, away from the worst
  /// tet's opposite face, and along the axes, with steps that halve `halvings` times.
  /// @param star  that of v afterwards
  Move find_move(std::int32_t v, int halvings, Star& star) const;

 private:
  const OpenTets& tets_;
  TetGoal goal_;
};

}  // namespace cvmesh
