// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/tet/tet_improver.h"

#include "cvmesh/core/error.h"
#include "cvmesh/core/parallel.h"
#include "cvmesh/tet/cavity.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <tuple>
#include <utility>

namespace cvmesh {
namespace {

constexpr const char* kStage = "tetrahedra";
constexpr double kDegree = std::numbers::pi / 180;
constexpr std::int32_t kNone = OpenTets::kNone;
/// A new vertex costs tets, so it has to be worth more than a flip.
constexpr double kLeastInsertionGain = 0.01;
/// A flip of a surface edge must not make triangles much poorer than they were.
constexpr double kLeastShapeKept = 0.5;
/// Vertices of the surface move for tets below it. At 15 degrees the sine is that of 165, too: the
/// tets leave both ends of what counts as poor.
constexpr double kOpenGapsBelowDeg = 15.1;
/// Tries of new vertices in a tet that stays as it is.
constexpr int kMostTries = 2;
/// Tets or vertices that one task looks at.
constexpr std::size_t kBlock = 512;
/// A round of flips that changes fewer tets than one in this many is the last one.
constexpr std::size_t kQuietRound = 1000;

}  // namespace

TetImprover::TetImprover(TetMesh& mesh,
                         const ImproveTetsOptions& options,
                         const StageContext& context)
    : tets_(mesh),
      context_(context),
      goal_(std::sin(options.comfort_deg * kDegree)),
      changes_(tets_, goal_),
      moves_(tets_, goal_),
      insert_below_(std::sin(options.insert_below_deg * kDegree)),
      most_tries_(std::max(options.few_insertion_tries,
                           share_of_vertices(options.max_insertion_tries_per_vertex))),
      insertions_left_(share_of_vertices(options.max_insertions_per_vertex)),
      insertion_tries_left_(most_tries_) {
  tried_vertex_.assign(tets_.point_count(), 0);
  tried_tet_.assign(tets_.slot_count(), 0);
}

void TetImprover::look_only_at(const std::vector<std::int32_t>& vertices,
                               std::size_t most_insertion_tries) {
  tried_vertex_.assign(tets_.point_count(), tets_.now());
  for (const std::int32_t v : vertices)
    tried_vertex_[v] = 0;
  tried_tet_.assign(tets_.slot_count(), tets_.now());
  for (std::size_t t = 0; t < tried_tet_.size(); ++t)
    for (const std::int32_t v : tets_.tet(static_cast<std::int32_t>(t)))
      if (tried_vertex_[v] == 0) tried_tet_[t] = 0;
  tried_insertion_ = tried_tet_;
  last_flip_ = tets_.now();
  insertion_tries_left_ = std::min(insertion_tries_left_, most_insertion_tries);
}

void TetImprover::mend(ImproveTetsStats& stats) {
  for (const std::int32_t t : poor_tets(goal_.comfort())) {
    if (!is_open(t, goal_.comfort(), tried_tet_)) continue;
    const TetChange change = changes_.best_change(t);
    if (change.kind != TetChange::Kind::None) apply(change, stats);
  }
}

void TetImprover::flip(ImproveTetsStats& stats) {
  constexpr int kRounds = 4;  // proposals that stood in each other's way get another chance
  for (int round = 0; round < kRounds; ++round)
    if (flip_once(stats) * kQuietRound < tets_.slot_count()) break;
}

std::size_t TetImprover::smooth() {
  std::vector<MoveFinder::Move> moves(tets_.point_count());
  tried_vertex_.resize(moves.size(), 0);
  parallel_for_each_index(
      0, (moves.size() + kBlock - 1) / kBlock,
      [&](std::size_t block) {
        MoveFinder::Star star;
        const std::size_t end = std::min((block + 1) * kBlock, moves.size());
        for (std::size_t v = block * kBlock; v < end; ++v)
          if (wants_move(static_cast<std::int32_t>(v))) {
            moves[v] = moves_.find_move(static_cast<std::int32_t>(v), 2, star);
            tried_vertex_[v] = tets_.now();
          }
      },
      1);
  std::size_t count = 0;
  MoveFinder::Star star;
  for (std::size_t i = 0; i < moves.size(); ++i) {
    leave_if_cancelled(i);
    const auto v = static_cast<std::int32_t>(i);
    if (!moves[i].is_found) continue;
    moves_.gather(v, star);
    const double floor = goal_.capped(star.quality.worst);
    if (!goal_.is_better(star.scores.quality_at(moves[i].position, floor), star.quality)) continue;
    tets_.move_point(v, moves[i].position, star.tets);
    ++count;
  }
  return count;
}

void TetImprover::shed(double max_shift,
                       const std::vector<bool>& is_frozen,
                       ImproveTetsStats& stats) {
  if (!(max_shift > 0)) return;
  const auto stays = [&](std::int32_t v) {
    return static_cast<std::size_t>(v) < is_frozen.size() && is_frozen[v];
  };
  tets_.find_tets_at_facets();
  for (const std::int32_t t : poor_tets(goal_.comfort())) {
    const Tet tet = tets_.tet(t);
    if (std::any_of(tet.begin(), tet.end(), stays)) continue;
    for (std::size_t e = 0; e < 6 && !tets_.is_removed(t); ++e)
      if (shed_at(t, e, max_shift, stats)) break;
  }
}

void TetImprover::open_gaps(const std::vector<Vec3>& home,
                            const std::vector<bool>& is_frozen,
                            double max_shift,
                            GapOpener::Barred barred,
                            ImproveTetsStats& stats) {
  if (!(max_shift > 0)) return;
  const double poor = std::sin(kOpenGapsBelowDeg * kDegree);
  GapOpener gaps(tets_, home, is_frozen, max_shift, poor, most_tries_);
  for (const double share : {0.25, 0.5, 1.0, 1.0}) {
    if (gaps.open(share, barred) == 0) continue;
    mend(stats);
    if (share < 1 || !(insert_below_ > 0)) continue;
    failures_.clear();  // there is room where there was none
    insert(poor, stats);
  }
  std::tie(stats.shifted_vertices, stats.max_vertex_shift_mm) = shifts_from(home, tets_.surface());
}

std::size_t TetImprover::share_of_vertices(double share) const {
  return static_cast<std::size_t>(share * static_cast<double>(tets_.point_count()));
}

void TetImprover::insert(double below, ImproveTetsStats& stats) {
  for (const std::int32_t t : poor_tets(below)) {
    if (insertions_left_ == 0 || insertion_tries_left_ == 0) break;
    if (!is_open(t, below, tried_insertion_)) continue;
    // A tet that has stayed in place through some tries is bound by the surface around it.
    if (static_cast<std::size_t>(t) >= failures_.size()) failures_.resize(tets_.slot_count());
    Failures& failures = failures_[t];
    if (failures.tet != tets_.tet(t)) failures = {tets_.tet(t), 0};
    if (failures.count >= kMostTries) continue;
    const bool is_inserted = insert_into(t, stats);
    ++stats.insertion_tries;
    --insertion_tries_left_;
    if (is_inserted) {
      ++stats.insertions;
      --insertions_left_;
    } else {
      ++failures.count;
    }
  }
}

void TetImprover::leave_if_cancelled(std::size_t step) const {
  constexpr std::size_t kSteps = 1024;  // some ten milliseconds
  if (step % kSteps == 0 && context_.cancel != nullptr)
    require(!context_.cancel->load(std::memory_order_relaxed), ErrorCode::Limit, kStage,
            "cancelled");
}

std::vector<std::int32_t> TetImprover::poor_tets(double below) const {
  std::vector<std::pair<double, std::int32_t>> poor;
  for (std::int32_t t = 0; static_cast<std::size_t>(t) < tets_.slot_count(); ++t)
    if (tets_.score(t).min_sine < below) poor.emplace_back(tets_.score(t).min_sine, t);
  std::sort(poor.begin(), poor.end());
  std::vector<std::int32_t> tets;
  tets.reserve(poor.size());
  for (const auto& [sine, t] : poor)
    tets.push_back(t);
  return tets;
}

/// True where the tet is still poor and something around it has changed since the last try.
bool TetImprover::is_open(std::int32_t t, double below, std::vector<std::uint64_t>& tried) {
  leave_if_cancelled(step_++);
  if (tets_.is_removed(t) || tets_.score(t).min_sine >= below) return false;
  if (static_cast<std::size_t>(t) >= tried.size()) tried.resize(tets_.slot_count(), 0);
  if (!has_changed_since(t, tried[t])) return false;
  tried[t] = tets_.now();
  return true;
}

bool TetImprover::has_changed_since(std::int32_t t, std::uint64_t time) const {
  const Tet& tet = tets_.tet(t);
  return std::any_of(tet.begin(), tet.end(),
                     [&](std::int32_t v) { return tets_.changed_at(v) > time; });
}

void TetImprover::apply(const TetChange& change, ImproveTetsStats& stats) {
  tets_.replace(change.removed, change.added);
  if (change.kind == TetChange::Kind::EdgeRemoval) ++stats.edge_removals;
  if (change.kind == TetChange::Kind::FaceFlip) ++stats.face_flips;
  if (change.kind == TetChange::Kind::Contraction) ++stats.contractions;
}

/// True for an interior vertex around which something has changed since it was last tried.
bool TetImprover::wants_move(std::int32_t v) const {
  return !tets_.is_on_surface(v) && (static_cast<std::size_t>(v) >= tried_vertex_.size() ||
                                     tets_.changed_at(v) > tried_vertex_[v]);
}

bool TetImprover::move_vertex(std::int32_t v, int halvings) {
  if (!wants_move(v)) return false;
  if (static_cast<std::size_t>(v) >= tried_vertex_.size())
    tried_vertex_.resize(tets_.point_count(), 0);
  tried_vertex_[v] = tets_.now();
  const MoveFinder::Move move = moves_.find_move(v, halvings, star_);
  if (move.is_found) tets_.move_point(v, move.position, star_.tets);
  return move.is_found;
}

std::size_t TetImprover::flip_once(ImproveTetsStats& stats) {
  const std::uint64_t since = std::exchange(last_flip_, tets_.now());
  std::vector<std::vector<TetChange>> proposals((tets_.slot_count() + kBlock - 1) / kBlock);
  parallel_for_each_index(
      0, proposals.size(),
      [&](std::size_t block) {
        const std::size_t end = std::min((block + 1) * kBlock, tets_.slot_count());
        for (std::size_t t = block * kBlock; t < end; ++t)
          propose_removals(static_cast<std::int32_t>(t), since, proposals[block]);
      },
      1);
  std::size_t count = 0;
  for (const std::vector<TetChange>& changes : proposals) {
    leave_if_cancelled(0);
    for (const TetChange& change : changes) {
      if (std::any_of(change.removed.begin(), change.removed.end(), [&](std::int32_t t) {
            return tets_.is_removed(t) || has_changed_since(t, last_flip_);
          }))
        continue;
      apply(change, stats);
      ++count;
    }
  }
  return count;
}

void TetImprover::propose_removals(std::int32_t t,
                                   std::uint64_t since,
                                   std::vector<TetChange>& proposals) const {
  if (tets_.is_removed(t) || !has_changed_since(t, since)) return;
  OpenTets::Ring ring;
  for (std::size_t e = 0; e < 6; ++e) {
    // Once per edge: at the first tet with something new.
    const auto is_ours = [&](std::int32_t s) { return s > t || !has_changed_since(s, since); };
    if (!tets_.find_ring(t, e, ChangeFinder::kMaxRing, ring, is_ours)) continue;
    TetChange change;
    changes_.try_edge_removal(ring, change);
    if (change.kind != TetChange::Kind::None) proposals.push_back(std::move(change));
  }
}

bool TetImprover::shed_at(std::int32_t t,
                          std::size_t e,
                          double max_shift,
                          ImproveTetsStats& stats) {
  const auto [i, j, k, l] = OpenTets::kEdges[e];
  if (tets_.neighbour(t, k) != kNone || tets_.neighbour(t, l) != kNone) return false;
  const Tet& tet = tets_.tet(t);
  const Vec3 &a = tets_.point(tet[i]), &b = tets_.point(tet[j]), &c = tets_.point(tet[k]),
             &d = tets_.point(tet[l]);
  const double volume = volume6(a, b, c, d);
  // How far the surface moves: the distance between the two diagonals.
  if (volume > max_shift * norm(cross(b - a, d - c))) return false;
  const double old_shape = std::min(triangle_quality(a, b, c), triangle_quality(a, b, d));
  const double new_shape = std::min(triangle_quality(a, c, d), triangle_quality(b, c, d));
  if (new_shape < kLeastShapeKept * old_shape) return false;
  tets_.begin_trial();
  if (!tets_.hand_over(t, e)) {
    tets_.undo_trial();
    return false;
  }
  const ImproveTetsStats stats_before = stats;
  if (!tets_.is_removed(t) && tets_.find_ring(t, e, ChangeFinder::kMaxRing, ring_)) {
    TetChange change;
    changes_.try_edge_removal(ring_, change);
    if (change.kind != TetChange::Kind::None) apply(change, stats);
  }
  const auto [before, after] = tets_.compare_trial(goal_.comfort());
  if (after.worst > TetGoal::kLeastSine && after.worst >= before.worst &&
      after.sum < before.sum - TetGoal::kLeastGain * TetGoal::kLeastGain) {
    tets_.keep_trial();
    ++stats.surface_flips;
    return true;
  }
  tets_.undo_trial();
  stats = stats_before;
  return false;
}

/// Tries a new vertex at several places, each followed by changes and moves around it, and keeps
/// the first that helps: no angle below the worst one, and less lacking to `insert_below_deg`
/// [Klingner 2008].
bool TetImprover::insert_into(std::int32_t t, ImproveTetsStats& stats) {
  for (Vec3 p : insertion_places(tets_, t)) {
    const Cavity cavity = dig_cavity(tets_, t, p);
    if (cavity.tets.empty()) continue;
    tets_.begin_trial();
    const ImproveTetsStats stats_before = stats;
    const std::int32_t v = tets_.add_point(p);
    tets_.replace(cavity.tets, cavity.tets_with(v));
    improve_around(v, stats);
    const auto [before, after] = tets_.compare_trial(insert_below_);
    if (after.worst > TetGoal::kLeastSine && after.worst >= before.worst &&
        after.sum < before.sum - kLeastInsertionGain * kLeastInsertionGain) {
      tets_.keep_trial();
      return true;
    }
    tets_.undo_trial();
    stats = stats_before;
  }
  return false;
}

void TetImprover::improve_around(std::int32_t v, ImproveTetsStats& stats) {
  constexpr int kRounds = 3;
  std::vector<std::int32_t> around;
  for (int round = 0; round < kRounds; ++round) {
    const std::uint64_t then = tets_.now();
    move_vertex(v, 3);
    tets_.find_star(v, around);
    if (around.empty()) return;  // contracted
    const std::vector<std::int32_t> star = around;
    for (const std::int32_t t : star) {
      if (tets_.is_removed(t) || tets_.score(t).min_sine >= insert_below_) continue;
      const TetChange change = changes_.best_change(t);
      if (change.kind != TetChange::Kind::None) apply(change, stats);
    }
    tets_.find_star(v, around);
    std::vector<std::int32_t> vertices;
    for (const std::int32_t t : around)
      for (const std::int32_t u : tets_.tet(t))
        if (!tets_.is_on_surface(u)) vertices.push_back(u);
    std::sort(vertices.begin(), vertices.end());
    vertices.erase(std::unique(vertices.begin(), vertices.end()), vertices.end());
    for (const std::int32_t u : vertices)
      move_vertex(u, 2);
    if (tets_.now() == then) break;
  }
}

}  // namespace cvmesh
