// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/tet/improve_tets.h"

#include "cvmesh/core/error.h"

#include <spdlog/spdlog.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <numbers>
#include <utility>
#include <vector>

namespace cvmesh {
namespace {

using Tet = std::array<std::int32_t, 4>;
using Face = std::array<std::int32_t, 3>;

constexpr const char* kStage = "tetrahedra";
constexpr double kDegree = std::numbers::pi / 180;
/// A change must raise the worst sine by this much: rounding cannot make two states pass into each
/// other for ever, and no time goes into gains that nobody sees.
constexpr double kLeastGain = 1e-3;
/// A new vertex costs tets, so it has to be worth more than a flip.
constexpr double kLeastInsertionGain = 0.05;
/// Below this sine the sign of a volume is not certain in double precision.
constexpr double kLeastQuality = 1e-9;
constexpr int kMaxRingBound = 12;
constexpr std::int32_t kNone = -1;
/// A pass that changes fewer tets than one in this many is the last one.
constexpr std::size_t kQuietPass = 2000;

std::size_t at(std::int32_t index) {
  return static_cast<std::size_t>(index);
}

/// Corners of face k (opposite corner k) of a positive tet, counter-clockwise from outside.
constexpr std::size_t kFaces[4][3] = {{1, 2, 3}, {0, 3, 2}, {0, 1, 3}, {0, 2, 1}};
/// The six edges, each with the other two corners such that (edge, rest) is an even permutation.
constexpr std::size_t kEdges[6][4] = {{0, 1, 2, 3}, {0, 2, 3, 1}, {0, 3, 1, 2},
                                      {1, 2, 0, 3}, {1, 3, 2, 0}, {2, 3, 0, 1}};

Face sorted_face(const Tet& tet, std::size_t k) {
  Face face{tet[kFaces[k][0]], tet[kFaces[k][1]], tet[kFaces[k][2]]};
  std::sort(face.begin(), face.end());
  return face;
}

/// Twice the area vectors of the faces, pointing out of a positive tet.
std::array<Vec3, 4> face_normals(const std::array<Vec3, 4>& p) {
  std::array<Vec3, 4> normals;
  for (std::size_t k = 0; k < 4; ++k)
    normals[k] = area_vector2(p[kFaces[k][0]], p[kFaces[k][1]], p[kFaces[k][2]]);
  return normals;
}

/// The tets that share an edge of the interior, as their ring of opposite corners.
struct Ring {
  std::int32_t a = kNone, b = kNone;
  std::vector<std::int32_t> corners;  ///< counter-clockwise around a -> b
  std::vector<std::int32_t> tets;     ///< tet k has corners k and k + 1
};

/// Replacement of some tets by others that fill the same space.
struct Change {
  enum class Kind { None, EdgeRemoval, FaceFlip, Insertion } kind = Kind::None;
  double worst = -1;
  std::vector<std::int32_t> removed;
  std::vector<Tet> added;
};

/// The mesh with its neighbours, open to local changes.
class Improver {
 public:
  Improver(TetMesh& mesh, const ImproveTetsOptions& options, const StageContext& context)
      : mesh_(mesh),
        context_(context),
        flip_below_(std::sin(options.flip_below_deg * kDegree)),
        smooth_below_(std::sin(options.smooth_below_deg * kDegree)),
        insert_below_(std::sin(options.insert_below_deg * kDegree)),
        max_ring_(static_cast<std::size_t>(std::clamp(options.max_ring, 3, kMaxRingBound))) {
    connect();
    quality_.resize(mesh_.tets.size());
    for (std::size_t t = 0; t < mesh_.tets.size(); ++t)
      quality_[t] = quality(mesh_.tets[t]);
    stamp_.assign(mesh_.tets.size(), 0);
    tried_tet_.assign(mesh_.tets.size(), 0);
    tried_vertex_.assign(mesh_.points.size(), 0);
    touched_.assign(mesh_.points.size(), 1);
  }

  /// One round of moves over the vertices, by index.
  std::size_t smooth() {
    std::size_t moves = 0;
    for (std::size_t v = mesh_.surface.points.size(); v < mesh_.points.size(); ++v) {
      leave_if_cancelled(v);
      moves += move_vertex(static_cast<std::int32_t>(v)) ? 1 : 0;
    }
    return moves;
  }

