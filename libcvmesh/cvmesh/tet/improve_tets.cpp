// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/tet/improve_tets.h"

#include "cvmesh/core/error.h"
#include "cvmesh/core/parallel.h"
#include "cvmesh/mesh/neighbour_tree.h"
#include "cvmesh/tet/cavity.h"
#include "cvmesh/tet/open_gaps.h"
#include "cvmesh/tet/open_tets.h"
#include "cvmesh/tet/split_surface_edges.h"

#include <spdlog/spdlog.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <numbers>
#include <optional>
#include <tuple>
#include <utility>
#include <vector>

namespace cvmesh {
namespace {

using Tet = OpenTets::Tet;
using Face = OpenTets::Face;
using Ring = OpenTets::Ring;

constexpr const char* kStage = "tetrahedra";
constexpr double kDegree = std::numbers::pi / 180;
constexpr double kInfinity = std::numeric_limits<double>::infinity();
/// A change must raise the worst sine, or the mean radius ratio, by this much: rounding cannot make
/// two states pass into each other for ever, and no time goes into gains that nobody sees.
constexpr double kLeastGain = 1e-3;
constexpr double kLeastMeanGain = 1e-3;
/// A new vertex costs tets, so it has to be worth more than a flip.
constexpr double kLeastInsertionGain = 0.01;
/// Below this sine the sign of a volume is not certain in double precision.
constexpr double kLeastSine = 1e-9;
/// A flip of a surface edge must not make triangles much poorer than they were.
constexpr double kLeastShapeKept = 0.5;
/// Vertices of the surface move for tets below it. At 15 degrees the sine is that of 165, too: the
/// tets leave both ends of what counts as poor.
constexpr double kOpenGapsBelowDeg = 15.1;
/// Most tets around an edge that is removed: larger rings hardly ever gain.
constexpr std::size_t kMaxRing = 9;
constexpr std::int32_t kNone = OpenTets::kNone;
/// Tries of new vertices in a tet that stays as it is.
constexpr int kMostTries = 2;
constexpr int kPassesBeforeInsertion = 2;
/// Tets or vertices that one task looks at.
constexpr std::size_t kBlock = 512;
/// A pass that changes fewer tets than one in this many is the last one.
constexpr std::size_t kQuietPass = 1000;

std::size_t at(std::int32_t index) {
  return static_cast<std::size_t>(index);
}

/// Of some tets together.
struct Quality {
  double worst = kInfinity;  ///< smallest sine
  double sum = 0;            ///< of radius ratios
  std::size_t count = 0;

  void add(const TetScore& score) {
    worst = std::min(worst, score.min_sine);
    sum += score.radius_ratio;
    ++count;
  }

  [[nodiscard]] double mean() const { return sum / static_cast<double>(count); }
};

/// The worst angle first; where it is comfortable, the mean radius ratio.
class Goal {
 public:
  explicit Goal(double comfortable_sine) : comfort_(comfortable_sine) {}

  [[nodiscard]] double comfort() const { return comfort_; }

  [[nodiscard]] double capped(double sine) const { return std::min(sine, comfort_); }

  [[nodiscard]] bool is_better(const Quality& now, const Quality& before) const {
    const double worst = capped(now.worst), old = capped(before.worst);
    if (worst <= kLeastSine) return false;
    if (worst > old + kLeastGain) return true;
    return worst >= old && now.mean() > before.mean() + kLeastMeanGain;
  }

 private:
  double comfort_;
};

/// Replacement of some tets by others that fill the same space.
struct Change {
  enum class Kind { None, EdgeRemoval, FaceFlip, Contraction } kind = Kind::None;
  Quality quality;
  double gain = 0;  ///< of the worst sine, then of the mean
  std::vector<std::int32_t> removed;
  std::vector<Tet> added;
};

class Improver {
 public:
  Improver(TetMesh& mesh, const ImproveTetsOptions& options, const StageContext& context)
      : tets_(mesh),
        context_(context),
        goal_(std::sin(options.comfort_deg * kDegree)),
        insert_below_(std::sin(options.insert_below_deg * kDegree)),
        most_insertions_(share_of_vertices(options.max_insertions_per_vertex)),
        most_tries_(std::max(options.few_insertion_tries,
                             share_of_vertices(options.max_insertion_tries_per_vertex))) {
    tried_vertex_.assign(tets_.point_count(), 0);
    tried_tet_.assign(tets_.slot_count(), 0);
  }

