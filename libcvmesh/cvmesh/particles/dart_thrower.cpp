// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/particles/dart_thrower.h"

#include "cvmesh/mesh/neighbour_tree.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <utility>

namespace cvmesh {
namespace {

constexpr char kOrder[] = "darts";
constexpr double kCandidatesPerParticle = 16;  // measured: more do not even out the sample
constexpr double kLeastCandidates = 256;       // of a sheet
// Disc radius over h. A saturated random sample of radius r holds about 0.70 / r^2 points per area
// and 2 / (sqrt 3 h^2) are wanted, which is reached at 0.78 h; wider discs first make it more even.
constexpr double kFirstRadius = 0.86, kShrink = 0.92, kLastRadius = 0.4;
constexpr double kSaturatedRadius = 0.776;

}  // namespace

DartThrower::DartThrower(const Sheets& sheets,
                         const Sheet& sheet,
                         std::vector<SurfacePoint> rim,
                         double clearance_mm,
                         const CounterRandom& random)
    : sheets_(sheets),
      sheet_(sheet),
      clearance_(clearance_mm),
      random_(random),
      placed_(std::move(rim)),
      rim_size_(placed_.size()) {}

std::vector<SurfacePoint> DartThrower::by_size(std::size_t wanted, double h_scale) {
  if (wanted == 0) return {};
  h_scale_ = h_scale;
  max_h_ = std::numeric_limits<double>::infinity();
  scatter(static_cast<double>(wanted));
  for (double r = kFirstRadius; r > kLastRadius && count() < wanted; r *= kShrink)
    throw_darts(r, wanted);
  while (count() < wanted && add_farthest()) {
  }
  return inner();
}

std::vector<SurfacePoint> DartThrower::dense(std::size_t least, double h_scale) {
  h_scale_ = h_scale;
  max_h_ = sheets_.voxel_mm();
  double expected = 0;
  for (const auto f : sheet_.facets) {
    const double h = std::min(max_h_, h_scale_ * sheets_.facet_h(f));
    expected += 2 / std::sqrt(3.0) * sheets_.facet_area(f) / (h * h);
  }
  scatter(expected);
  throw_darts(kSaturatedRadius, std::numeric_limits<std::size_t>::max());
  while (count() < least && add_farthest()) {
  }
  return inner();
}

// Candidates by the density 1 / h^2: whole numbers per facet, the fraction by chance.
void DartThrower::scatter(double expected) {
  const double total = std::max(kCandidatesPerParticle * expected, kLeastCandidates);
  std::vector<double> share(sheet_.facets.size());
  for (std::size_t i = 0; i < share.size(); ++i) {
    const double h = std::min(max_h_, h_scale_ * sheets_.facet_h(sheet_.facets[i]));
    share[i] = sheets_.facet_area(sheet_.facets[i]) / (h * h);
  }
  const double sum = std::accumulate(share.begin(), share.end(), 0.0);
  for (std::size_t i = 0; i < share.size(); ++i) {
    const auto f = sheet_.facets[i];
    const double here = total * share[i] / sum + random_.uniform(f, 0);
    for (std::uint64_t c = 0; c < static_cast<std::uint64_t>(here); ++c)
      add_candidate(f, random_.uniform(f, 2 * c + 1), random_.uniform(f, 2 * c + 2));
  }
  positions_.reserve(candidates_.size());
  for (const auto& c : candidates_)
    positions_.push_back(c.position);
}

void DartThrower::add_candidate(std::int32_t f, double r1, double r2) {
  const auto& v = sheets_.domain().dense.facets[f];
  const auto& points = sheets_.domain().dense.points;
  const double root = std::sqrt(r1);  // uniform on the triangle
  const Vec3 p =
      (1 - root) * points[v[0]] + root * (1 - r2) * points[v[1]] + root * r2 * points[v[2]];
  const SurfacePoint candidate = sheets_.describe(f, p);
  if (candidate.curve_distance >= clearance_) candidates_.push_back(settled(candidate));
}

void DartThrower::throw_darts(double radius, std::size_t wanted) {
  const NeighbourTree tree(positions_);
  std::vector<std::uint8_t> is_covered(candidates_.size(), 0);
  std::vector<std::int32_t> found;
  const auto cover = [&](const SurfacePoint& p) {
    const double h = size_at(p);
    // Where h grows with slope delta the mean of both h reaches farther.
    const double slope = std::min(sheets_.domain().sizing_field.delta, 1.0);
    tree.within(p.position, radius * h / (1 - 0.5 * radius * slope), found);
    for (const auto c : found)
      if (is_covered[c] == 0 && dot(p.normal, candidates_[c].normal) > 0 &&
          distance(p.position, positions_[c]) < 0.5 * radius * (h + size_at(candidates_[c])))
        is_covered[c] = 1;
  };
  for (const auto& p : placed_)
    cover(p);
  const CounterRandom order(random_.bits(sheet_.facets.front()), kOrder);
  for (const auto c : order.permutation(candidates_.size())) {
    if (count() >= wanted) return;
    if (is_covered[c] != 0) continue;
    placed_.push_back(candidates_[c]);
    cover(placed_.back());
    is_covered[c] = 1;
  }
}

// The candidate on the zero set; on its facet where the projection comes too near to the rim. All
// candidates are projected, not just those that are taken: where h is below a voxel, places far
// apart on the dense surface can have nearly the same projection.
SurfacePoint DartThrower::settled(const SurfacePoint& candidate) const {
  const SurfacePoint projected = sheets_.move(candidate.facet, candidate.position);
  return projected.curve_distance >= clearance_ ? projected : candidate;
}

// For sheets too small for discs: the inner vertex, candidate or facet centre farthest from all.
bool DartThrower::add_farthest() {
  std::vector<SurfacePoint> choices = candidates_;
  for (const auto f : sheet_.facets) {
    const auto& v = sheets_.domain().dense.facets[f];
    const auto& points = sheets_.domain().dense.points;
    choices.push_back(sheets_.describe(f, (points[v[0]] + points[v[1]] + points[v[2]]) / 3));
    for (const auto w : v)
      if (sheets_.domain().strata.dimension[w] == 2)
        choices.push_back(sheets_.describe(f, points[w]));
  }
  double best = sheets_.voxel_mm() * 1e-2;
  const SurfacePoint* chosen = nullptr;
  for (const auto& c : choices) {
    double nearest = std::min(c.curve_distance, std::numeric_limits<double>::max());
    for (const auto& p : placed_)
      nearest = std::min(nearest, distance(p.position, c.position));
    if (nearest > best) {
      best = nearest;
      chosen = &c;
    }
  }
  if (chosen == nullptr) return false;
  placed_.push_back(*chosen);
  return true;
}

}  // namespace cvmesh