  /// One round of flips over the poor tets, worst first.
  void flip(ImproveTetsStats& stats) {
    std::vector<std::pair<double, std::int32_t>> poor;
    for (std::size_t t = 0; t < mesh_.tets.size(); ++t)
      if (quality_[t] < flip_below_) poor.emplace_back(quality_[t], static_cast<std::int32_t>(t));
    std::sort(poor.begin(), poor.end());
    std::size_t step = 0;
    for (const auto& [quality_then, t] : poor) {
      leave_if_cancelled(step++);
      if (quality_[at(t)] != quality_then || is_removed(t)) continue;
      const Tet& tet = mesh_.tets[at(t)];
      if (std::none_of(tet.begin(), tet.end(),
                       [&](std::int32_t v) { return touched_[at(v)] > tried_tet_[at(t)]; }))
        continue;
      tried_tet_[at(t)] = clock_;
      const Change change = best_change(t);
      if (change.kind == Change::Kind::None) continue;
      apply(change);
      ++(change.kind == Change::Kind::EdgeRemoval ? stats.edge_removals : stats.face_flips);
    }
  }

  /// One round of new vertices in tets that neither flips nor moves could help, worst first.
  std::size_t insert(std::size_t most) {
    std::vector<std::pair<double, std::int32_t>> poor;
    for (std::size_t t = 0; t < mesh_.tets.size(); ++t)
      if (quality_[t] < insert_below_) poor.emplace_back(quality_[t], static_cast<std::int32_t>(t));
    std::sort(poor.begin(), poor.end());
    std::size_t inserted = 0, step = 0;
    for (const auto& [quality_then, t] : poor) {
      leave_if_cancelled(step++);
      if (inserted == most) break;
      if (quality_[at(t)] != quality_then || is_removed(t)) continue;
      inserted += insert_into(t) ? 1 : 0;
    }
    return inserted;
  }

  /// Closes the gaps that removed tets and vertices left. Nothing may be changed afterwards.
  void compact() {
    std::size_t kept = 0;
    for (std::size_t t = 0; t < mesh_.tets.size(); ++t) {
      if (is_removed(static_cast<std::int32_t>(t))) continue;
      mesh_.tets[kept] = mesh_.tets[t];
      mesh_.material_of[kept++] = mesh_.material_of[t];
    }
    mesh_.tets.resize(kept);
    mesh_.material_of.resize(kept);
    compact_points();
  }

 private:
  void leave_if_cancelled(std::size_t step) const {
    constexpr std::size_t kSteps = 1024;  // some ten milliseconds
    if (step % kSteps == 0 && context_.cancel != nullptr)
      require(!context_.cancel->load(std::memory_order_relaxed), ErrorCode::Limit, kStage,
              "cancelled");
  }

  void compact_points() {
    std::vector<std::int32_t> new_index(mesh_.points.size(), kNone);
    for (const Tet& tet : mesh_.tets)
      for (const std::int32_t v : tet)
        new_index[at(v)] = 0;
    std::size_t kept = 0;
    for (std::size_t v = 0; v < mesh_.points.size(); ++v) {
      if (v >= mesh_.surface.points.size() && new_index[v] == kNone) continue;
      new_index[v] = static_cast<std::int32_t>(kept);
      mesh_.points[kept++] = mesh_.points[v];
    }
    mesh_.points.resize(kept);
    for (Tet& tet : mesh_.tets)
      for (std::int32_t& v : tet)
        v = new_index[at(v)];
  }

  [[nodiscard]] bool is_removed(std::int32_t t) const { return mesh_.tets[at(t)][0] == kNone; }

  [[nodiscard]] const Vec3& point(std::int32_t v) const { return mesh_.points[at(v)]; }

  [[nodiscard]] double quality(const Tet& t) const {
    return min_dihedral_sine(point(t[0]), point(t[1]), point(t[2]), point(t[3]));
  }