  [[nodiscard]] DihedralAngles measure() const { return measure_dihedral_angles(tets_); }

  [[nodiscard]] std::size_t slot_count() const { return tets_.slot_count(); }

  void close() { tets_.close(); }

  /// Leaves alone what has none of these vertices, until something there changes.
  void look_only_at(const std::vector<std::int32_t>& vertices) {
    tried_vertex_.assign(tets_.point_count(), tets_.now());
    for (const std::int32_t v : vertices)
      tried_vertex_[at(v)] = 0;
    tried_tet_.assign(tets_.slot_count(), tets_.now());
    for (std::size_t t = 0; t < tried_tet_.size(); ++t)
      for (const std::int32_t v : tets_.tet(static_cast<std::int32_t>(t)))
        if (tried_vertex_[at(v)] == 0) tried_tet_[t] = 0;
    tried_insertion_ = tried_tet_;
    last_flip_ = tets_.now();
  }

  /// One round of changes for tets with a poor angle, worst first.
  void mend(ImproveTetsStats& stats) {
    for (const std::int32_t t : poor_tets(goal_.comfort())) {
      if (!is_open(t, goal_.comfort(), tried_tet_)) continue;
      const Change change = best_change(t);
      if (change.kind != Change::Kind::None) apply(change, stats);
    }
  }

  /// One round of edge removals anywhere, for the mean. Proposals are made in parallel, on the mesh
  /// as it is, and carried out in order where nothing has changed meanwhile: the result does not
  /// depend on the number of threads.
  void flip(ImproveTetsStats& stats) {
    constexpr int kRounds = 4;  // proposals that stood in each other's way get another chance
    for (int round = 0; round < kRounds; ++round)
      if (flip_once(stats) * kQuietPass < tets_.slot_count()) break;
  }

  /// One round of moves over the vertices: searches in parallel, on the mesh as it is; then each
  /// is carried out in order if it still helps.
  std::size_t smooth() {
    std::vector<Move> moves(tets_.point_count());
    tried_vertex_.resize(moves.size(), 0);
    parallel_for_each_index(
        0, (moves.size() + kBlock - 1) / kBlock,
        [&](std::size_t block) {
          Star star;
          const std::size_t end = std::min((block + 1) * kBlock, moves.size());
          for (std::size_t v = block * kBlock; v < end; ++v)
            if (wants_move(static_cast<std::int32_t>(v))) {
              moves[v] = find_move(static_cast<std::int32_t>(v), 2, star);
              tried_vertex_[v] = tets_.now();
            }
        },
        1);
    std::size_t count = 0;
    Star star;
    for (std::size_t i = 0; i < moves.size(); ++i) {
      leave_if_cancelled(i);
      const auto v = static_cast<std::int32_t>(i);
      if (!moves[i].is_found) continue;
      gather(v, star);
      const double floor = goal_.capped(star.quality.worst);
      if (!goal_.is_better(quality_at(v, moves[i].position, floor, star), star.quality)) continue;
      tets_.move_point(v, moves[i].position, star.tets);
      ++count;
    }
    return count;
  }

  /// One round of flips of surface edges whose two facets, nearly in one plane, bound a flat tet:
  /// the tet goes over to the other side, where it must vanish in an edge removal.
  void shed(double max_shift, ImproveTetsStats& stats) {
    if (!(max_shift > 0)) return;
    tets_.find_tets_at_facets();
    for (const std::int32_t t : poor_tets(goal_.comfort()))
      for (std::size_t e = 0; e < 6 && !tets_.is_removed(t); ++e)
        if (shed_at(t, e, max_shift, stats)) break;
  }

