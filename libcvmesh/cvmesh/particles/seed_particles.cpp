// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/core/error.h"
#include "cvmesh/core/parallel.h"
#include "cvmesh/core/random.h"
#include "cvmesh/particles/advance_front.h"
#include "cvmesh/particles/dart_thrower.h"
#include "cvmesh/particles/distribute_particles.h"
#include "cvmesh/particles/place_curves.h"
#include "cvmesh/particles/sheets.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <numeric>
#include <string>
#include <utility>

namespace cvmesh {
namespace {

constexpr char kStage[] = "seed particles";
constexpr double kCurveClearanceVox = 0.1;  // inner particles are not on the rim
constexpr std::size_t kLeastFront = 64;     // particles; a front has no room to grow for fewer

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
      return static_cast<std::size_t>(std::lround(natural_count(sheet, lattice_count, rims[s])));
    };
    plan.natural = rounded(sheet.field_count);
    plan.wanted = std::max(plan.natural, rounded(sheet.lattice_count));
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

// Up to `most` of the places, those where h was lowered most against the sizing field.
std::vector<std::size_t> most_lowered(const Sheets& sheets,
                                      const std::vector<SurfacePoint>& places,
                                      std::size_t most) {
  if (most == 0) return {};
  const auto& dense = sheets.domain().dense;
  const auto& field = sheets.domain().sizing_field.h_mm;
  std::vector<double> share(places.size());
  for (std::size_t n = 0; n < places.size(); ++n) {
    const auto& v = dense.facets[places[n].facet];
    share[n] = places[n].h_mm / ((field[v[0]] + field[v[1]] + field[v[2]]) / 3);
  }
  std::vector<std::size_t> order(places.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::stable_sort(order.begin(), order.end(),
                   [&](std::size_t a, std::size_t b) { return share[a] < share[b]; });
  order.resize(std::min(order.size(), most));
  return order;
}

// The first places on one sheet.
std::vector<SurfacePoint> cover(const Sheets& sheets,
                                std::size_t id,
                                const SheetPlan& plan,
                                const std::vector<RimParticle>& rim_particles,
                                Seeding seeding,
                                const CounterRandom& random) {
  const Sheet& sheet = sheets.sheets[id];
  const double clearance = kCurveClearanceVox * sheets.voxel_mm();
  std::vector<SurfacePoint> rim;
  for (const RimParticle& r : rim_particles)
    rim.push_back(r.place);
  if (seeding == Seeding::Front && plan.wanted >= kLeastFront)
    return advance_front(sheets, sheet, rim, plan.h_scale, clearance, random);
  DartThrower darts(sheets, sheet, std::move(rim), clearance, random);
  return seeding == Seeding::Dense ? darts.dense(plan.wanted, plan.h_scale)
                                   : darts.by_size(plan.wanted, plan.h_scale);
}

}  // namespace

SeedParticlesResult seed_particles(const Sheets& sheets,
                                   const SeedParticlesOptions& options,
                                   const StageContext& context) {
  require(options.min_component_particles >= 4, ErrorCode::BadParameter, kStage,
          "min_component_particles (" + std::to_string(options.min_component_particles) +
              ") is below 4, the fewest vertices of a closed surface; use 4 or more");
  report_progress(context, kStage, 0);
  SeedParticlesResult result;
  auto& particles = result.particles.particles;
  particles = place_corners(sheets.domain());
  result.stats.corners = particles.size();
  const auto on_curves = place_curves(sheets.domain(), particles);
  result.stats.curve_particles = on_curves.size();
  particles.insert(particles.end(), on_curves.begin(), on_curves.end());
  for (const Particle& p : particles)
    if (!p.is_on_stratum)
      ++(p.dimension == 0 ? result.stats.on_dense_corner : result.stats.on_dense_curve);
  report_progress(context, kStage, 0.2);

  const auto rims = find_rims(sheets, particles);
  const auto plans = plan_sheets(sheets, rims, options.min_component_particles);
  const CounterRandom random(context.seed, kStage);
  std::vector<std::vector<SurfacePoint>> places(plans.size());
  report_progress(context, kStage, 0.4);
  std::vector<std::int32_t> order(plans.size());
  std::iota(order.begin(), order.end(), 0);
  // The largest first: it may take as long as all others.
  std::stable_sort(order.begin(), order.end(), [&](std::int32_t a, std::int32_t b) {
    return plans[a].wanted > plans[b].wanted;
  });
  parallel_for_each_index(
      0, order.size(),
      [&](std::size_t n) {
        const auto s = static_cast<std::size_t>(order[n]);
        places[s] = cover(sheets, s, plans[s], rims[s], options.seeding, random);
      },
      1);

  std::iota(order.begin(), order.end(), 0);
  std::stable_sort(order.begin(), order.end(), [&](std::int32_t a, std::int32_t b) {
    return sheets.sheets[a].patch < sheets.sheets[b].patch;
  });
  for (const auto s : order) {
    const SheetPlan& plan = plans[s];
    result.stats.expected_interface_particles += static_cast<double>(plan.natural);
    result.stats.interface_particles += places[s].size();
    const auto first = particles.size();
    for (const SurfacePoint& place : places[s]) {
      Particle p;
      p.position = place.position;
      p.h_mm = plan.h_scale * place.h_mm;
      p.stratum = sheets.sheets[s].patch;
      p.carrier[0] = place.facet;
      particles.push_back(p);
    }
    // The guards are those where h was lowered most.
    for (const auto n : most_lowered(sheets, places[s], plan.wanted - plan.natural))
      particles[first + n].origin = ParticleOrigin::Guard;
  }
  result.stats.guard_particles = static_cast<std::size_t>(
      std::count_if(particles.begin(), particles.end(),
                    [](const Particle& p) { return p.origin != ParticleOrigin::Optimised; }));
  report_progress(context, kStage, 1);
  return result;
}

}  // namespace cvmesh
