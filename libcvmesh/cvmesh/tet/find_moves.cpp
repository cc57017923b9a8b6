// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/tet/find_moves.h"

#include "cvmesh/mesh/tet_faces.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <utility>

namespace cvmesh {
namespace {

using Tet = OpenTets::Tet;

}  // namespace

void MoveFinder::gather(std::int32_t v, Star& star) const {
  tets_.find_star(v, star.tets);
  std::sort(star.tets.begin(), star.tets.end(), [&](std::int32_t s, std::int32_t t) {
    return std::pair(tets_.score(s).min_sine, s) < std::pair(tets_.score(t).min_sine, t);
  });
  star.corners.clear();
  star.scores.clear();
  for (const std::int32_t t : star.tets) {
    const Tet& tet = star.corners.emplace_back(tets_.tet(t));
    const auto k = static_cast<std::size_t>(std::find(tet.begin(), tet.end(), v) - tet.begin());
    const auto& [a, b, c] = kTetFaces[k];
    star.scores.add(tets_.point(tet[a]), tets_.point(tet[b]), tets_.point(tet[c]));
  }
  star.quality = quality_of(tets_, star.tets);
}

MoveFinder::Move MoveFinder::find_move(std::int32_t v, int halvings, Star& star) const {
  gather(v, star);
  if (star.tets.empty()) return {};
  Vec3 centroid, escape;
  double weight = 0, edge = 0;
  for (const Tet& tet : star.corners) {
    const double volume = std::abs(volume6(tets_.point(tet[0]), tets_.point(tet[1]),
                                           tets_.point(tet[2]), tets_.point(tet[3])));
    for (const std::int32_t u : tet) {
      centroid += volume / 4 * tets_.point(u);
      edge +=
          distance(tets_.point(u), tets_.point(v)) / (3 * static_cast<double>(star.tets.size()));
    }
    weight += volume;
  }
  if (!(weight > 0)) return {};
  centroid *= 1 / weight;
  for (std::size_t k = 0; k < 4; ++k)
    if (star.corners[0][k] == v) {
      const Tet& worst = star.corners[0];
      const auto& [f, g, h] = kTetFaces[k];
      escape = -normalized(
          area_vector2(tets_.point(worst[f]), tets_.point(worst[g]), tets_.point(worst[h])));
    }

  TetQuality reached = star.quality;
  Move best{false, tets_.point(v)};
  const auto attempt = [&](const Vec3& p) {
    const TetQuality quality = star.scores.quality_at(p, goal_.capped(reached.worst));
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

}  // namespace cvmesh