  /// Neighbours through faces; a facet of the surface, and the outside, is no neighbour: what lies
  /// beyond never takes part in a change.
  void connect() {
    struct Record {
      Face face;
      std::int32_t owner;

      bool operator<(const Record& other) const {
        return face != other.face ? face < other.face : owner < other.owner;
      }
    };

    std::vector<Record> records;
    records.reserve(4 * mesh_.tets.size() + mesh_.surface.facets.size());
    for (Face facet : mesh_.surface.facets) {
      std::sort(facet.begin(), facet.end());
      records.push_back({facet, kNone});
    }
    for (std::size_t t = 0; t < mesh_.tets.size(); ++t)
      for (std::size_t k = 0; k < 4; ++k)
        records.push_back({sorted_face(mesh_.tets[t], k), static_cast<std::int32_t>(4 * t + k)});
    std::sort(records.begin(), records.end());
    neighbour_.assign(mesh_.tets.size(), {kNone, kNone, kNone, kNone});
    for (std::size_t i = 0; i + 1 < records.size(); ++i) {
      const std::int32_t s = records[i].owner, t = records[i + 1].owner;
      if (s == kNone || records[i].face != records[i + 1].face) continue;
      if (i > 0 && records[i - 1].face == records[i].face) continue;  // a facet
      neighbour_[at(s / 4)][at(s % 4)] = t / 4;
      neighbour_[at(t / 4)][at(t % 4)] = s / 4;
    }
    tet_of_.assign(mesh_.points.size(), kNone);
    for (std::size_t t = 0; t < mesh_.tets.size(); ++t)
      for (const std::int32_t v : mesh_.tets[t])
        tet_of_[at(v)] = static_cast<std::int32_t>(t);
  }

  /// All tets around an interior vertex.
  void find_star(std::int32_t v, std::vector<std::int32_t>& star) {
    star.clear();
    if (tet_of_[at(v)] == kNone) return;
    ++stamp_now_;
    star.push_back(tet_of_[at(v)]);
    stamp_[at(star[0])] = stamp_now_;
    for (std::size_t i = 0; i < star.size(); ++i)
      for (std::size_t k = 0; k < 4; ++k) {
        const std::int32_t n = neighbour_[at(star[i])][k];
        if (mesh_.tets[at(star[i])][k] == v || n == kNone || stamp_[at(n)] == stamp_now_) continue;
        stamp_[at(n)] = stamp_now_;
        star.push_back(n);
      }
  }

  /// The worst quality around v if it were at p; stops once it is no better than `floor`.
  [[nodiscard]] double worst_at(std::int32_t v, const Vec3& p, double floor) const {
    double worst = std::numeric_limits<double>::infinity();
    for (const Tet& tet : star_tets_) {
      Vec3 c[4];
      for (std::size_t k = 0; k < 4; ++k)
        c[k] = tet[k] == v ? p : point(tet[k]);
      worst = std::min(worst, min_dihedral_sine(c[0], c[1], c[2], c[3]));
      if (worst <= floor) return worst;
    }
    return worst;
  }

  /// Pattern search for the place that makes the worst tet around v best: towards the centroid of
  /// the star, away from the worst tet's opposite face, and along the axes, with halving steps.
  bool move_vertex(std::int32_t v) {
    if (touched_[at(v)] <= tried_vertex_[at(v)]) return false;
    tried_vertex_[at(v)] = clock_;
    find_star(v, star_);
    if (star_.empty()) return false;
    std::sort(star_.begin(), star_.end(), [&](std::int32_t s, std::int32_t t) {
      return std::pair(quality_[at(s)], s) < std::pair(quality_[at(t)], t);
    });
    double worst = quality_[at(star_[0])];
    if (worst >= smooth_below_) return false;
    star_tets_.clear();
    Vec3 centroid, escape;
    double weight = 0, edge = 0;
    for (const std::int32_t t : star_) {
      const Tet& tet = mesh_.tets[at(t)];
      star_tets_.push_back(tet);
      const double volume =
          std::abs(volume6(point(tet[0]), point(tet[1]), point(tet[2]), point(tet[3])));
      for (const std::int32_t u : tet) {
        centroid += volume / 4 * point(u);
        edge += distance(point(u), point(v)) / (3 * static_cast<double>(star_.size()));
      }
      weight += volume;
    }
    if (!(weight > 0)) return false;
    centroid *= 1 / weight;
    for (std::size_t k = 0; k < 4; ++k)
      if (const Tet& tet = star_tets_[0]; tet[k] == v)
        escape = -normalized(area_vector2(point(tet[kFaces[k][0]]), point(tet[kFaces[k][1]]),
                                          point(tet[kFaces[k][2]])));
    return climb(v, worst, centroid, escape, edge);
  }

