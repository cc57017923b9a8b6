// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/tet/open_gaps.h"

#include "cvmesh/mesh/facet_predicates.h"
#include "cvmesh/tet/tet_score.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>

namespace cvmesh {
namespace {

constexpr std::int32_t kNone = OpenTets::kNone;
constexpr double kInfinity = std::numeric_limits<double>::infinity();
/// Below this sine the sign of a volume is not certain in double precision.
constexpr double kLeastSine = 1e-9;
/// Flatter tets count as this: what they lack must stay finite.
constexpr double kFlatSine = 1e-5;
constexpr int kMostRounds = 10;
/// A move must take this share of what is lacking.
constexpr double kLeastGain = 0.01;
/// Longest step of a vertex of the interior, over the mean edge around it.
constexpr double kInnerStep = 0.3;
/// A facet must not become much poorer than the poorest around the vertex, unless it is good.
constexpr double kLeastShapeKept = 0.9, kGoodShape = 0.4;
/// Of the angle that the exterior has at an edge.
constexpr double kOuterAngleKept = 0.5;
/// Distance that facets on the exterior keep, over the longest move; where they are nearer already,
/// what is left after so many halvings.
constexpr double kClearance = 0.01;
constexpr int kClearanceHalvings = 3;
/// Of a move that is barred.
constexpr int kMostHalvingsOfWay = 5;

bool holds(const OpenTets::Face& facet, std::int32_t v) {
  return facet[0] == v || facet[1] == v || facet[2] == v;
}

}  // namespace

std::pair<std::size_t, double> shifts_from(const std::vector<Vec3>& home,
                                           const InterfaceMesh& surface) {
  std::size_t count = 0;
  double longest = 0;
  for (std::size_t v = 0; v < home.size(); ++v) {
    const double way = distance(home[v], surface.points[v]);
    if (way > 0) ++count;
    longest = std::max(longest, way);
  }
  return {count, longest};
}

GapOpener::GapOpener(OpenTets& tets,
                     std::vector<Vec3> home,
                     const std::vector<bool>& is_frozen,
                     double max_shift_mm,
                     double enough_sine,
                     std::size_t most_tries)
    : tets_(tets),
      max_shift_(max_shift_mm),
      enough_(enough_sine),
      tries_left_(most_tries),
      home_(std::move(home)),
      is_fixed_(home_.size(), {false, false, false}) {
  const InterfaceMesh& surface = tets.surface();
  for (std::size_t f = 0; f < surface.facets.size(); ++f)
    if (const std::size_t wall = surface.patch_of[f].wall; wall != 0)
      for (const std::int32_t v : surface.facets[f])
        is_fixed_[v][(wall - 1) / 2] = true;
  for (std::size_t v = 0; v < is_frozen.size(); ++v)
    if (is_frozen[v]) is_fixed_[v] = {true, true, true};
}

std::size_t GapOpener::open(double share, Barred barred) {
  reach_ = share * max_shift_;
  std::fill(tried_.begin(), tried_.end(), 0);  // in vain, with a shorter reach
  tets_.find_facets_at_points();
  outer_.reset();  // flips may have changed it
  points_ = tets_.surface().points;
  points_.emplace_back();
  std::size_t moves = 0;
  for (int round = 0; round < kMostRounds; ++round) {
    const std::size_t now = open_once(barred);
    if (now == 0) break;
    moves += now;
  }
  return moves;
}

std::size_t GapOpener::open_once(Barred barred) {
  std::size_t moves = 0;
  tried_.resize(tets_.point_count(), 0);
  for (Star& star : stars_of_poor_tets()) {
    if (tries_left_ == 0) break;
    if (tets_.changed_at(star.v) <= tried_[star.v]) continue;
    tried_[star.v] = tets_.now();
    sort(star);
    if (star.worst >= enough_) continue;
    --tries_left_;
    const Vec3 p = allowed_place(star, find_place(star), barred);
    if (p == tets_.point(star.v)) continue;
    move(star, p);
    ++moves;
  }
  return moves;
}

std::vector<GapOpener::Star> GapOpener::stars_of_poor_tets() const {
  std::vector<std::pair<double, std::int32_t>> poor;
  for (std::int32_t t = 0; static_cast<std::size_t>(t) < tets_.slot_count(); ++t)
    if (tets_.score(t).min_sine < enough_) poor.emplace_back(tets_.score(t).min_sine, t);
  std::sort(poor.begin(), poor.end());
  std::vector<Star> stars;
  std::vector<std::int32_t> star_of(tets_.point_count(), kNone);
  for (const auto& [sine, t] : poor) {
    if (stars.size() >= tries_left_) break;
    for (const std::int32_t v : tets_.tet(t)) {
      if (star_of[v] != kNone ||
          (tets_.is_on_surface(v) && is_fixed_[v] == std::array{true, true, true}))
        continue;
      star_of[v] = static_cast<std::int32_t>(stars.size());
      stars.push_back({v, {}, {}});
    }
  }
  // Around a vertex of the surface neighbours lead to one side only.
  for (std::int32_t t = 0; static_cast<std::size_t>(t) < tets_.slot_count(); ++t) {
    if (tets_.is_removed(t)) continue;
    for (const std::int32_t v : tets_.tet(t))
      if (star_of[v] != kNone) stars[star_of[v]].tets.push_back(t);
  }
  return stars;
}

void GapOpener::sort(Star& star) const {
  std::sort(star.tets.begin(), star.tets.end(), [&](std::int32_t s, std::int32_t t) {
    return std::pair(tets_.score(s).min_sine, s) < std::pair(tets_.score(t).min_sine, t);
  });
  star.worst = tets_.score(star.tets.front()).min_sine;
  for (const std::int32_t t : star.tets) {
    star.corners.push_back(tets_.tet(t));
    for (const std::int32_t u : tets_.tet(t))
      star.edge += distance(tets_.point(u), tets_.point(star.v)) /
                   (3 * static_cast<double>(star.tets.size()));
  }
}

double GapOpener::sine_at(const Star& star, std::size_t tet, const Vec3& p) const {
  std::array<Vec3, 4> c;
  for (std::size_t k = 0; k < 4; ++k) {
    const std::int32_t u = star.corners[tet][k];
    c[k] = u == star.v ? p : tets_.point(u);
  }
  return min_dihedral_sine(c[0], c[1], c[2], c[3]);
}

double GapOpener::lack(double sine) const {
  return sine < enough_ ? 1 / std::max(sine, kFlatSine) - 1 / enough_ : 0;
}

double GapOpener::lack_at(const Star& star, const Vec3& p, double floor) const {
  double sum = 0;
  for (std::size_t t = 0; t < star.corners.size(); ++t) {
    const double sine = sine_at(star, t, p);
    if (sine < floor) return kInfinity;
    sum += lack(sine);
  }
  return sum;
}

Vec3 GapOpener::descent(const Star& star, const Vec3& p, double step) const {
  constexpr double kNear = 1e-3;  // of the step: one of the six angles stays the smallest
  Vec3 gradient;
  for (std::size_t t = 0; t < star.corners.size(); ++t) {
    if (sine_at(star, t, p) >= enough_) continue;
    for (int axis = 0; axis < 3; ++axis) {
      Vec3 ahead = p, behind = p;
      ahead[axis] += kNear * step;
      behind[axis] -= kNear * step;
      gradient[axis] += lack(sine_at(star, t, ahead)) - lack(sine_at(star, t, behind));
    }
  }
  return -normalized(gradient);
}

Vec3 GapOpener::within_reach(const Star& star, const Vec3& p) const {
  if (!tets_.is_on_surface(star.v)) return p;
  const Vec3& home = home_[star.v];
  Vec3 shift = p - home;
  for (int axis = 0; axis < 3; ++axis)
    if (is_fixed_[star.v][axis]) shift[axis] = 0;
  const double way = norm(shift);
  return home + (way <= reach_ ? 1 : reach_ / way) * shift;
}

Vec3 GapOpener::find_place(const Star& star) const {
  constexpr int kDescents = 4, kHalvings = 5;
  const Vec3 start = tets_.point(star.v);
  Vec3 best = start;
  double least = lack_at(star, start, -kInfinity);
  const double floor = std::max(star.worst, kLeastSine), bound = (1 - kLeastGain) * least;
  const double longest = tets_.is_on_surface(star.v) ? reach_ : kInnerStep * star.edge;
  const auto attempt = [&](const Vec3& q) {
    const Vec3 p = within_reach(star, q);
    const double lack = lack_at(star, p, floor);
    if (!(lack < least)) return false;
    least = lack;
    best = p;
    return true;
  };
  for (int round = 0; round < kDescents && least > 0; ++round) {
    const Vec3 from = best, downhill = descent(star, from, longest);
    double step = longest;
    bool is_better = false;
    for (int halving = 0; halving < kHalvings && !is_better; ++halving, step /= 2)
      is_better = attempt(from + step * downhill);
    // In a valley the gradient only leads across.
    for (int axis = 0; axis < 3 && !is_better; ++axis)
      for (const double sign : {1.0, -1.0}) {
        Vec3 q = from;
        q[axis] += sign * longest / 4;
        is_better = attempt(q) || is_better;
      }
    if (!is_better) break;
  }
  if (!(least <= bound)) return start;
  // As far as it takes, and no farther.
  constexpr int kBisections = 4;
  double enough = 1, little = 0;
  for (int k = 0; k < kBisections && least == 0; ++k) {
    const double share = (enough + little) / 2;
    (lack_at(star, start + share * (best - start), floor) == 0 ? enough : little) = share;
  }
  return enough < 1 ? start + enough * (best - start) : best;
}

Vec3 GapOpener::allowed_place(const Star& star, const Vec3& p, Barred barred) {
  const Vec3 start = tets_.point(star.v);
  const double bound = (1 - kLeastGain) * lack_at(star, start, -kInfinity);
  const double floor = std::max(star.worst, kLeastSine);
  Vec3 place = p;
  for (int halving = 0; place != start; ++halving) {
    if (keeps_shapes(star, place) && is_free(star, place)) return place;
    if (barred == Barred::Stays || halving == kMostHalvingsOfWay) break;
    place = 0.5 * (start + place);
    if (!(lack_at(star, place, floor) <= bound)) break;
  }
  return start;
}

bool GapOpener::keeps_shapes(const Star& star, const Vec3& p) const {
  if (!tets_.is_on_surface(star.v)) return true;
  double before = kGoodShape, after = 1;
  for (const std::int32_t f : tets_.facets_at(star.v)) {
    std::array<Vec3, 3> c;
    for (std::size_t k = 0; k < 3; ++k)
      c[k] = tets_.point(tets_.surface().facets[f][k]);
    before = std::min(before, triangle_quality(c[0], c[1], c[2]));
    for (std::size_t k = 0; k < 3; ++k)
      if (tets_.surface().facets[f][k] == star.v) c[k] = p;
    after = std::min(after, triangle_quality(c[0], c[1], c[2]));
  }
  return after >= kLeastShapeKept * before;
}

std::optional<std::vector<OpenTets::Face>> GapOpener::outer_fan(std::int32_t v) const {
  std::vector<Face> facets;
  for (const std::int32_t f : tets_.facets_at(v)) {
    if (tets_.surface().patch_of[f].sides.outside != kExterior) continue;
    Face facet = tets_.surface().facets[f];
    while (facet[0] != v)
      std::rotate(facet.begin(), facet.begin() + 1, facet.end());
    facets.push_back(facet);
  }
  // Outer facets are oriented, so that one fan runs through all of them or there are several.
  std::vector<Face> fan;
  while (fan.size() < facets.size()) {
    const std::int32_t last = fan.empty() ? facets.front()[2] : fan.back()[2];
    const auto next = std::find_if(facets.begin(), facets.end(),
                                   [&](const Face& facet) { return facet[1] == last; });
    if (next == facets.end()) return std::nullopt;
    if (std::find(fan.begin(), fan.end(), *next) != fan.end()) return std::nullopt;
    fan.push_back(*next);
  }
  return fan;
}

bool GapOpener::keeps_outer_angles(const Star& star,
                                   const Vec3& p,
                                   const std::vector<Face>& fan) const {
  const auto filled_angle = [&](std::int32_t spoke, const Vec3& centre) {
    double sum = 0;
    for (const Tet& tet : star.corners) {
      if (std::find(tet.begin(), tet.end(), spoke) == tet.end()) continue;
      const Vec3 axis = normalized(tets_.point(spoke) - centre);
      std::array<Vec3, 2> sides;
      std::size_t count = 0;
      for (const std::int32_t u : tet)
        if (u != star.v && u != spoke) {
          const Vec3 way = tets_.point(u) - centre;
          sides[count++] = way - dot(way, axis) * axis;
        }
      sum += std::atan2(norm(cross(sides[0], sides[1])), dot(sides[0], sides[1]));
    }
    return sum;
  };
  return std::all_of(fan.begin(), fan.end(), [&](const Face& facet) {
    const double before = 2 * std::numbers::pi - filled_angle(facet[1], tets_.point(star.v));
    const double after = 2 * std::numbers::pi - filled_angle(facet[1], p);
    return after >= kOuterAngleKept * before;
  });
}

bool GapOpener::is_free(const Star& star, const Vec3& p) {
  if (!tets_.is_on_surface(star.v)) return true;
  const std::optional<std::vector<Face>> fan = outer_fan(star.v);
  if (!fan) return false;
  if (fan->empty()) return true;
  if (!keeps_outer_angles(star, p, *fan)) return false;
  points_.back() = p;
  const auto moved = [&](Face facet) {
    facet[0] = static_cast<std::int32_t>(points_.size() - 1);
    return facet;
  };
  for (std::size_t i = 0; i < fan->size(); ++i)
    for (std::size_t j = i + 1; j < fan->size(); ++j)
      if (facets_intersect(points_, moved((*fan)[i]), moved((*fan)[j]))) return false;
  if (!outer_) index_outer_facets();
  return std::all_of(fan->begin(), fan->end(),
                     [&](const Face& facet) { return is_swept_free(star.v, facet); });
}

/// The swept space is a tet: the facet before and after, and the ways of its two spokes. What is
/// inside has a corner there, or passes through one of these faces.
bool GapOpener::is_swept_free(std::int32_t v, const Face& facet) {
  const auto trial = static_cast<std::int32_t>(points_.size() - 1);
  const std::int32_t a = facet[1], b = facet[2];
  const std::array<Face, 3> faces{{{trial, a, b}, {v, trial, a}, {v, trial, b}}};
  const double clearance = kClearance * max_shift_;
  Box3 box = box_of(points_, facet);
  box.add(points_.back());
  box.lo -= Vec3{clearance, clearance, clearance};
  box.hi += Vec3{clearance, clearance, clearance};
  // Of facets that are nearer than the clearance already, half of what there is must stay.
  const auto comes_nearer = [&](const Face& other) {
    double kept = clearance;
    for (int halving = 0; halving < kClearanceHalvings; ++halving, kept /= 2)
      if (!are_facets_near(points_, facet, other, kept)) break;
    return are_facets_near(points_, faces[0], other, kept);
  };
  bool is_swept_free = true;
  outer_->query(box, [&](const FacetIndex::Entry& entry) {
    const Face& other = tets_.surface().facets[entry.id];
    if (!is_swept_free || holds(other, v)) return;
    for (const Face& face : faces)
      if (facets_intersect(points_, face, other)) is_swept_free = false;
    for (const std::int32_t u : other)
      if (u != a && u != b &&
          is_in_tet(points_[u], points_[v], points_.back(), points_[a], points_[b]))
        is_swept_free = false;
    if (comes_nearer(other)) is_swept_free = false;
  });
  return is_swept_free;
}

void GapOpener::index_outer_facets() {
  const InterfaceMesh& surface = tets_.surface();
  Box3 bounds;
  for (const Vec3& p : home_)
    bounds.add(p);
  bounds.lo -= Vec3{max_shift_, max_shift_, max_shift_};
  bounds.hi += Vec3{max_shift_, max_shift_, max_shift_};
  constexpr double kFacetsAcross = 200;  // of the longest side, roughly
  outer_.emplace(bounds, bounds.diagonal() / kFacetsAcross);
  for (std::size_t f = 0; f < surface.facets.size(); ++f)
    if (surface.patch_of[f].sides.outside == kExterior)
      outer_->insert(static_cast<std::int32_t>(f), box_of(points_, surface.facets[f]));
}

void GapOpener::move(const Star& star, const Vec3& p) {
  tets_.move_point(star.v, p, star.tets);
  tried_[star.v] = tets_.now();
  if (!tets_.is_on_surface(star.v)) return;
  points_[star.v] = p;
  if (!outer_) return;
  for (const std::int32_t f : tets_.facets_at(star.v)) {
    if (tets_.surface().patch_of[f].sides.outside != kExterior) continue;
    outer_->remove(f);
    outer_->insert(f, box_of(points_, tets_.surface().facets[f]));
  }
}

}  // namespace cvmesh