  /// Moves vertices of the surface where it presses tets flat, with flips for what they allow.
  /// @param home  where these vertices were at first
  void open_gaps(const std::vector<Vec3>& home, double max_shift, ImproveTetsStats& stats) {
    if (!(max_shift > 0)) return;
    const double poor = std::sin(kOpenGapsBelowDeg * kDegree);
    GapOpener gaps(tets_, home, max_shift, poor, most_tries_);
    for (const double share : {0.25, 0.5, 1.0, 1.0}) {
      if (gaps.open(share) == 0) continue;
      mend(stats);
      if (share < 1 || !(insert_below_ > 0)) continue;
      failures_.clear();  // there is room where there was none
      insert(poor, stats);
    }
    std::tie(stats.shifted_vertices, stats.max_vertex_shift_mm) = gaps.shifts();
  }

  /// One round of new vertices in tets that neither flips nor moves could help, worst first.
  void insert(ImproveTetsStats& stats) { insert(insert_below_, stats); }

 private:
  [[nodiscard]] std::size_t share_of_vertices(double share) const {
    return static_cast<std::size_t>(share * static_cast<double>(tets_.point_count()));
  }

  void insert(double below, ImproveTetsStats& stats) {
    for (const std::int32_t t : poor_tets(below)) {
      if (stats.insertions >= most_insertions_ || stats.insertion_tries >= most_tries_) break;
      if (!is_open(t, below, tried_insertion_)) continue;
      // A tet that has stayed in place through some tries is bound by the surface around it.
      if (at(t) >= failures_.size()) failures_.resize(tets_.slot_count());
      Failures& failures = failures_[at(t)];
      if (failures.tet != tets_.tet(t)) failures = {tets_.tet(t), 0};
      if (failures.count >= kMostTries) continue;
      const bool is_inserted = insert_into(t, stats);
      ++stats.insertion_tries;
      if (is_inserted)
        ++stats.insertions;
      else
        ++failures.count;
    }
  }

  void leave_if_cancelled(std::size_t step) const {
    constexpr std::size_t kSteps = 1024;  // some ten milliseconds
    if (step % kSteps == 0 && context_.cancel != nullptr)
      require(!context_.cancel->load(std::memory_order_relaxed), ErrorCode::Limit, kStage,
              "cancelled");
  }

  [[nodiscard]] const Vec3& point(std::int32_t v) const { return tets_.point(v); }

  [[nodiscard]] Face face_of(const Tet& tet, std::size_t k) const {
    const auto& f = OpenTets::kFaces[k];
    return {tet[f[0]], tet[f[1]], tet[f[2]]};
  }

  [[nodiscard]] std::vector<std::int32_t> poor_tets(double below) const {
    std::vector<std::pair<double, std::int32_t>> poor;
    for (std::int32_t t = 0; at(t) < tets_.slot_count(); ++t)
      if (tets_.score(t).min_sine < below) poor.emplace_back(tets_.score(t).min_sine, t);
    std::sort(poor.begin(), poor.end());
    std::vector<std::int32_t> tets;
    tets.reserve(poor.size());
    for (const auto& [sine, t] : poor)
      tets.push_back(t);
    return tets;
  }

  /// True where the tet is still poor and something around it has changed since the last try.
  bool is_open(std::int32_t t, double below, std::vector<std::uint64_t>& tried) {
    leave_if_cancelled(step_++);
    if (tets_.is_removed(t) || tets_.score(t).min_sine >= below) return false;
    if (at(t) >= tried.size()) tried.resize(tets_.slot_count(), 0);
    if (!has_changed_since(t, tried[at(t)])) return false;
    tried[at(t)] = tets_.now();
    return true;
  }

  [[nodiscard]] bool has_changed_since(std::int32_t t, std::uint64_t time) const {
    const Tet& tet = tets_.tet(t);
    return std::any_of(tet.begin(), tet.end(),
                       [&](std::int32_t v) { return tets_.changed_at(v) > time; });
  }

  [[nodiscard]] Quality quality_of(const std::vector<std::int32_t>& tets) const {
    Quality quality;
    for (const std::int32_t t : tets)
      quality.add(tets_.score(t));
    return quality;
  }

  void apply(const Change& change, ImproveTetsStats& stats) {
    tets_.replace(change.removed, change.added);
    if (change.kind == Change::Kind::EdgeRemoval) ++stats.edge_removals;
    if (change.kind == Change::Kind::FaceFlip) ++stats.face_flips;
    if (change.kind == Change::Kind::Contraction) ++stats.contractions;
  }