  bool climb(std::int32_t v, double worst, const Vec3& centroid, const Vec3& escape, double edge) {
    const Vec3 start = point(v);
    const double start_worst = worst;
    Vec3 best = start;
    const auto attempt = [&](const Vec3& p) {
      const double q = worst_at(v, p, worst + kLeastGain);
      if (q <= worst + kLeastGain) return false;
      worst = q;
      best = p;
      return true;
    };
    attempt(centroid);
    const Vec3 directions[] = {escape,    -escape,    {1, 0, 0}, {-1, 0, 0},
                               {0, 1, 0}, {0, -1, 0}, {0, 0, 1}, {0, 0, -1}};
    constexpr int kHalvings = 5, kStepsPerSize = 4;
    double step = 0.3 * edge;
    for (int halving = 0; halving < kHalvings; ++halving, step /= 2)
      for (int repeat = 0; repeat < kStepsPerSize; ++repeat) {
        const Vec3 from = best;
        bool has_moved = false;
        for (const Vec3& direction : directions)
          if (attempt(from + step * direction)) has_moved = true;
        if (!has_moved) break;
      }
    if (worst <= start_worst + kLeastGain || worst < kLeastQuality) return false;
    mesh_.points[at(v)] = best;
    ++clock_;
    for (const std::int32_t t : star_) {
      quality_[at(t)] = quality(mesh_.tets[at(t)]);
      for (const std::int32_t u : mesh_.tets[at(t)])
        touched_[at(u)] = clock_;
    }
    return true;
  }

  /// The tets around edge e of tet t; false when the edge lies on the surface or has too many.
  bool find_ring(std::int32_t t, std::size_t e, Ring& ring) const {
    const Tet& tet = mesh_.tets[at(t)];
    ring.a = tet[kEdges[e][0]];
    ring.b = tet[kEdges[e][1]];
    ring.corners = {tet[kEdges[e][2]]};
    ring.tets = {t};
    std::int32_t behind = tet[kEdges[e][2]], ahead = tet[kEdges[e][3]];
    for (std::int32_t now = t;;) {
      const Tet& corners = mesh_.tets[at(now)];
      const std::size_t opposite = static_cast<std::size_t>(
          std::find(corners.begin(), corners.end(), behind) - corners.begin());
      const std::int32_t next = neighbour_[at(now)][opposite];
      if (next == kNone) return false;
      ring.corners.push_back(ahead);
      if (next == t) break;
      ring.tets.push_back(next);
      if (ring.tets.size() > max_ring_) return false;
      behind = ahead;
      for (const std::int32_t v : mesh_.tets[at(next)])
        if (v != ring.a && v != ring.b && v != behind) ahead = v;
      now = next;
    }
    ring.corners.pop_back();  // the first corner again
    return ring.tets.size() >= 3;
  }

  /// The best triangulation of the ring, two tets on each triangle, by dynamic programming
  /// [Klingner 2008].
  void try_edge_removal(const Ring& ring, Change& best) const {
    const std::size_t n = ring.corners.size();
    double old_worst = std::numeric_limits<double>::infinity();
    for (const std::int32_t t : ring.tets)
      old_worst = std::min(old_worst, quality_[at(t)]);
    const double floor = std::max({old_worst + kLeastGain, best.worst, kLeastQuality});
    double value[kMaxRingBound][kMaxRingBound];
    std::size_t choice[kMaxRingBound][kMaxRingBound];
    for (std::size_t i = 0; i + 1 < n; ++i)
      value[i][i + 1] = std::numeric_limits<double>::infinity();
    for (std::size_t length = 2; length < n; ++length)
      for (std::size_t i = 0; i + length < n; ++i) {
        const std::size_t j = i + length;
        value[i][j] = -1;
        choice[i][j] = i + 1;
        for (std::size_t k = i + 1; k < j; ++k) {
          const double parts = std::min(value[i][k], value[k][j]);
          if (parts <= floor || parts <= value[i][j]) continue;
          double q = quality({ring.corners[i], ring.corners[k], ring.corners[j], ring.b});
          if (q > floor)
            q = std::min(q, quality({ring.corners[k], ring.corners[i], ring.corners[j], ring.a}));
          q = std::min(q, parts);
          if (q > value[i][j]) {
            value[i][j] = q;
            choice[i][j] = k;
          }
        }
      }
    if (value[0][n - 1] <= floor) return;
    best = {Change::Kind::EdgeRemoval, value[0][n - 1], ring.tets, {}};
    std::vector<std::pair<std::size_t, std::size_t>> open{{0, n - 1}};
    while (!open.empty()) {
      const auto [i, j] = open.back();
      open.pop_back();
      if (j - i < 2) continue;
      const std::size_t k = choice[i][j];
      best.added.push_back({ring.corners[i], ring.corners[k], ring.corners[j], ring.b});
      best.added.push_back({ring.corners[k], ring.corners[i], ring.corners[j], ring.a});
      open.emplace_back(i, k);
      open.emplace_back(k, j);
    }
  }

