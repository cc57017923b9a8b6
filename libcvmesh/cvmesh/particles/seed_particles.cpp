// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/core/error.h"
#include "cvmesh/core/parallel.h"
#include "cvmesh/core/random.h"
#include "cvmesh/particles/distribute_particles.h"
#include "cvmesh/particles/neighbour_tree.h"
#include "cvmesh/particles/place_curves.h"
#include "cvmesh/particles/sheets.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <numeric>
#include <string>
#include <utility>

namespace cvmesh {
namespace {

constexpr char kStage[] = "seed particles";
constexpr double kCandidatesPerParticle = 16;  // measured: more do not even out the sample
constexpr double kLeastCandidates = 256;       // of a sheet
// Disc radius over h. A saturated random sample of radius r holds about 0.70 / r^2 points per area
// and 2 / (sqrt 3 h^2) are wanted, which is reached at 0.78 h; wider discs first make it more even.
constexpr double kFirstRadius = 0.86, kShrink = 0.92, kLastRadius = 0.4;
constexpr double kSaturatedRadius = 0.776;
constexpr double kCurveClearanceVox = 0.1;  // inner particles are not on the rim

// What one sheet is to get.
struct SheetPlan {
  std::size_t natural = 0;  // by the sizing field
  std::size_t wanted = 0;   // with the guards
  double h_scale = 1;       // below 1 where a guard asks for more particles than the field
};

std::vector<SheetPlan> plan_sheets(const Sheets& sheets,
                                   const std::vector<std::vector<RimParticle>>& rims,
                                   int min_component_particles) {
  std::vector<SheetPlan> plans(sheets.sheets.size());
  std::map<std::vector<std::int32_t>, std::vector<std::size_t>> by_rim;
  for (std::size_t s = 0; s < plans.size(); ++s) {
    const Sheet& sheet = sheets.sheets[s];
    SheetPlan& plan = plans[s];
    const auto rounded = [&](double lattice_count) {
      return static_cast<std::size_t>(
          std::lround(natural_count(sheet, lattice_count, rims[s].size())));
    };
    plan.natural = rounded(sheet.field_count);
    plan.wanted = rounded(sheet.lattice_count);
    if (!sheet.is_closed) {
      std::vector<std::int32_t> rim;
      for (const RimParticle& r : rims[s])
        rim.push_back(r.particle);
      by_rim[rim].push_back(s);
      continue;
    }
    const auto least = std::min<std::size_t>(min_component_particles, sheet.vertex_count);
    if (plan.wanted >= least) continue;
    plan.wanted = least;
    plan.h_scale = std::sqrt(sheet.lattice_count / static_cast<double>(least));
  }
  for (const auto& [rim, group] : by_rim) {
    // One sheet of a group may stay without inner particles: the one with the fewest to come.
    std::size_t spared = group.front();
    for (const auto s : group)
      if (sheets.sheets[s].lattice_count < sheets.sheets[spared].lattice_count) spared = s;
    for (const auto s : group)
      if (plans[s].wanted == 0 && (rim.size() <= 3 || (group.size() > 1 && s != spared)))
        plans[s].wanted = 1;
  }
  return plans;
}

// Throws darts on one sheet.
class SheetSampler {
 public:
  SheetSampler(const Sheets& sheets,
               std::int32_t id,
               const std::vector<RimParticle>& rim,
               const std::vector<Particle>& rim_particles,
               const CounterRandom& random)
      : sheets_(sheets),
        sheet_(sheets.sheets[id]),
        clearance_(kCurveClearanceVox * sheets.voxel_mm()),
        random_(random) {
    for (const RimParticle& r : rim) {
      SurfacePoint p;
      p.position = rim_particles[r.particle].position;
      p.normal = r.normal;
      p.h_mm = rim_particles[r.particle].h_mm;
      placed_.push_back(p);
    }
    rim_size_ = placed_.size();
  }

