// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/core/context.h"
#include "cvmesh/tet/find_changes.h"
#include "cvmesh/tet/find_moves.h"
#include "cvmesh/tet/improve_tets.h"
#include "cvmesh/tet/open_gaps.h"
#include "cvmesh/tet/open_tets.h"
#include "cvmesh/tet/tet_goal.h"

#include <cstddef>
#include <cstdint>
#include <vector>

namespace cvmesh {

/// The rounds that `improve_tets` is made of, each on the mesh as the one before left it. They
/// count what they do in the stats given to them, and throw Error Limit when cancelled.
///
/// What was tried in vain is tried again only after something around it changed.
class TetImprover {
 public:
  /// @param mesh     is changed by `close` only
  /// @param context  is referred to
  TetImprover(TetMesh& mesh, const ImproveTetsOptions& options, const StageContext& context);
  // The finders refer to the tets of this one.
  TetImprover(const TetImprover&) = delete;
  TetImprover& operator=(const TetImprover&) = delete;

  [[nodiscard]] DihedralAngles measure() const { return measure_dihedral_angles(tets_); }

  [[nodiscard]] std::size_t slot_count() const { return tets_.slot_count(); }

  /// Writes the mesh back; the last call.
  void close() { tets_.close(); }

  /// Leaves alone what has none of these vertices, until something there changes, and tries new
  /// vertices in at most so many tets. To be called before the first round.
  void look_only_at(const std::vector<std::int32_t>& vertices, std::size_t most_insertion_tries);

  /// One round of changes for tets with a poor angle, worst first.
  void mend(ImproveTetsStats& stats);

  /// One round of edge removals anywhere, for the mean. Proposals are made in parallel, on the mesh
  /// as it is, and carried out in order where nothing has changed meanwhile: the result does not
  /// depend on the number of threads.
  void flip(ImproveTetsStats& stats);

  /// One round of moves over the vertices: searches in parallel, on the mesh as it is; then each
  /// is carried out in order if it still helps. Returns how many.
  std::size_t smooth();

  /// One round of flips of surface edges whose two facets, nearly in one plane, bound a flat tet:
  /// the tet goes over to the other side, where it must vanish in an edge removal.
  /// @param is_frozen  vertices of the surface that stay out of it; the first ones, others do not
  void shed(double max_shift, const std::vector<bool>& is_frozen, ImproveTetsStats& stats);

  /// One round of new vertices in tets that neither flips nor moves could help, worst first.
  void insert(ImproveTetsStats& stats) { insert(insert_below_, stats); }

  /// Moves vertices of the surface where it presses tets flat, with flips for what they allow.
  /// @param home       where these vertices were at first
  /// @param is_frozen  those that stay; the first ones, others do not
  /// @param max_shift  mm, how far from `home` they may get; 0: none moves
  /// @param barred     what becomes of moves that the rest of the surface bars
  void open_gaps(const std::vector<Vec3>& home,
                 const std::vector<bool>& is_frozen,
                 double max_shift,
                 GapOpener::Barred barred,
                 ImproveTetsStats& stats);

 private:
  using Tet = OpenTets::Tet;

  struct Failures {
    Tet tet{OpenTets::kNone, OpenTets::kNone, OpenTets::kNone, OpenTets::kNone};
    int count = 0;
  };

  [[nodiscard]] std::size_t share_of_vertices(double share) const;
  void leave_if_cancelled(std::size_t step) const;
  [[nodiscard]] std::vector<std::int32_t> poor_tets(double below) const;
  bool is_open(std::int32_t t, double below, std::vector<std::uint64_t>& tried);
  [[nodiscard]] bool has_changed_since(std::int32_t t, std::uint64_t time) const;
  void apply(const TetChange& change, ImproveTetsStats& stats);
  void insert(double below, ImproveTetsStats& stats);
  [[nodiscard]] bool wants_move(std::int32_t v) const;
  bool move_vertex(std::int32_t v, int halvings);
  std::size_t flip_once(ImproveTetsStats& stats);
  void propose_removals(std::int32_t t,
                        std::uint64_t since,
                        std::vector<TetChange>& proposals) const;
  bool shed_at(std::int32_t t, std::size_t e, double max_shift, ImproveTetsStats& stats);
  bool insert_into(std::int32_t t, ImproveTetsStats& stats);
  void improve_around(std::int32_t v, ImproveTetsStats& stats);

  OpenTets tets_;
  const StageContext& context_;
  const TetGoal goal_;
  ChangeFinder changes_;
  MoveFinder moves_;
  const double insert_below_;
  const std::size_t most_tries_;
  std::size_t insertions_left_, insertion_tries_left_;
  std::vector<std::uint64_t> tried_vertex_, tried_tet_, tried_insertion_;
  std::vector<Failures> failures_;
  std::uint64_t last_flip_ = 0;  ///< time of the last round of flips
  std::size_t step_ = 0;
  MoveFinder::Star star_;
  OpenTets::Ring ring_;
};

}  // namespace cvmesh