  /// Two tets on face k of t become three around the new edge between their far corners.
  void try_face_flip(std::int32_t t, std::size_t k, Change& best) const {
    const std::int32_t other = neighbour_[at(t)][k];
    if (other == kNone) return;
    const Tet& tet = mesh_.tets[at(t)];
    std::int32_t far = kNone;
    for (const std::int32_t v : mesh_.tets[at(other)])
      if (std::find(tet.begin(), tet.end(), v) == tet.end()) far = v;
    const double old_worst = std::min(quality_[at(t)], quality_[at(other)]);
    const double floor = std::max({old_worst + kLeastGain, best.worst, kLeastQuality});
    Change change{Change::Kind::FaceFlip, std::numeric_limits<double>::infinity(), {t, other}, {}};
    for (std::size_t i = 0; i < 3; ++i) {
      change.added.push_back({tet[k], far, tet[kFaces[k][i]], tet[kFaces[k][(i + 1) % 3]]});
      change.worst = std::min(change.worst, quality(change.added.back()));
      if (change.worst <= floor) return;
    }
    best = std::move(change);
  }

  Change best_change(std::int32_t t) {
    Change best;
    for (std::size_t e = 0; e < 6; ++e)
      if (find_ring(t, e, ring_)) try_edge_removal(ring_, best);
    for (std::size_t k = 0; k < 4; ++k)
      try_face_flip(t, k, best);
    return best;
  }

  /// Tets whose space a new vertex p takes over: connected, seen from p through every face of
  /// their boundary, and no facet between them.
  struct Cavity {
    struct Wall {
      Face face;  ///< seen from inside, so that (face, p) is positive
      std::int32_t tet;
      std::size_t k;
      double quality;
    };

    std::vector<std::int32_t> tets;
    std::vector<Wall> walls;
    double old_worst = std::numeric_limits<double>::infinity();
  };

  [[nodiscard]] double wall_quality(const Face& face, const Vec3& p) const {
    return min_dihedral_sine(point(face[0]), point(face[1]), point(face[2]), p);
  }

  void add_to(Cavity& cavity, std::int32_t t, const Vec3& p) const {
    cavity.tets.push_back(t);
    cavity.old_worst = std::min(cavity.old_worst, quality_[at(t)]);
    std::erase_if(cavity.walls, [&](const auto& w) { return neighbour_[at(w.tet)][w.k] == t; });
    for (std::size_t k = 0; k < 4; ++k) {
      const std::int32_t n = neighbour_[at(t)][k];
      if (n != kNone && std::find(cavity.tets.begin(), cavity.tets.end(), n) != cavity.tets.end())
        continue;
      const Tet& tet = mesh_.tets[at(t)];
      const Face face{tet[kFaces[k][0]], tet[kFaces[k][2]], tet[kFaces[k][1]]};
      cavity.walls.push_back({face, t, k, wall_quality(face, p)});
    }
  }

  static const Cavity::Wall& worst_wall(const Cavity& cavity) {
    return *std::min_element(cavity.walls.begin(), cavity.walls.end(),
                             [](const auto& v, const auto& w) { return v.quality < w.quality; });
  }

  /// Grows a cavity from t through its worst wall for as long as that can be opened, and keeps the
  /// best state on the way [Klingner 2008].
  [[nodiscard]] Cavity dig(std::int32_t t, const Vec3& p) const {
    constexpr std::size_t kMaxCavity = 40;
    Cavity cavity, best;
    double best_worst = -1;
    for (std::int32_t next = t; next != kNone && cavity.tets.size() < kMaxCavity;) {
      add_to(cavity, next, p);
      const auto& wall = worst_wall(cavity);
      if (wall.quality > best_worst) {
        best_worst = wall.quality;
        best = cavity;
      }
      next = neighbour_[at(wall.tet)][wall.k];
    }
    return best;
  }