  // Exactly `wanted` places, if the sheet has room for them.
  std::vector<SurfacePoint> poisson(std::size_t wanted, double h_scale) {
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

  // Uniform places about a voxel apart (closer where h is smaller), at least `least`.
  std::vector<SurfacePoint> dense(std::size_t least, double h_scale) {
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

 private:
  [[nodiscard]] std::size_t count() const { return placed_.size() - rim_size_; }

  [[nodiscard]] std::vector<SurfacePoint> inner() const {
    return {placed_.begin() + static_cast<std::ptrdiff_t>(rim_size_), placed_.end()};
  }

  [[nodiscard]] double size_at(const SurfacePoint& p) const {
    return std::min(max_h_, h_scale_ * p.h_mm);
  }

  // Candidates by the density 1 / h^2: whole numbers per facet, the fraction by chance.
  void scatter(double expected) {
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

  void add_candidate(std::int32_t f, double r1, double r2) {
    const auto& v = sheets_.domain().dense.facets[f];
    const auto& points = sheets_.domain().dense.points;
    const double root = std::sqrt(r1);  // uniform on the triangle
    const Vec3 p =
        (1 - root) * points[v[0]] + root * (1 - r2) * points[v[1]] + root * r2 * points[v[2]];
    const SurfacePoint candidate = sheets_.describe(f, p);
    if (candidate.curve_distance >= clearance_) candidates_.push_back(settled(candidate));
  }

  void throw_darts(double radius, std::size_t wanted) {
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
    const CounterRandom order(random_.bits(sheet_.facets.front()), kStage);
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
  [[nodiscard]] SurfacePoint settled(const SurfacePoint& candidate) const {
    const SurfacePoint projected = sheets_.move(candidate.facet, candidate.position);
    return projected.curve_distance >= clearance_ ? projected : candidate;
  }

  // For sheets too small for discs: the inner vertex, candidate or facet centre farthest from all.
  bool add_farthest() {
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

  const Sheets& sheets_;
  const Sheet& sheet_;
  double clearance_, h_scale_ = 1, max_h_ = 0;
  CounterRandom random_;
  std::vector<SurfacePoint> placed_, candidates_;  // placed_: the rim first
  std::vector<Vec3> positions_;                    // of the candidates
  std::size_t rim_size_ = 0;
};

}  // namespace

SeedParticlesResult seed_particles(const ParticleDomain& domain,
                                   const SeedParticlesOptions& options,
                                   const StageContext& context) {
  require(options.min_component_particles >= 4, ErrorCode::BadParameter, kStage,
          "min_component_particles (" + std::to_string(options.min_component_particles) +
              ") is below 4, the fewest vertices of a closed surface; use 4 or more");
  require(domain.sizing_field.h_mm.size() == domain.dense.points.size(), ErrorCode::Internal,
          kStage,
          "the sizing field has " + std::to_string(domain.sizing_field.h_mm.size()) +
              " values for " + std::to_string(domain.dense.points.size()) + " dense vertices");
  report_progress(context, kStage, 0);
  SeedParticlesResult result;
  auto& particles = result.particles.particles;
  particles = place_corners(domain);
  result.stats.corners = particles.size();
  const auto on_curves = place_curves(domain, particles);
  result.stats.curve_particles = on_curves.size();
  particles.insert(particles.end(), on_curves.begin(), on_curves.end());
  report_progress(context, kStage, 0.2);

  const Sheets sheets(domain);
  const auto rims = find_rims(sheets, particles);
  const auto plans = plan_sheets(sheets, rims, options.min_component_particles);
  const CounterRandom random(context.seed, kStage);
  std::vector<std::vector<SurfacePoint>> places(plans.size());
  report_progress(context, kStage, 0.4);
  parallel_for_each_index(
      0, plans.size(),
      [&](std::size_t s) {
        SheetSampler sampler(sheets, static_cast<std::int32_t>(s), rims[s], particles, random);
        places[s] = options.seeding == Seeding::Dense
                        ? sampler.dense(plans[s].wanted, plans[s].h_scale)
                        : sampler.poisson(plans[s].wanted, plans[s].h_scale);
      },
      1);

  std::vector<std::int32_t> order(plans.size());
  std::iota(order.begin(), order.end(), 0);
  std::stable_sort(order.begin(), order.end(), [&](std::int32_t a, std::int32_t b) {
    return sheets.sheets[a].patch < sheets.sheets[b].patch;
  });
  for (const auto s : order) {
    const SheetPlan& plan = plans[s];
    result.stats.expected_interface_particles += static_cast<double>(plan.natural);
    result.stats.interface_particles += places[s].size();
    for (std::size_t i = 0; i < places[s].size(); ++i) {
      Particle p;
      p.position = places[s][i].position;
      p.h_mm = plan.h_scale * places[s][i].h_mm;
      p.stratum = sheets.sheets[s].patch;
      p.carrier[0] = places[s][i].facet;
      if (i >= plan.natural && i < plan.wanted) p.origin = ParticleOrigin::Guard;
      particles.push_back(p);
    }
  }
  result.stats.guard_particles = static_cast<std::size_t>(
      std::count_if(particles.begin(), particles.end(),
                    [](const Particle& p) { return p.origin == ParticleOrigin::Guard; }));
  report_progress(context, kStage, 1);
  return result;
}

}  // namespace cvmesh
