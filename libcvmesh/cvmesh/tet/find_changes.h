// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/tet/open_tets.h"
#include "cvmesh/tet/tet_goal.h"

#include <cstddef>
#include <cstdint>
#include <vector>

namespace cvmesh {

/// Replacement of some tets by others that fill the same space.
struct TetChange {
  enum class Kind { None, EdgeRemoval, FaceFlip, Contraction } kind = Kind::None;
  TetQuality quality;
  double gain = 0;  ///< of the worst sine, then of the mean
  std::vector<std::int32_t> removed;
  std::vector<OpenTets::Tet> added;
};

/// Finds changes of the tets' connections that serve the goal: edges that go, their rings
/// triangulated anew in the best way (3-2 and 4-4 flips and their general form); faces that go by
/// the 2-3 flip; interior vertices that go into a neighbour.
class ChangeFinder {
 public:
  /// Most tets around an edge that is removed: larger rings hardly ever gain.
  static constexpr std::size_t kMaxRing = 9;

  /// @param tets  is referred to, never changed
  ChangeFinder(const OpenTets& tets, const TetGoal& goal) : tets_(tets), goal_(goal) {}

  /// `best`, or the removal of the ring's edge where that is better.
  void try_edge_removal(const OpenTets::Ring& ring, TetChange& best) const;

  /// The best change that tet t takes part in; of kind None where nothing is better than it is.
  [[nodiscard]] TetChange best_change(std::int32_t t);

 private:
  void try_face_flip(std::int32_t t, std::size_t k, TetChange& best) const;
  void try_contractions(std::int32_t v, const OpenTets::Tet& t, TetChange& best);
  void try_contraction(std::int32_t v,
                       std::int32_t u,
                       const TetQuality& before,
                       double floor,
                       TetChange& best) const;
  void offer(TetChange&& change, const TetQuality& before, TetChange& best) const;

  const OpenTets& tets_;
  TetGoal goal_;
  std::vector<std::int32_t> star_;  // room for the search
  OpenTets::Ring ring_;
};

}  // namespace cvmesh