  /// Every edge of the boundary in two walls: a ball as seen from p, with nothing pinched.
  static bool is_simple(const Cavity& cavity) {
    std::vector<std::pair<std::int32_t, std::int32_t>> edges;
    for (const auto& wall : cavity.walls)
      for (std::size_t k = 0; k < 3; ++k)
        edges.emplace_back(std::minmax(wall.face[k], wall.face[(k + 1) % 3]));
    std::sort(edges.begin(), edges.end());
    for (std::size_t i = 0; i < edges.size(); i += 2)
      if (i + 1 >= edges.size() || edges[i] != edges[i + 1] ||
          (i + 2 < edges.size() && edges[i] == edges[i + 2]))
        return false;
    return true;
  }

  /// Moves p to where the worst wall of the cavity is best; returns that quality.
  double settle(const Cavity& cavity, Vec3& p) const {
    const auto worst_for = [&](const Vec3& q, double floor) {
      double worst = std::numeric_limits<double>::infinity();
      for (const auto& wall : cavity.walls) {
        worst = std::min(worst, wall_quality(wall.face, q));
        if (worst <= floor) break;
      }
      return worst;
    };
    double edge = 0;
    Vec3 middle;
    for (const auto& wall : cavity.walls)
      for (const std::int32_t v : wall.face) {
        edge += distance(point(v), p) / (3 * static_cast<double>(cavity.walls.size()));
        middle += point(v) / (3 * static_cast<double>(cavity.walls.size()));
      }
    double worst = worst_for(p, -1);
    const auto attempt = [&](const Vec3& q) {
      const double quality = worst_for(q, worst);
      if (quality <= worst) return;
      worst = quality;
      p = q;
    };
    attempt(middle);
    constexpr int kSteps = 6;
    double step = 0.25 * edge;
    for (int i = 0; i < kSteps; ++i, step *= 0.6) {
      const Vec3 from = p;
      for (int axis = 0; axis < 3; ++axis)
        for (const double sign : {1.0, -1.0}) {
          Vec3 q = from;
          q[axis] += sign * step;
          attempt(q);
        }
    }
    return worst;
  }

  /// Where a new vertex may help t: its centroid, the middle of the tets around it, and off its
  /// facets, into the interior.
  [[nodiscard]] std::array<Vec3, 3> places_for(std::int32_t t) const {
    const Tet& tet = mesh_.tets[at(t)];
    Vec3 centroid, around, away;
    double count = 0, size = 0;
    for (std::size_t k = 0; k < 4; ++k) {
      centroid += point(tet[k]) / 4;
      size += distance(point(tet[k]), point(tet[(k + 1) % 4])) / 4;
      const std::int32_t n = neighbour_[at(t)][k];
      if (n == kNone) {
        away -= normalized(area_vector2(point(tet[kFaces[k][0]]), point(tet[kFaces[k][1]]),
                                        point(tet[kFaces[k][2]])));
        continue;
      }
      for (const std::int32_t v : mesh_.tets[at(n)])
        around += point(v);
      count += 4;
    }
    if (count > 0) around *= 1 / count;
    return {centroid, around, centroid + 0.6 * size * normalized(away)};
  }

  /// Puts a vertex where it raises the worst quality of the tets that it replaces the most.
  bool insert_into(std::int32_t t) {
    Cavity best;
    Vec3 place;
    double best_worst = kLeastQuality;
    for (Vec3 p : places_for(t)) {
      Cavity cavity = dig(t, p);
      if (cavity.walls.empty()) continue;
      settle(cavity, p);
      cavity = dig(t, p);
      if (cavity.walls.empty() || !is_simple(cavity)) continue;
      const double worst = settle(cavity, p);
      if (worst <= best_worst || worst <= cavity.old_worst + kLeastInsertionGain) continue;
      best_worst = worst;
      best = std::move(cavity);
      place = p;
    }
    if (best.tets.empty()) return false;
    const std::int32_t v = static_cast<std::int32_t>(mesh_.points.size());
    mesh_.points.push_back(place);
    tet_of_.push_back(kNone);
    touched_.push_back(clock_);
    tried_vertex_.push_back(0);
    Change change{Change::Kind::Insertion, best_worst, std::move(best.tets), {}};
    for (const auto& wall : best.walls)
      change.added.push_back({wall.face[0], wall.face[1], wall.face[2], v});
    for (const std::int32_t old : change.removed)
      for (const std::int32_t u : mesh_.tets[at(old)])
        tet_of_[at(u)] = kNone;
    apply(change);
    return true;
  }

