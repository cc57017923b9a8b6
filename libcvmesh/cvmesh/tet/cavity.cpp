// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/tet/cavity.h"

#include "cvmesh/mesh/tet_faces.h"
#include "cvmesh/tet/tet_score.h"

#include <boost/container/small_vector.hpp>

#include <algorithm>
#include <limits>
#include <utility>

namespace cvmesh {
namespace {

using Face = OpenTets::Face;
using Tet = OpenTets::Tet;

constexpr std::int32_t kNone = OpenTets::kNone;
constexpr std::size_t kMaxCavity = 40;  // tets
/// Below this sine the sign of a volume is not certain in double precision.
constexpr double kLeastSine = 1e-9;

double wall_sine(const OpenTets& tets, const Face& face, const Vec3& p) {
  return min_dihedral_sine(tets.point(face[0]), tets.point(face[1]), tets.point(face[2]), p);
}

void add_to(const OpenTets& tets, Cavity& cavity, std::int32_t t, const Vec3& p) {
  cavity.tets.push_back(t);
  std::erase_if(cavity.walls, [&](const auto& w) { return tets.neighbour(w.tet, w.k) == t; });
  for (std::size_t k = 0; k < 4; ++k) {
    const std::int32_t n = tets.neighbour(t, k);
    if (n != kNone && std::find(cavity.tets.begin(), cavity.tets.end(), n) != cavity.tets.end())
      continue;
    const Face outward = tet_face(tets.tet(t), k);
    const Face face{outward[0], outward[2], outward[1]};
    cavity.walls.push_back({face, t, k, wall_sine(tets, face, p)});
  }
}

Cavity dig(const OpenTets& tets, std::int32_t t, const Vec3& p) {
  Cavity cavity, best;
  for (std::int32_t next = t; next != kNone && cavity.tets.size() < kMaxCavity;) {
    add_to(tets, cavity, next, p);
    const auto& wall =
        *std::min_element(cavity.walls.begin(), cavity.walls.end(),
                          [](const auto& v, const auto& w) { return v.sine < w.sine; });
    cavity.worst = wall.sine;
    if (wall.sine > best.worst) best = cavity;
    next = tets.neighbour(wall.tet, wall.k);
  }
  return best;
}

/// Every edge of the boundary in two walls: a ball as seen from p, with nothing pinched.
bool is_simple(const Cavity& cavity) {
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

/// Moves p to where the worst wall of the cavity is best.
void settle(const OpenTets& tets, Cavity& cavity, Vec3& p) {
  // Two walls at a time, the last one with itself where they are odd.
  boost::container::small_vector<BaseTerms<Vec3Pair>, 24> pairs;
  for (std::size_t n = 0; n < cavity.walls.size(); n += 2) {
    const Face& f = cavity.walls[n].face;
    const Face& g = cavity.walls[std::min(n + 1, cavity.walls.size() - 1)].face;
    const auto corners = [&](std::size_t k) {
      return Vec3Pair(tets.point(f[k]), tets.point(g[k]));
    };
    pairs.emplace_back(corners(0), corners(1), corners(2));
  }
  const auto worst_for = [&](const Vec3& q, double floor) {
    double worst = std::numeric_limits<double>::infinity();
    for (const BaseTerms<Vec3Pair>& pair : pairs) {
      const DoublePair sines = min_dihedral_sines(pair, q);
      worst = std::min({worst, sines[0], sines[1]});
      if (worst <= floor) break;
    }
    return worst;
  };
  double edge = 0;
  Vec3 middle;
  const double corners = 3 * static_cast<double>(cavity.walls.size());
  for (const auto& wall : cavity.walls)
    for (const std::int32_t v : wall.face) {
      edge += distance(tets.point(v), p) / corners;
      middle += tets.point(v) / corners;
    }
  cavity.worst = worst_for(p, -1);
  const auto attempt = [&](const Vec3& q) {
    const double sine = worst_for(q, cavity.worst);
    if (sine <= cavity.worst) return;
    cavity.worst = sine;
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
}

}  // namespace

std::vector<Tet> Cavity::tets_with(std::int32_t v) const {
  std::vector<Tet> made;
  made.reserve(walls.size());
  for (const Wall& wall : walls)
    made.push_back({wall.face[0], wall.face[1], wall.face[2], v});
  return made;
}

std::array<Vec3, 4> insertion_places(const OpenTets& tets, std::int32_t t) {
  const Tet& tet = tets.tet(t);
  Vec3 centroid, around, away;
  double count = 0, size = 0;
  for (std::size_t k = 0; k < 4; ++k) {
    centroid += tets.point(tet[k]) / 4;
    size += distance(tets.point(tet[k]), tets.point(tet[(k + 1) % 4])) / 4;
    const std::int32_t n = tets.neighbour(t, k);
    if (n == kNone) {
      const Face face = tet_face(tet, k);
      away -=
          normalized(area_vector2(tets.point(face[0]), tets.point(face[1]), tets.point(face[2])));
      continue;
    }
    for (const std::int32_t v : tets.tet(n))
      around += tets.point(v);
    count += 4;
  }
  if (count > 0) around *= 1 / count;
  return {centroid, around, centroid + 0.6 * size * normalized(away),
          centroid + 0.25 * size * normalized(away)};
}

Cavity dig_cavity(const OpenTets& tets, std::int32_t t, Vec3& p) {
  Cavity cavity = dig(tets, t, p);
  if (cavity.walls.empty()) return {};
  // Once more from the better place.
  settle(tets, cavity, p);
  cavity = dig(tets, t, p);
  if (cavity.worst <= kLeastSine || !is_simple(cavity)) return {};
  settle(tets, cavity, p);
  return cavity;
}

}  // namespace cvmesh
