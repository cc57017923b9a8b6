// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/particles/place_curves.h"

#include "cvmesh/core/parallel.h"
#include "cvmesh/mesh/neighbour_tree.h"
#include "cvmesh/particles/sheets.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <utility>

namespace cvmesh {
namespace {

constexpr double kHalfVoxel = 0.5;
constexpr double kLeastSpacingVox = 1e-3;
constexpr std::size_t kVerticesForFour = 8;   // a closed curve this long carries four particles
constexpr std::size_t kVerticesToSmooth = 8;  // shorter chains would shrink
// Height over length of an arc that its chord still stands for: that of a semicircle.
constexpr double kMostBend = 0.5;

Vec3 mix(const Vec3& a, const Vec3& b, double t) {
  return a + t * (b - a);
}

// What a junction curve solves: the interfaces that meet along it, inside the walls it lies in.
struct CurveEquations {
  std::vector<Sides> differences;
  std::array<bool, 3> is_fixed{false, false, false};
};

CurveEquations equations_of(const Strata::Curve& curve) {
  CurveEquations equations;
  std::vector<MaterialId> materials;
  for (const PatchKey& patch : curve.patches) {
    if (patch.wall != 0) {
      equations.is_fixed[(patch.wall - 1) / 2] = true;
      continue;
    }
    equations.differences.push_back(patch.sides);
    materials.push_back(patch.sides.inside);
    materials.push_back(patch.sides.outside);
  }
  std::sort(materials.begin(), materials.end());
  materials.erase(std::unique(materials.begin(), materials.end()), materials.end());
  // Interfaces ab, ac, bc: the third follows from the others.
  if (!materials.empty() && equations.differences.size() >= materials.size())
    equations.differences.resize(materials.size() - 1);
  return equations;
}

struct Chain {
  std::vector<Vec3> dense, smooth;  // of the vertices; a closed chain ends with its first again
  std::vector<double> h;
  std::vector<double> steps;  // integral of ds / h up to each vertex
  double length = 0;
};

Chain measure(const Strata::Curve& curve,
              const CurveEquations& equations,
              const ParticleDomain& domain,
              const std::map<std::int32_t, Vec3>& corner_at) {
  const double half_voxel = kHalfVoxel * domain.level_sets.frame().voxel_mm();
  Chain chain;
  for (const auto v : curve.vertices) {
    const Vec3 p = domain.dense.points[v];
    Vec3 q = p;
    const auto corner = corner_at.find(v);
    if (corner != corner_at.end())
      q = corner->second;
    else
      project_onto_zero(domain.level_sets, equations.differences, equations.is_fixed, half_voxel,
                        q);
    chain.dense.push_back(p);
    chain.smooth.push_back(q);
    chain.h.push_back(domain.sizing_field.h_mm[v]);
  }
  if (curve.is_closed) {
    chain.dense.push_back(chain.dense.front());
    chain.smooth.push_back(chain.smooth.front());
    chain.h.push_back(chain.h.front());
  }
  // Lengths come from a rounded copy: the zigzag of a lattice curve is not its length.
  std::vector<Vec3> rounded = chain.smooth;
  const std::size_t n = rounded.size();
  if (n >= kVerticesToSmooth) {
    for (std::size_t i = 1; i + 1 < n; ++i)
      rounded[i] = 0.25 * (chain.smooth[i - 1] + 2 * chain.smooth[i] + chain.smooth[i + 1]);
    if (curve.is_closed)
      rounded[0] = rounded[n - 1] =
          0.25 * (chain.smooth[n - 2] + 2 * chain.smooth[0] + chain.smooth[1]);
  }
  chain.steps.assign(n, 0);
  for (std::size_t i = 1; i < n; ++i) {
    const double ds = distance(rounded[i - 1], rounded[i]);
    chain.length += ds;
    // Trapezoid of 1 / h; h hardly changes over one dense edge.
    chain.steps[i] = chain.steps[i - 1] + 0.5 * ds * (1 / chain.h[i - 1] + 1 / chain.h[i]);
  }
  return chain;
}

int least_parts(const Strata::Curve& curve, bool has_twin) {
  if (curve.is_closed) return curve.vertices.size() >= kVerticesForFour ? 4 : 3;
  if (curve.vertices.front() == curve.vertices.back()) return 3;
  return has_twin ? 2 : 1;
}

// Open curves whose two end points another open curve joins as well.
std::vector<bool> find_twins(const std::vector<Strata::Curve>& curves) {
  std::map<std::pair<std::int32_t, std::int32_t>, int> count;
  const auto ends = [](const Strata::Curve& c) {
    return std::pair<std::int32_t, std::int32_t>(
        std::minmax(c.vertices.front(), c.vertices.back()));
  };
  for (const auto& c : curves)
    if (!c.is_closed) ++count[ends(c)];
  std::vector<bool> has_twin(curves.size());
  for (std::size_t i = 0; i < curves.size(); ++i)
    has_twin[i] = !curves[i].is_closed && count[ends(curves[i])] > 1;
  return has_twin;
}

// Where a particle is to be, between two vertices of a chain.
struct Stop {
  std::size_t segment = 0;
  double t = 0;
  ParticleOrigin origin = ParticleOrigin::Optimised;
};

Vec3 place_of(const Stop& stop, const Chain& chain) {
  return mix(chain.smooth[stop.segment], chain.smooth[stop.segment + 1], stop.t);
}

// At equal parts of the steps. Of an open chain without its ends.
std::vector<Stop> divide_evenly(const Chain& chain, bool is_closed, int natural, int parts) {
  const double total = chain.steps.back();
  std::vector<Stop> stops;
  std::size_t segment = 0;
  for (int k = is_closed ? 0 : 1; k < parts; ++k) {
    const double at = total * k / parts;
    while (segment + 2 < chain.steps.size() && chain.steps[segment + 1] < at)
      ++segment;
    const double range = chain.steps[segment + 1] - chain.steps[segment];
    const double t = range > 0 ? std::clamp((at - chain.steps[segment]) / range, 0.0, 1.0) : 0.5;
    const bool is_guard = k + natural - parts < (is_closed ? 0 : 1);
    stops.push_back({segment, t, is_guard ? ParticleOrigin::Guard : ParticleOrigin::Optimised});
  }
  return stops;
}

// Adds to `stops` guards between two places of a chain, until every chord stands for its arc
// [Douglas & Peucker 1973].
void guard_bends(const Chain& chain,
                 const Stop& begin,
                 const Stop& end,
                 double floor,
                 std::vector<Stop>& stops) {
  const Vec3 a = place_of(begin, chain), b = place_of(end, chain);
  double farthest = std::max(floor, kMostBend * distance(a, b));
  std::size_t at = 0;
  for (std::size_t v = begin.segment + 1; v <= end.segment; ++v) {
    const double away = distance(chain.smooth[v], nearest_on_segment(chain.smooth[v], a, b));
    if (away <= farthest) continue;
    farthest = away;
    at = v;
  }
  if (at == 0) return;
  const Stop bend{at, 0, ParticleOrigin::Bend};
  guard_bends(chain, begin, bend, floor, stops);
  stops.push_back(bend);
  guard_bends(chain, bend, end, floor, stops);
}

// `stops` with guards where a curve bends between them by too much for a chord.
std::vector<Stop> add_bends(const Chain& chain, double floor, const std::vector<Stop>& stops) {
  const Stop first, last{.segment = chain.smooth.size() - 2, .t = 1};
  std::vector<Stop> all;
  const Stop* before = &first;
  for (const Stop& stop : stops) {
    guard_bends(chain, *before, stop, floor, all);
    all.push_back(stop);
    before = &stop;
  }
  guard_bends(chain, *before, last, floor, all);
  return all;
}

std::vector<Particle> divide(std::int32_t id,
                             const Strata::Curve& curve,
                             bool has_twin,
                             const ParticleDomain& domain,
                             const std::map<std::int32_t, Vec3>& corner_at) {
  const double half_voxel = kHalfVoxel * domain.level_sets.frame().voxel_mm();
  const CurveEquations equations = equations_of(curve);
  const Chain chain = measure(curve, equations, domain, corner_at);
  const int natural = static_cast<int>(std::lround(chain.steps.back()));
  const int parts = std::max(natural, least_parts(curve, has_twin));
  const double part_mm = chain.length / parts;
  std::vector<Particle> particles;
  for (const Stop& stop :
       add_bends(chain, half_voxel, divide_evenly(chain, curve.is_closed, natural, parts))) {
    const auto& [segment, t, origin] = stop;
    const Vec3 a = chain.dense[segment], b = chain.dense[segment + 1];
    Particle particle;
    particle.dimension = 1;
    particle.stratum = id;
    particle.carrier[0] = curve.vertices[segment];
    particle.carrier[1] = curve.vertices[(segment + 1) % curve.vertices.size()];
    particle.h_mm = (1 - t) * chain.h[segment] + t * chain.h[segment + 1];
    particle.origin = origin;

    // On the solved curve, or on the dense edge where that would leave the edge or its neighbours.
    const Vec3 on_edge = mix(a, b, t);
    const auto is_near = [&](const Vec3& p) {
      return distance(p, nearest_on_segment(p, a, b)) <= half_voxel &&
             distance(p, on_edge) <= 0.45 * part_mm;
    };
    particle.position = place_of(stop, chain);
    if (!project_onto_zero(domain.level_sets, equations.differences, equations.is_fixed, half_voxel,
                           particle.position) ||
        !is_near(particle.position)) {
      particle.position = on_edge;
      particle.is_on_stratum = false;
    }
    particles.push_back(particle);
  }
  return particles;
}

Vec3 on_carrier(const Particle& p, const InterfaceMesh& dense) {
  const Vec3& a = dense.points[p.carrier[0]];
  return p.dimension == 0 ? a : nearest_on_segment(p.position, a, dense.points[p.carrier[1]]);
}

// Two curves may come so near that their solved points coincide; their dense edges never do.
void separate(std::vector<Particle>& particles,
              const std::vector<Particle>& corners,
              const ParticleDomain& domain) {
  std::vector<Vec3> places;
  for (const Particle& p : corners)
    places.push_back(p.position);
  for (const Particle& p : particles)
    places.push_back(p.position);
  const NeighbourTree tree(places);
  const double reach = kLeastSpacingVox * domain.level_sets.frame().voxel_mm();
  std::vector<std::int32_t> found;
  for (std::size_t i = 0; i < particles.size(); ++i) {
    tree.within(particles[i].position, reach, found);
    if (found.size() < 2) continue;
    particles[i].position = on_carrier(particles[i], domain.dense);
    particles[i].is_on_stratum = false;
  }
}

}  // namespace

std::vector<Particle> place_corners(const ParticleDomain& domain) {
  const InterfaceMesh& dense = domain.dense;
  std::map<std::int32_t, std::vector<PatchKey>> patches_at;
  for (std::size_t f = 0; f < dense.facets.size(); ++f)
    for (const auto v : dense.facets[f])
      if (domain.strata.dimension[v] == 0) patches_at[v].push_back(dense.patch_of[f]);
  std::vector<Particle> corners;
  for (const auto& [v, patches] : patches_at) {
    Particle particle;
    particle.position = dense.points[v];
    particle.h_mm = domain.sizing_field.h_mm[v];
    particle.dimension = 0;
    particle.stratum = particle.carrier[0] = v;
    std::vector<MaterialId> materials;
    bool is_on_wall = false;
    for (const PatchKey& patch : patches) {
      is_on_wall |= patch.wall != 0;
      materials.push_back(patch.sides.inside);
      materials.push_back(patch.sides.outside);
    }
    std::sort(materials.begin(), materials.end());
    materials.erase(std::unique(materials.begin(), materials.end()), materials.end());
    particle.is_on_stratum =
        !is_on_wall && materials.size() == 4 &&
        project_onto_zero(domain.level_sets,
                          {{materials[1], materials[0]},
                           {materials[2], materials[1]},
                           {materials[3], materials[2]}},
                          {false, false, false}, kHalfVoxel * domain.level_sets.frame().voxel_mm(),
                          particle.position);
    corners.push_back(particle);
  }
  return corners;
}

std::vector<Particle> place_curves(const ParticleDomain& domain,
                                   const std::vector<Particle>& corners) {
  std::map<std::int32_t, Vec3> corner_at;
  for (const Particle& c : corners)
    corner_at[c.carrier[0]] = c.position;
  const auto& curves = domain.strata.curves;
  const std::vector<bool> has_twin = find_twins(curves);
  std::vector<std::vector<Particle>> on_curve(curves.size());
  parallel_for_each_index(
      0, curves.size(),
      [&](std::size_t c) {
        on_curve[c] =
            divide(static_cast<std::int32_t>(c), curves[c], has_twin[c], domain, corner_at);
      },
      4);
  std::vector<Particle> particles;
  for (const auto& part : on_curve)
    particles.insert(particles.end(), part.begin(), part.end());
  separate(particles, corners, domain);
  return particles;
}

}  // namespace cvmesh