  void apply(const Change& change) {
    struct Open {
      Face face;
      std::int32_t tet;  ///< beyond the face, kNone at the surface
      std::int32_t place;
    };

    std::vector<Open> open;
    const auto is_in = [&](std::int32_t t) {
      return std::find(change.removed.begin(), change.removed.end(), t) != change.removed.end();
    };
    for (const std::int32_t t : change.removed)
      for (std::size_t k = 0; k < 4; ++k) {
        const std::int32_t n = neighbour_[at(t)][k];
        if (n != kNone && is_in(n)) continue;
        std::int32_t place = kNone;
        for (std::size_t m = 0; n != kNone && m < 4; ++m)
          if (neighbour_[at(n)][m] == t &&
              sorted_face(mesh_.tets[at(n)], m) == sorted_face(mesh_.tets[at(t)], k))
            place = static_cast<std::int32_t>(m);
        open.push_back({sorted_face(mesh_.tets[at(t)], k), n, place});
      }
    const MaterialId material = mesh_.material_of[at(change.removed[0])];
    std::vector<std::int32_t> slots = change.removed;
    while (slots.size() < change.added.size())
      slots.push_back(new_slot());
    for (std::size_t i = change.added.size(); i < slots.size(); ++i) {
      mesh_.tets[at(slots[i])] = {kNone, kNone, kNone, kNone};
      quality_[at(slots[i])] = std::numeric_limits<double>::infinity();
      free_.push_back(slots[i]);
    }
    ++clock_;
    for (std::size_t i = 0; i < change.added.size(); ++i) {
      const std::int32_t t = slots[i];
      mesh_.tets[at(t)] = change.added[i];
      mesh_.material_of[at(t)] = material;
      quality_[at(t)] = quality(change.added[i]);
      for (std::size_t k = 0; k < 4; ++k) {
        tet_of_[at(change.added[i][k])] = t;
        touched_[at(change.added[i][k])] = clock_;
        const Face face = sorted_face(change.added[i], k);
        const auto match =
            std::find_if(open.begin(), open.end(), [&](const Open& o) { return o.face == face; });
        if (match == open.end()) {
          open.push_back({face, t, static_cast<std::int32_t>(k)});
          neighbour_[at(t)][k] = kNone;
        } else {
          neighbour_[at(t)][k] = match->tet;
          if (match->tet != kNone) neighbour_[at(match->tet)][at(match->place)] = t;
          open.erase(match);
        }
      }
    }
  }

  std::int32_t new_slot() {
    if (!free_.empty()) {
      const std::int32_t t = free_.back();
      free_.pop_back();
      return t;
    }
    mesh_.tets.emplace_back();
    mesh_.material_of.push_back(kExterior);
    neighbour_.push_back({kNone, kNone, kNone, kNone});
    quality_.push_back(0);
    stamp_.push_back(0);
    tried_tet_.push_back(0);
    return static_cast<std::int32_t>(mesh_.tets.size() - 1);
  }

