// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/tet/find_changes.h"

#include "cvmesh/mesh/tet_faces.h"

#include <algorithm>
#include <array>
#include <limits>
#include <utility>

namespace cvmesh {
namespace {

using Tet = OpenTets::Tet;
using Ring = OpenTets::Ring;

constexpr std::int32_t kNone = OpenTets::kNone;

}  // namespace

/// Keeps the change if it is the best so far: by the worst sine, then by the mean.
void ChangeFinder::offer(TetChange&& change, const TetQuality& before, TetChange& best) const {
  if (!goal_.is_better(change.quality, before)) return;
  const double worst_gain = goal_.capped(change.quality.worst) - goal_.capped(before.worst);
  change.gain = 10 * worst_gain + change.quality.mean() - before.mean();
  if (best.kind == TetChange::Kind::None || change.gain > best.gain) best = std::move(change);
}

/// The best triangulation of the ring, two tets on each triangle, by dynamic programming
/// [Klingner 2008].
void ChangeFinder::try_edge_removal(const Ring& ring, TetChange& best) const {
  const std::size_t n = ring.corners.size();
  const TetQuality before = quality_of(tets_, ring.tets);
  const double floor = std::max(goal_.capped(before.worst), TetGoal::kLeastSine);
  const Vec3Pair ends(tets_.point(ring.b), tets_.point(ring.a));
  std::array<Vec3, kMaxRing> corners;
  for (std::size_t i = 0; i < n; ++i)
    corners[i] = tets_.point(ring.corners[i]);

  struct Entry {
    double worst = -1, sum = 0;
    std::size_t choice = 0;
  };

  std::array<std::array<Entry, kMaxRing>, kMaxRing> table;
  for (std::size_t i = 0; i + 1 < n; ++i)
    table[i][i + 1] = {std::numeric_limits<double>::infinity(), 0, 0};
  for (std::size_t length = 2; length < n; ++length)
    for (std::size_t i = 0; i + length < n; ++i) {
      const std::size_t j = i + length;
      Entry& entry = table[i][j];
      entry = {};
      for (std::size_t k = i + 1; k < j; ++k) {
        const double parts = std::min(table[i][k].worst, table[k][j].worst);
        if (parts < floor) continue;
        const Vec3 &p = corners[i], &q = corners[k], &r = corners[j];
        const auto scores = score_two_tets({p, q}, {q, p}, {r, r}, ends, floor);
        if (!scores) continue;
        const auto& [above, below] = *scores;
        const double worst = goal_.capped(std::min({parts, above.min_sine, below.min_sine}));
        const double sum =
            above.radius_ratio + below.radius_ratio + table[i][k].sum + table[k][j].sum;
        if (worst > entry.worst || (worst == entry.worst && sum > entry.sum))
          entry = {worst, sum, k};
      }
    }
  const Entry& whole = table[0][n - 1];
  if (whole.worst < floor) return;
  TetChange change{TetChange::Kind::EdgeRemoval, {whole.worst, whole.sum, 2 * (n - 2)}, 0, {}, {}};
  if (!goal_.is_better(change.quality, before)) return;
  change.removed = ring.tets;
  std::array<std::pair<std::size_t, std::size_t>, kMaxRing> open;
  std::size_t open_count = 1;
  open[0] = {0, n - 1};
  while (open_count > 0) {
    const auto [i, j] = open[--open_count];
    if (j - i < 2) continue;
    const std::size_t k = table[i][j].choice;
    change.added.push_back({ring.corners[i], ring.corners[k], ring.corners[j], ring.b});
    change.added.push_back({ring.corners[k], ring.corners[i], ring.corners[j], ring.a});
    open[open_count++] = {i, k};
    open[open_count++] = {k, j};
  }
  offer(std::move(change), before, best);
}

/// Two tets on face k of t become three around the new edge between their far corners.
void ChangeFinder::try_face_flip(std::int32_t t, std::size_t k, TetChange& best) const {
  const std::int32_t other = tets_.neighbour(t, k);
  if (other == kNone) return;
  const Tet& tet = tets_.tet(t);
  std::int32_t far = kNone;
  for (const std::int32_t v : tets_.tet(other))
    if (std::find(tet.begin(), tet.end(), v) == tet.end()) far = v;
  TetQuality before;
  before.add(tets_.score(t));
  before.add(tets_.score(other));
  const double floor = std::max(goal_.capped(before.worst), TetGoal::kLeastSine);
  TetChange change{TetChange::Kind::FaceFlip, {}, 0, {t, other}, {}};
  const auto& f = kTetFaces[k];
  for (std::size_t i = 0; i < 3; ++i) {
    change.added.push_back({tet[k], far, tet[f[i]], tet[f[(i + 1) % 3]]});
    change.quality.add(tets_.score_of(change.added.back(), floor));
    if (change.quality.worst < floor) return;
  }
  offer(std::move(change), before, best);
}

/// Interior vertex v goes into another one of its tet t, which must see all of the star's boundary.
void ChangeFinder::try_contractions(std::int32_t v, const Tet& t, TetChange& best) {
  tets_.find_star(v, star_);
  const TetQuality before = quality_of(tets_, star_);
  const double floor = std::max(goal_.capped(before.worst), TetGoal::kLeastSine);
  for (const std::int32_t u : t)
    if (u != v) try_contraction(v, u, before, floor, best);
}

/// The same for one vertex u, with the star of v.
void ChangeFinder::try_contraction(
    std::int32_t v, std::int32_t u, const TetQuality& before, double floor, TetChange& best) const {
  TetChange change{TetChange::Kind::Contraction, {}, 0, {}, {}};
  for (const std::int32_t t : star_) {
    Tet tet = tets_.tet(t);
    if (std::find(tet.begin(), tet.end(), u) != tet.end()) continue;
    *std::find(tet.begin(), tet.end(), v) = u;
    change.added.push_back(tet);
    change.quality.add(tets_.score_of(tet, floor));
    if (change.quality.worst < floor) return;
  }
  if (change.added.empty()) return;
  change.removed = star_;
  offer(std::move(change), before, best);
}

TetChange ChangeFinder::best_change(std::int32_t t) {
  TetChange best;
  for (std::size_t e = 0; e < 6; ++e)
    if (tets_.find_ring(t, e, kMaxRing, ring_)) try_edge_removal(ring_, best);
  for (std::size_t k = 0; k < 4; ++k)
    try_face_flip(t, k, best);
  const Tet& tet = tets_.tet(t);
  for (const std::int32_t v : tet)
    if (!tets_.is_on_surface(v)) try_contractions(v, tet, best);
  return best;
}

}  // namespace cvmesh