  /// Keeps the change if it is the best so far: by the worst sine, then by the mean.
  void offer(Change&& change, const Quality& before, Change& best) const {
    if (!goal_.is_better(change.quality, before)) return;
    const double worst_gain = goal_.capped(change.quality.worst) - goal_.capped(before.worst);
    change.gain = 10 * worst_gain + change.quality.mean() - before.mean();
    if (best.kind == Change::Kind::None || change.gain > best.gain) best = std::move(change);
  }

  /// The best triangulation of the ring, two tets on each triangle, by dynamic programming
  /// [Klingner 2008].
  void try_edge_removal(const Ring& ring, Change& best) const {
    const std::size_t n = ring.corners.size();
    const Quality before = quality_of(ring.tets);
    const double floor = std::max(goal_.capped(before.worst), kLeastSine);

    struct Entry {
      double worst = -1, sum = 0;
      std::size_t choice = 0;
    };

    std::array<std::array<Entry, kMaxRing>, kMaxRing> table;
    for (std::size_t i = 0; i + 1 < n; ++i)
      table[i][i + 1] = {kInfinity, 0, 0};
    for (std::size_t length = 2; length < n; ++length)
      for (std::size_t i = 0; i + length < n; ++i) {
        const std::size_t j = i + length;
        Entry& entry = table[i][j];
        entry = {};
        for (std::size_t k = i + 1; k < j; ++k) {
          const double parts = std::min(table[i][k].worst, table[k][j].worst);
          if (parts < floor) continue;
          const TetScore above =
              tets_.score_of({ring.corners[i], ring.corners[k], ring.corners[j], ring.b}, floor);
          if (above.min_sine < floor) continue;
          const TetScore below =
              tets_.score_of({ring.corners[k], ring.corners[i], ring.corners[j], ring.a}, floor);
          if (below.min_sine < floor) continue;
          const double worst = goal_.capped(std::min({parts, above.min_sine, below.min_sine}));
          const double sum =
              above.radius_ratio + below.radius_ratio + table[i][k].sum + table[k][j].sum;
          if (worst > entry.worst || (worst == entry.worst && sum > entry.sum))
            entry = {worst, sum, k};
        }
      }
    const Entry& whole = table[0][n - 1];
    if (whole.worst < floor) return;
    Change change{Change::Kind::EdgeRemoval, {whole.worst, whole.sum, 2 * (n - 2)}, 0, {}, {}};
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
  void try_face_flip(std::int32_t t, std::size_t k, Change& best) const {
    const std::int32_t other = tets_.neighbour(t, k);
    if (other == kNone) return;
    const Tet& tet = tets_.tet(t);
    std::int32_t far = kNone;
    for (const std::int32_t v : tets_.tet(other))
      if (std::find(tet.begin(), tet.end(), v) == tet.end()) far = v;
    Quality before;
    before.add(tets_.score(t));
    before.add(tets_.score(other));
    const double floor = std::max(goal_.capped(before.worst), kLeastSine);
    Change change{Change::Kind::FaceFlip, {}, 0, {t, other}, {}};
    const auto& f = OpenTets::kFaces[k];
    for (std::size_t i = 0; i < 3; ++i) {
      change.added.push_back({tet[k], far, tet[f[i]], tet[f[(i + 1) % 3]]});
      change.quality.add(tets_.score_of(change.added.back(), floor));
      if (change.quality.worst < floor) return;
    }
    offer(std::move(change), before, best);
  }

  /// Interior vertex v goes into u, which must see all of the star's boundary.
  void try_contraction(std::int32_t v, std::int32_t u, Change& best) {
    tets_.find_star(v, star_);
    const Quality before = quality_of(star_);
    const double floor = std::max(goal_.capped(before.worst), kLeastSine);
    Change change{Change::Kind::Contraction, {}, 0, {}, {}};
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

  Change best_change(std::int32_t t) {
    Change best;
    for (std::size_t e = 0; e < 6; ++e)
      if (tets_.find_ring(t, e, kMaxRing, ring_)) try_edge_removal(ring_, best);
    for (std::size_t k = 0; k < 4; ++k)
      try_face_flip(t, k, best);
    const Tet tet = tets_.tet(t);
    for (const std::int32_t v : tet)
      for (const std::int32_t u : tet)
        if (u != v && !tets_.is_on_surface(v)) try_contraction(v, u, best);
    return best;
  }

  /// The tets around a vertex, and their corners, so that the search need not look them up.
  struct Star {
    std::vector<std::int32_t> tets;  ///< the worst first
    std::vector<Tet> corners;
    Quality quality;
  };

  struct Move {
    bool is_found = false;
    Vec3 position;
  };

  void gather(std::int32_t v, Star& star) const {
    tets_.find_star(v, star.tets);
    std::sort(star.tets.begin(), star.tets.end(), [&](std::int32_t s, std::int32_t t) {
      return std::pair(tets_.score(s).min_sine, s) < std::pair(tets_.score(t).min_sine, t);
    });
    star.corners.clear();
    for (const std::int32_t t : star.tets)
      star.corners.push_back(tets_.tet(t));
    star.quality = quality_of(star.tets);
  }

  /// The quality around v if it were at p; stops once an angle is below `floor`.
  [[nodiscard]] Quality quality_at(std::int32_t v,
                                   const Vec3& p,
                                   double floor,
                                   const Star& star) const {
    Quality quality;
    for (const Tet& tet : star.corners) {
      std::array<Vec3, 4> c;
      for (std::size_t k = 0; k < 4; ++k)
        c[k] = tet[k] == v ? p : point(tet[k]);
      quality.add(score_tet(c[0], c[1], c[2], c[3], floor));
      if (quality.worst < floor) return quality;
    }
    return quality;
  }

  /// True for an interior vertex around which something has changed since it was last tried.
  bool wants_move(std::int32_t v) const {
    return !tets_.is_on_surface(v) &&
           (at(v) >= tried_vertex_.size() || tets_.changed_at(v) > tried_vertex_[at(v)]);
  }

  /// Pattern search for the best place of v: towards the centroid of the star, away from the worst
  /// tet's opposite face, and along the axes, with steps that halve `halvings` times.
  Move find_move(std::int32_t v, int halvings, Star& star) const {
    gather(v, star);
    if (star.tets.empty()) return {};
    Vec3 centroid, escape;
    double weight = 0, edge = 0;
    for (const Tet& tet : star.corners) {
      const double volume =
          std::abs(volume6(point(tet[0]), point(tet[1]), point(tet[2]), point(tet[3])));
      for (const std::int32_t u : tet) {
        centroid += volume / 4 * point(u);
        edge += distance(point(u), point(v)) / (3 * static_cast<double>(star.tets.size()));
      }
      weight += volume;
    }
    if (!(weight > 0)) return {};
    centroid *= 1 / weight;
    for (std::size_t k = 0; k < 4; ++k)
      if (star.corners[0][k] == v) {
        const Face face = face_of(star.corners[0], k);
        escape = -normalized(area_vector2(point(face[0]), point(face[1]), point(face[2])));
      }

    Quality reached = star.quality;
    Move best{false, point(v)};
    const auto attempt = [&](const Vec3& p) {
      const Quality quality = quality_at(v, p, goal_.capped(reached.worst), star);
      if (!goal_.is_better(quality, reached)) return;
      reached = quality;
      best = {true, p};
    };
    attempt(centroid);
    const bool is_poor = star.quality.worst < goal_.comfort();
    const std::array<Vec3, 8> directions{
        {{1, 0, 0}, {-1, 0, 0}, {0, 1, 0}, {0, -1, 0}, {0, 0, 1}, {0, 0, -1}, escape, -escape}};
    // A poor star gets a longer search: there are few.
    const std::size_t direction_count = is_poor ? 8 : 6;
    double step = (is_poor ? 0.3 : 0.15) * edge;
    for (int halving = 0; halving < halvings + (is_poor ? 2 : 0); ++halving, step /= 2) {
      const Vec3 from = best.position;
      for (std::size_t d = 0; d < direction_count; ++d)
        attempt(from + step * directions[d]);
    }
    return best;
  }

  bool move_vertex(std::int32_t v, int halvings) {
    if (!wants_move(v)) return false;
    if (at(v) >= tried_vertex_.size()) tried_vertex_.resize(tets_.point_count(), 0);
    tried_vertex_[at(v)] = tets_.now();
    const Move move = find_move(v, halvings, vertex_star_);
    if (move.is_found) tets_.move_point(v, move.position, vertex_star_.tets);
    return move.is_found;
  }

  std::size_t flip_once(ImproveTetsStats& stats) {
    const std::uint64_t since = std::exchange(last_flip_, tets_.now());
    std::vector<std::vector<Change>> proposals((tets_.slot_count() + kBlock - 1) / kBlock);
    parallel_for_each_index(
        0, proposals.size(),
        [&](std::size_t block) {
          const std::size_t end = std::min((block + 1) * kBlock, tets_.slot_count());
          for (std::size_t t = block * kBlock; t < end; ++t)
            propose_removals(static_cast<std::int32_t>(t), since, proposals[block]);
        },
        1);
    std::size_t count = 0;
    for (const std::vector<Change>& changes : proposals) {
      leave_if_cancelled(0);
      for (const Change& change : changes) {
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

  void propose_removals(std::int32_t t, std::uint64_t since, std::vector<Change>& proposals) const {
    if (tets_.is_removed(t) || !has_changed_since(t, since)) return;
    Ring ring;
    for (std::size_t e = 0; e < 6; ++e) {
      if (!tets_.find_ring(t, e, kMaxRing, ring)) continue;
      // Once per edge: at the first tet with something new.
      if (std::any_of(ring.tets.begin(), ring.tets.end(),
                      [&](std::int32_t s) { return s < t && has_changed_since(s, since); }))
        continue;
      Change change;
      try_edge_removal(ring, change);
      if (change.kind != Change::Kind::None) proposals.push_back(std::move(change));
    }
  }

  bool shed_at(std::int32_t t, std::size_t e, double max_shift, ImproveTetsStats& stats) {
    const auto [i, j, k, l] = OpenTets::kEdges[e];
    if (tets_.neighbour(t, k) != kNone || tets_.neighbour(t, l) != kNone) return false;
    const Tet& tet = tets_.tet(t);
    const Vec3 &a = point(tet[i]), &b = point(tet[j]), &c = point(tet[k]), &d = point(tet[l]);
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
    if (!tets_.is_removed(t) && tets_.find_ring(t, e, kMaxRing, ring_)) {
      Change change;
      try_edge_removal(ring_, change);
      if (change.kind != Change::Kind::None) apply(change, stats);
    }
    const auto [before, after] = tets_.compare_trial(goal_.comfort());
    if (after.worst > kLeastSine && after.worst >= before.worst &&
        after.sum < before.sum - kLeastGain * kLeastGain) {
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
  bool insert_into(std::int32_t t, ImproveTetsStats& stats) {
    for (Vec3 p : insertion_places(tets_, t)) {
      const Cavity cavity = dig_cavity(tets_, t, p);
      if (cavity.tets.empty()) continue;
      tets_.begin_trial();
      const ImproveTetsStats stats_before = stats;
      const std::int32_t v = tets_.add_point(p);
      tets_.replace(cavity.tets, cavity.tets_with(v));
      improve_around(v, stats);
      const auto [before, after] = tets_.compare_trial(insert_below_);
      if (after.worst > kLeastSine && after.worst >= before.worst &&
          after.sum < before.sum - kLeastInsertionGain * kLeastInsertionGain) {
        tets_.keep_trial();
        return true;
      }
      tets_.undo_trial();
      stats = stats_before;
    }
    return false;
  }

  void improve_around(std::int32_t v, ImproveTetsStats& stats) {
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
        const Change change = best_change(t);
        if (change.kind != Change::Kind::None) apply(change, stats);
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

  struct Failures {
    Tet tet{kNone, kNone, kNone, kNone};
    int count = 0;
  };

  OpenTets tets_;
  const StageContext& context_;
  const Goal goal_;
  const double insert_below_;
  const std::size_t most_insertions_, most_tries_;
  // What was tried in vain is tried again only after something around it changed.
  std::vector<std::uint64_t> tried_vertex_, tried_tet_, tried_insertion_;
  std::vector<Failures> failures_;
  std::uint64_t last_flip_ = 0;  ///< time of the last round of flips
  std::size_t step_ = 0;
  std::vector<std::int32_t> star_;
  Star vertex_star_;
  Ring ring_;
};

/// The poor tets, the worst first.
/// @param lack  what their sines lack, squared and summed
std::vector<std::int32_t> find_poor_tets(const TetMesh& mesh, double& lack) {
  static_assert(kPoorMinDeg < 180 - kPoorMaxDeg);
  const double enough = std::sin(kPoorMaxDeg * kDegree);
  std::vector<double> sine(mesh.tets.size());
  parallel_for_each_index(0, sine.size(), [&](std::size_t t) {
    const auto& [a, b, c, d] = mesh.tets[t];
    const auto& p = mesh.points;
    sine[t] = min_dihedral_sine(p[at(a)], p[at(b)], p[at(c)], p[at(d)]);
  });
  std::vector<std::int32_t> poor;
  for (std::size_t t = 0; t < sine.size(); ++t)
    if (sine[t] < enough) poor.push_back(static_cast<std::int32_t>(t));
  std::sort(poor.begin(), poor.end(), [&](std::int32_t s, std::int32_t t) {
    return std::pair(sine[at(s)], s) < std::pair(sine[at(t)], t);
  });
  lack = 0;
  for (const std::int32_t t : poor)
    lack += (enough - sine[at(t)]) * (enough - sine[at(t)]);
  return poor;
}

/// A mesh whose surface may be refined where tets stay poor, with what was done to it.
struct Refined {
  TetMesh mesh;
  std::vector<Vec3> home;  ///< where the surface's vertices were at first
  ImproveTetsStats stats;
  std::vector<std::int32_t> poor{};  ///< tets
  double lack = 0;                   ///< of them

  /// Less is lacking, and no tet is much worse than the worst was.
  [[nodiscard]] bool is_better_than(const Refined& before) const {
    constexpr double kLeastAngleKept = 0.8, kLackKept = 0.95;
    return lack < kLackKept * before.lack &&
           stats.after.min_deg >= kLeastAngleKept * before.stats.after.min_deg;
  }
};

/// Splits edges of the surface at some tets, and improves what is around them; nothing where no
/// edge can be split.
std::optional<Refined> split_and_improve(Refined refined,
                                         const std::vector<std::int32_t>& wanted,
                                         std::size_t most,
                                         const ImproveTetsOptions& options,
                                         const StageContext& context) {
  constexpr int kPasses = 3;
  auto& [mesh, home, stats, poor, lack] = refined;
  const std::vector<std::int32_t> touched =
      split_surface_edges(mesh, wanted, options.min_split_edge_mm, most);
  if (touched.empty()) return std::nullopt;
  stats.edge_splits += mesh.surface.points.size() - home.size();
  home.insert(home.end(), mesh.surface.points.begin() + static_cast<std::ptrdiff_t>(home.size()),
              mesh.surface.points.end());
  const std::size_t insertions = stats.insertions, insertion_tries = stats.insertion_tries;
  stats.insertions = stats.insertion_tries = 0;  // the bounds on them are those of one round
  Improver improver(mesh, options, context);
  improver.look_only_at(touched);
  for (int pass = 0; pass < kPasses; ++pass) {
    improver.mend(stats);
    improver.flip(stats);
    stats.moves += improver.smooth();
    improver.insert(stats);
  }
  improver.mend(stats);
  improver.open_gaps(home, options.max_vertex_shift_mm, stats);
  stats.insertions += insertions;
  stats.insertion_tries += insertion_tries;
  stats.after = improver.measure();
  improver.close();
  poor = find_poor_tets(mesh, lack);
  return refined;
}

std::vector<Vec3> centroids(const TetMesh& mesh, const std::vector<std::int32_t>& tets) {
  std::vector<Vec3> result;
  result.reserve(tets.size());
  for (const std::int32_t t : tets) {
    Vec3 sum;
    for (const std::int32_t v : mesh.tets[at(t)])
      sum += mesh.points[at(v)];
    result.push_back(sum / 4);
  }
  return result;
}

/// Of the poor tets before, those around which there are fewer of them after.
std::vector<std::int32_t> where_it_helped(const Refined& before, const Refined& after) {
  const std::vector<Vec3> old_places = centroids(before.mesh, before.poor);
  const std::vector<Vec3> new_places = centroids(after.mesh, after.poor);
  const NeighbourTree old_tree(old_places), new_tree(new_places);
  const std::vector<Vec3>& points = before.mesh.points;
  std::vector<std::int32_t> helped, found;
  for (std::size_t n = 0; n < before.poor.size(); ++n) {
    const Tet& tet = before.mesh.tets[at(before.poor[n])];
    double longest = 0;
    for (const auto& [i, j, k, l] : OpenTets::kEdges)
      longest = std::max(longest, distance(points[at(tet[i])], points[at(tet[j])]));
    old_tree.within(old_places[n], longest, found);
    const std::size_t old_count = found.size();
    new_tree.within(old_places[n], longest, found);
    if (found.size() < old_count) helped.push_back(before.poor[n]);
  }
  return helped;
}

/// Splits edges of the surface at poor tets while that makes it better; where it does not do so on
/// the whole, once more only where it does.
void refine_surface(Refined& refined,
                    const ImproveTetsOptions& options,
                    const StageContext& context) {
  constexpr int kMostRounds = 8;
  const auto most = static_cast<std::size_t>(options.max_splits_per_vertex *
                                             static_cast<double>(refined.home.size()));
  refined.poor = find_poor_tets(refined.mesh, refined.lack);
  for (int round = 0; round < kMostRounds && refined.stats.edge_splits < most; ++round) {
    const auto attempt = [&](const std::vector<std::int32_t>& wanted) {
      auto tried =
          split_and_improve(refined, wanted, most - refined.stats.edge_splits, options, context);
      if (tried)
        context.log->debug("{}: {} edges of the surface split, {} poor tets left of {}", kStage,
                           tried->stats.edge_splits - refined.stats.edge_splits, tried->poor.size(),
                           refined.poor.size());
      return tried;
    };
    auto tried = attempt(refined.poor);
    if (tried && !tried->is_better_than(refined)) tried = attempt(where_it_helped(refined, *tried));
    if (!tried || !tried->is_better_than(refined)) return;
    refined = std::move(*tried);
  }
}

}  // namespace

ImproveTetsStats improve_tets(TetMesh& mesh,
                              const ImproveTetsOptions& options,
                              const StageContext& context) {
  ImproveTetsStats stats;
  const std::vector<Vec3> home = mesh.surface.points;
  Improver improver(mesh, options, context);
  stats.before = improver.measure();
  while (stats.passes < options.passes) {
    ++stats.passes;
    const auto flips_of = [](const ImproveTetsStats& s) {
      return s.edge_removals + s.face_flips + s.contractions;
    };
    const std::size_t flips_then = flips_of(stats);
    improver.mend(stats);
    improver.flip(stats);
    if (stats.passes == kPassesBeforeInsertion) improver.shed(options.max_surface_shift_mm, stats);
    const std::size_t moves = improver.smooth();
    stats.moves += moves;
    // Flips and moves come first: they are cheaper, and most of what is poor at first goes by them.
    const bool may_insert = stats.passes > kPassesBeforeInsertion;
    const std::size_t insertions_then = stats.insertions, tries_then = stats.insertion_tries;
    if (may_insert) improver.insert(stats);
    const std::size_t inserted = stats.insertions - insertions_then;
    const std::size_t flips = flips_of(stats) - flips_then;
    context.log->debug("{}: improvement pass {}: {} flips, {} moves, {} insertions of {} tried",
                       kStage, stats.passes, flips, moves, inserted,
                       stats.insertion_tries - tries_then);
    if (may_insert && (flips + moves + inserted) * kQuietPass < improver.slot_count()) break;
  }
  improver.open_gaps(home, options.max_vertex_shift_mm, stats);
  stats.after = improver.measure();
  improver.close();
  if (stats.after.poor == 0 || !(options.max_splits_per_vertex > 0)) return stats;
  Refined refined{std::move(mesh), home, stats};
  refine_surface(refined, options, context);
  mesh = std::move(refined.mesh);
  return refined.stats;
}

}  // namespace cvmesh