  TetMesh& mesh_;
  const StageContext& context_;
  const double flip_below_, smooth_below_, insert_below_;
  const std::size_t max_ring_;
  std::vector<std::array<std::int32_t, 4>> neighbour_;
  std::vector<double> quality_;
  std::vector<std::int32_t> tet_of_, free_;
  // What was tried in vain is tried again only after something around it changed: `touched_` is
  // the time of the last change at a vertex.
  std::uint64_t clock_ = 1;
  std::vector<std::uint64_t> touched_, tried_vertex_, tried_tet_;
  std::vector<std::uint32_t> stamp_;
  std::uint32_t stamp_now_ = 0;
  std::vector<std::int32_t> star_;
  std::vector<Tet> star_tets_;
  Ring ring_;
};

struct Angles {
  double smallest_deg = 180, largest_deg = 0;
  std::size_t below_10_deg = 0, wedges_below_10_deg = 0;
};

/// Dihedral angles of the whole mesh; `facets` holds the sorted surface facets, in order.
Angles measure(const TetMesh& mesh, const std::vector<Face>& facets) {
  constexpr double kSmallAngle = 10;
  Angles angles;
  for (const Tet& tet : mesh.tets) {
    std::array<Vec3, 4> p;
    for (std::size_t k = 0; k < 4; ++k)
      p[k] = mesh.points[at(tet[k])];
    const std::array<Vec3, 4> normals = face_normals(p);
    double smallest = 180;
    std::size_t smallest_edge = 0;
    for (std::size_t e = 0; e < 6; ++e) {
      // The faces on an edge are those opposite the two other corners.
      const Vec3& m = normals[kEdges[e][2]];
      const Vec3& n = normals[kEdges[e][3]];
      const double angle = std::atan2(norm(cross(m, n)), -dot(m, n)) / kDegree;
      angles.largest_deg = std::max(angles.largest_deg, angle);
      if (angle < smallest) {
        smallest = angle;
        smallest_edge = e;
      }
    }
    angles.smallest_deg = std::min(angles.smallest_deg, smallest);
    if (smallest >= kSmallAngle) continue;
    ++angles.below_10_deg;
    const auto is_facet = [&](std::size_t k) {
      return std::binary_search(facets.begin(), facets.end(), sorted_face(tet, k));
    };
    if (is_facet(kEdges[smallest_edge][2]) && is_facet(kEdges[smallest_edge][3]))
      ++angles.wedges_below_10_deg;
  }
  return angles;
}

}  // namespace

double min_dihedral_sine(const Vec3& a, const Vec3& b, const Vec3& c, const Vec3& d) {
  // sin(dihedral at edge e) = 3 V |e| / (2 A B), A and B the areas of the two faces on e; with six
  // volumes and doubled areas that is volume6 |e| / (A2 B2). Squares save the roots.
  const std::array<Vec3, 4> p{a, b, c, d};
  const std::array<Vec3, 4> normals = face_normals(p);
  double area2[4];
  for (std::size_t k = 0; k < 4; ++k)
    area2[k] = squared_norm(normals[k]);
  const double volume = volume6(a, b, c, d);
  double least = std::numeric_limits<double>::infinity();
  double most = 0;
  for (const auto& e : kEdges) {
    const double areas = area2[e[2]] * area2[e[3]];
    if (!(areas > 0)) return volume < 0 ? -1 : 0;
    const double ratio = squared_norm(p[e[0]] - p[e[1]]) / areas;
    least = std::min(least, ratio);
    most = std::max(most, ratio);
  }
  return volume * std::sqrt(volume > 0 ? least : most);
}

ImproveTetsStats improve_tets(TetMesh& mesh,
                              const ImproveTetsOptions& options,
                              const StageContext& context) {
  ImproveTetsStats stats;
  std::vector<Face> facets = mesh.surface.facets;
  for (Face& facet : facets)
    std::sort(facet.begin(), facet.end());
  std::sort(facets.begin(), facets.end());
  const Angles before = measure(mesh, facets);
  const auto most_insertions = static_cast<std::size_t>(options.max_insertions_per_vertex *
                                                        static_cast<double>(mesh.points.size()));
  Improver improver(mesh, options, context);
  while (stats.passes < options.passes) {
    ++stats.passes;
    const std::size_t flips_then = stats.edge_removals + stats.face_flips;
    improver.flip(stats);
    const std::size_t moves = improver.smooth();
    stats.moves += moves;
    const std::size_t inserted = improver.insert(most_insertions - stats.insertions);
    stats.insertions += inserted;
    const std::size_t flips = stats.edge_removals + stats.face_flips - flips_then;
    context.log->debug("{}: improvement pass {}: {} flips, {} moves, {} insertions", kStage,
                       stats.passes, flips, moves, inserted);
    if ((flips + moves + inserted) * kQuietPass < mesh.tets.size()) break;
  }
  improver.compact();
  const Angles after = measure(mesh, facets);
  stats.min_dihedral_before_deg = before.smallest_deg;
  stats.max_dihedral_before_deg = before.largest_deg;
  stats.below_10_deg_before = before.below_10_deg;
  stats.min_dihedral_after_deg = after.smallest_deg;
  stats.max_dihedral_after_deg = after.largest_deg;
  stats.below_10_deg_after = after.below_10_deg;
  stats.wedges_below_10_deg = after.wedges_below_10_deg;
  return stats;
}

}  // namespace cvmesh
