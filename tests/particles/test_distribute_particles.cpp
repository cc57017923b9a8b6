// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/core/error.h"
#include "cvmesh/core/median.h"
#include "cvmesh/particles/distribute_particles.h"
#include "cvmesh/particles/particle_energy.h"
#include "cvmesh/particles/place_curves.h"
#include "cvmesh/particles/short_loops.h"

#include <tbb/global_control.h>
#include <tbb/task_arena.h>

#include "particles/analytic_domain.h"
#include "support/catch.h"
#include <atomic>
#include <numeric>
#include <set>
#include <string>

using namespace cvmesh;
using namespace cvmesh::test_particles;

namespace {

std::function<double(const Vec3&)> constant(double h) {
  return [h](const Vec3&) { return h; };
}

std::vector<Particle> of_dimension(const ParticleSet& set, int dimension) {
  std::vector<Particle> found;
  for (const Particle& p : set.particles)
    if (p.dimension == dimension) found.push_back(p);
  return found;
}

DistributeParticlesResult distribute(const AnalyticDomain& domain,
                                     Seeding seeding = Seeding::Front,
                                     std::uint64_t seed = 1) {
  const auto context = silent_context(seed);
  const Sheets sheets(domain.view());
  auto seeds = seed_particles(sheets, {.seeding = seeding}, context);
  return distribute_particles(std::move(seeds.particles), sheets, {}, context);
}

double least_distance(const ParticleSet& set) {
  double least = std::numeric_limits<double>::infinity();
  for (std::size_t i = 0; i < set.particles.size(); ++i)
    for (std::size_t j = 0; j < i; ++j)
      least = std::min(least, distance(set.particles[i].position, set.particles[j].position));
  return least;
}

// What insertion relies on, see `Particle`.
void check_carriers(const ParticleSet& set, const AnalyticDomain& domain) {
  const auto& dense = domain.dense;
  const double voxel = domain.level_sets.frame().voxel_mm();
  for (std::size_t i = 0; i < set.particles.size(); ++i) {
    const Particle& p = set.particles[i];
    CAPTURE(i, int(p.dimension), p.carrier[0], p.carrier[1]);
    if (i > 0) {
      const Particle& q = set.particles[i - 1];
      REQUIRE(std::pair(q.dimension, q.stratum) <= std::pair(p.dimension, p.stratum));
    }
    REQUIRE(p.h_mm > 0);
    REQUIRE(p.carrier[0] >= 0);
    Vec3 nearest;
    if (p.dimension == 0) {
      REQUIRE(domain.strata.dimension[p.carrier[0]] == 0);
      REQUIRE(p.stratum == p.carrier[0]);
      nearest = dense.points[p.carrier[0]];
    } else if (p.dimension == 1) {
      const auto& chain = domain.strata.curves[p.stratum].vertices;
      const auto at = std::find(chain.begin(), chain.end(), p.carrier[0]) - chain.begin();
      REQUIRE(std::size_t(at) < chain.size());
      REQUIRE(chain[(std::size_t(at) + 1) % chain.size()] == p.carrier[1]);
      nearest =
          nearest_on_segment(p.position, dense.points[p.carrier[0]], dense.points[p.carrier[1]]);
    } else {
      REQUIRE(domain.strata.patch_of[p.carrier[0]] == p.stratum);
      const auto& v = dense.facets[p.carrier[0]];
      nearest = nearest_on_triangle(p.position, dense.points[v[0]], dense.points[v[1]],
                                    dense.points[v[2]]);
    }
    REQUIRE(distance(p.position, nearest) <= 0.5 * voxel * (1 + 1e-9));
  }
}

}  // namespace

TEST_CASE("particle_energy: six neighbours at h give the ideal energy, and derivatives agree",
          "[particles][unit]") {
  namespace energy = particle_energy;
  CHECK(6 * energy::pair(energy::kScale) == Approx(energy::kIdeal));
  CHECK(energy::pair(1.0) == 0);
  for (const double d : {0.2, 0.5, 0.9}) {
    const double e = 1e-5;
    CHECK((energy::pair(d + e) - energy::pair(d - e)) / (2 * e) ==
          Approx(energy::slope(d)).epsilon(1e-5));
    CHECK((energy::slope(d + e) - energy::slope(d - e)) / (2 * e) ==
          Approx(energy::curvature(d)).epsilon(1e-5));
  }
}

TEST_CASE("find_star: hexagon neighbours, the second ring left out, the hole of a missing one",
          "[particles][unit]") {
  std::vector<Vec3> offsets;
  for (int k = 0; k < 6; ++k) {
    const double angle = std::numbers::pi / 3 * k;
    offsets.push_back({std::cos(angle), std::sin(angle), 0});
    offsets.push_back({2 * std::cos(angle), 2 * std::sin(angle), 0});
  }
  const auto full = particle_energy::find_star(offsets, {0, 0, 1});
  CHECK(full.is_closed);
  CHECK(full.ring.size() == 6);
  CHECK(full.hole_radius == Approx(1 / std::sqrt(3.0)));
  offsets.erase(offsets.begin());  // now the one behind it is the neighbour
  const auto holed = particle_energy::find_star(offsets, {0, 0, 1});
  CHECK(holed.hole_radius == Approx(1.0));
  CHECK(holed.hole_centre.x == Approx(1.0));
  // All neighbours on one side: a rim.
  const std::vector<Vec3> half{{1, 0, 0}, {0.7, 0.7, 0}, {0, 1, 0}};
  CHECK_FALSE(particle_energy::find_star(half, {0, 0, 1}).is_closed);
}

TEST_CASE("distribute_particles: equal spacing h on a sphere, as many as its area holds",
          "[particles][unit]") {
  const double radius = 20, h = 2.5;
  const auto domain = ball(radius, 40, constant(h));
  const auto result = distribute(domain);
  check_carriers(result.particles, domain);
  const double area = 4 * std::numbers::pi * radius * radius;
  const double expected = 2 / std::sqrt(3.0) * area / (h * h);
  CHECK(double(result.particles.particles.size()) == Approx(expected).epsilon(0.02));
  CHECK(result.stats.edge_over_h_mean == Approx(1.0).margin(0.04));
  CHECK(result.stats.edge_over_h_sd < 0.12);
  CHECK(result.stats.nearest_over_h_mean > 0.9);
  CHECK(result.stats.six_neighbour_share > 0.8);
  CHECK(result.stats.edge_over_h_min > 0.6);
  CHECK(result.stats.edge_over_h_max < 1.6);
  CHECK(least_distance(result.particles) > 0.6 * h);
  CHECK(result.stats.energy.back() < result.stats.energy.front());
  CHECK(int(result.stats.energy.size()) == result.stats.sweeps);
}

TEST_CASE("distribute_particles: particles lie on the zero set, within a thousandth of a voxel",
          "[particles][unit]") {
  const auto domain = halved_ball(20, 32, constant(3));
  const auto result = distribute(domain);
  check_carriers(result.particles, domain);
  CHECK(result.stats.on_dense_facet <= result.particles.particles.size() / 100);
  std::size_t off = 0;
  for (const Particle& p : of_dimension(result.particles, 2)) {
    const Sides sides = domain.strata.patches[p.stratum].sides;
    const auto sample =
        domain.level_sets.sample_difference(sides.inside, sides.outside, p.position);
    off += std::abs(sample.value) > 1e-3 * norm(sample.gradient);
  }
  CHECK(off == result.stats.on_dense_facet);
  for (const Particle& p : of_dimension(result.particles, 1)) {
    for (const Sides sides : {Sides{1, 0}, Sides{2, 0}, Sides{2, 1}}) {
      const auto sample =
          domain.level_sets.sample_difference(sides.inside, sides.outside, p.position);
      CHECK(std::abs(sample.value) <= 1e-3 * norm(sample.gradient));
    }
  }
}

TEST_CASE("distribute_particles: spacing follows a graded h", "[particles][unit]") {
  const auto domain = ball(20, 64, [](const Vec3& p) { return 1.0 + 0.15 * p.z; });
  const auto result = distribute(domain);
  CHECK(result.stats.edge_over_h_mean == Approx(1.0).margin(0.05));
  CHECK(result.stats.edge_over_h_sd < 0.14);
  // The integral of dA / h^2 over the sphere, z from 4 to 44 around 24.
  const double integral =
      2 * std::numbers::pi * 20 / 0.15 * (1 / (1 + 0.15 * 4) - 1 / (1 + 0.15 * 44));
  CHECK(double(result.particles.particles.size()) ==
        Approx(2 / std::sqrt(3.0) * integral).epsilon(0.03));
  for (const Particle& p : result.particles.particles)
    CHECK(p.h_mm == Approx(1.0 + 0.15 * p.position.z).epsilon(0.05));
}

TEST_CASE("seed_particles: a closed curve is divided evenly by the integral of ds over h",
          "[particles][unit]") {
  const auto domain = halved_ball(20, 32, constant(3));
  const auto context = silent_context();
  const auto seeds = seed_particles(Sheets(domain.view()), {}, context);
  const auto on_curve = of_dimension(seeds.particles, 1);
  const double length = 2 * std::numbers::pi * 20;
  REQUIRE(on_curve.size() == std::size_t(std::lround(length / 3)));
  CHECK(seeds.stats.curve_particles == on_curve.size());
  const double step = 2 * 20 * std::sin(std::numbers::pi / double(on_curve.size()));
  for (std::size_t i = 0; i < on_curve.size(); ++i)
    CHECK(distance(on_curve[i].position, on_curve[(i + 1) % on_curve.size()].position) ==
          Approx(step).epsilon(0.02));
}

TEST_CASE("place_curves: a curve between two corners gets a particle where it bends too far",
          "[particles][unit]") {
  // One edge of a box becomes an arch, z = 4 height s (1 - s); h asks for no particle on it.
  const int n = 9;
  const double lo = -0.5;
  const auto arched = [&](double height) {
    AnalyticDomain domain = full_box(n, 16, constant(100));
    for (Vec3& p : domain.dense.points)
      if (p.y == lo && p.z == lo) p.z += 4 * height * (p.x - lo) / n * (1 - (p.x - lo) / n);
    return domain;
  };
  const auto low = arched(0.45 * n);
  CHECK(place_curves(low.view(), place_corners(low.view())).empty());

  const auto high = arched(0.55 * n);
  const auto corners = place_corners(high.view());
  auto particles = place_curves(high.view(), corners);
  REQUIRE(particles.size() == 1);
  CHECK(particles[0].origin == ParticleOrigin::Bend);
  CHECK(particles[0].position == Vec3{lo + 0.5 * n, lo, lo + 0.55 * n});

  // The sheets around get as many particles as without it.
  particles.insert(particles.begin(), corners.begin(), corners.end());
  const Sheets sheets(high.view());
  const auto with = find_rims(sheets, particles), without = find_rims(sheets, corners);
  int count = 0;
  for (std::size_t s = 0; s < sheets.sheets.size(); ++s) {
    CHECK(natural_count(sheets.sheets[s], 10, with[s]) ==
          natural_count(sheets.sheets[s], 10, without[s]));
    count += static_cast<int>(with[s].size() - without[s].size());
  }
  CHECK(count == 2);
}

TEST_CASE("distribute_particles: corners and curve particles do not move", "[particles][unit]") {
  for (const auto& domain : {halved_ball(12, 16, constant(2)), full_box(13, 20, constant(2))}) {
    const auto context = silent_context();
    const auto seeds = seed_particles(Sheets(domain.view()), {}, context);
    const auto result = distribute_particles(seeds.particles, Sheets(domain.view()), {}, context);
    for (std::size_t i = 0; i < seeds.particles.particles.size(); ++i) {
      const Particle& before = seeds.particles.particles[i];
      if (before.dimension == 2) break;
      CHECK(result.particles.particles[i].position == before.position);
      CHECK(result.particles.particles[i].carrier[0] == before.carrier[0]);
    }
  }
}

TEST_CASE("distribute_particles: on the border of the image points keep to planes and edges",
          "[particles][unit]") {
  const int n = 21;
  const auto domain = full_box(n, 30, constant(3));
  const auto result = distribute(domain);
  check_carriers(result.particles, domain);
  const auto corners = of_dimension(result.particles, 0);
  CHECK(corners.size() == 8);
  // Edges of 21 mm in seven parts.
  CHECK(of_dimension(result.particles, 1).size() == 12 * 6);
  const auto on_border = [n](double x) { return x == -0.5 || x == n - 0.5; };
  for (const Particle& p : result.particles.particles) {
    int count = 0;
    for (int axis = 0; axis < 3; ++axis)
      count += on_border(p.position[axis]) ? 1 : 0;
    CHECK(count == 3 - int(p.dimension));
  }
  // Six flat squares: n^2 2 / sqrt 3 / h^2 - rim / 2 + 1 each.
  const double per_wall = 2 / std::sqrt(3.0) * 49 - 14 + 1;
  CHECK(double(of_dimension(result.particles, 2).size()) == Approx(6 * per_wall).margin(6));
  CHECK(least_distance(result.particles) > 0.5 * 3);
}

TEST_CASE("seed_particles: small closed components get their guards, evenly spread",
          "[particles][unit]") {
  const Vec3 a{14, 14, 14}, b{30, 30, 30};
  const auto domain = ellipsoids(40, {{a, {8, 8, 8}, 16}, {b, {1.5, 1.5, 1.5}, 1}}, constant(30));
  const auto context = silent_context();
  const auto seeds = seed_particles(Sheets(domain.view()), {}, context);
  std::size_t at_a = 0, at_b = 0;
  for (const Particle& p : seeds.particles.particles)
    (distance(p.position, a) < 10 ? at_a : at_b) += 1;
  CHECK(at_a == 12);
  CHECK(at_b == 6);  // an octahedron has no more dense vertices
  CHECK(seeds.stats.guard_particles >= 12 + 6 - 3);
  const auto result = distribute_particles(seeds.particles, Sheets(domain.view()), {}, context);
  check_carriers(result.particles, domain);
  CHECK(result.particles.particles.size() == 18);
  std::vector<Particle> around_a;
  for (const Particle& p : result.particles.particles)
    if (distance(p.position, a) < 10) around_a.push_back(p);
  // Twelve on a sphere: close to the icosahedron's edge of 1.05 radii.
  CHECK(least_distance({around_a}) > 0.85 * 8);
  CHECK(least_distance(result.particles) > 0.5);
}

TEST_CASE("seed_particles: of the three discs of a halved ball two get an inner particle",
          "[particles][unit]") {
  const auto domain = halved_ball(3, 6, constant(20));
  const auto context = silent_context();
  const auto seeds = seed_particles(Sheets(domain.view()), {}, context);
  CHECK(of_dimension(seeds.particles, 1).size() == 4);
  std::vector<int> inner(3, 0);
  for (const Particle& p : of_dimension(seeds.particles, 2)) {
    ++inner[p.stratum];
    CHECK(p.origin == ParticleOrigin::Guard);
  }
  CHECK(std::count(inner.begin(), inner.end(), 1) == 2);
  const auto result = distribute_particles(seeds.particles, Sheets(domain.view()), {}, context);
  CHECK(result.particles.particles.size() == seeds.particles.particles.size());
  CHECK(least_distance(result.particles) > 0.5);
}

TEST_CASE("distribute_particles: the walls of a thin sheet do not see each other",
          "[particles][unit]") {
  // 2 mm thick with h = 4: the other wall is nearer than any neighbour.
  const auto domain = ellipsoids(49, {{{24, 24, 24}, {20, 20, 1}, 48}}, constant(4));
  const auto result = distribute(domain);
  check_carriers(result.particles, domain);
  std::size_t upper = 0;
  for (const Particle& p : result.particles.particles)
    upper += p.position.z > 24;
  const auto count = double(result.particles.particles.size());
  // Each wall holds what its own area does: about pi 20^2 2 / sqrt 3 / 16 = 91.
  CHECK(double(upper) == Approx(91).epsilon(0.12));
  CHECK(count - double(upper) == Approx(91).epsilon(0.12));
  CHECK(result.stats.nearest_over_h_mean > 0.85);
  CHECK(least_distance(result.particles) > 0.1);
}

TEST_CASE("distribute_particles: folds of the dense surface hold no heaps of particles",
          "[particles][unit]") {
  // Every other dense vertex 0.45 voxel off the zero set, h below that: facets far apart on the
  // dense surface project onto the same places.
  const double radius = 5, h = 0.5;
  auto domain = ball(radius, 8, constant(h));
  const double middle = 0.5 * (domain.level_sets.frame().dims[0] - 1);
  const Vec3 centre{middle, middle, middle};
  for (std::size_t v = 0; v < domain.dense.points.size(); ++v) {
    Vec3& p = domain.dense.points[v];
    p = centre + (radius + (v % 2 == 0 ? 0.45 : -0.45)) * normalized(p - centre);
  }
  const auto result = distribute(domain);
  check_carriers(result.particles, domain);
  CHECK(least_distance(result.particles) > 0.25 * h);
  // Between the count of the true sphere and that of the larger, folded one.
  const double expected = 2 / std::sqrt(3.0) * 4 * std::numbers::pi * radius * radius / (h * h);
  CHECK(double(result.particles.particles.size()) > 0.95 * expected);
  CHECK(double(result.particles.particles.size()) < 1.5 * expected);
}

TEST_CASE("distribute_particles: the paper's dense seeds reach the same layout",
          "[particles][unit]") {
  const auto domain = ball(20, 40, constant(4));
  const auto context = silent_context();
  const auto dense = seed_particles(Sheets(domain.view()), {.seeding = Seeding::Dense}, context);
  // About one per voxel of area, times 2 / sqrt 3, as far as random discs pack.
  CHECK(dense.stats.interface_particles > 4000);
  const auto thinned = distribute_particles(dense.particles, Sheets(domain.view()), {}, context);
  const auto front = distribute(domain);
  check_carriers(thinned.particles, domain);
  CHECK(thinned.stats.thinning_rounds > 3);
  CHECK(thinned.particles.particles.size() == front.particles.particles.size());
  CHECK(thinned.stats.energy.back() == Approx(front.stats.energy.back()).epsilon(0.03));
  CHECK(thinned.stats.edge_over_h_sd < 0.13);
}

TEST_CASE("distribute_particles: dense seeds are thinned by as much as h asks at each place",
          "[particles][unit]") {
  // h from 1.6 to 8.4: a factor of 27 in density.
  const auto domain = ball(20, 40, [](const Vec3& p) { return 1.0 + 0.16 * p.z; });
  const auto thinned = distribute(domain, Seeding::Dense), front = distribute(domain);
  CHECK(double(thinned.particles.particles.size()) ==
        Approx(double(front.particles.particles.size())).epsilon(0.03));
  CHECK(thinned.stats.edge_over_h_mean == Approx(1.0).margin(0.05));
  CHECK(thinned.stats.edge_over_h_sd < 0.14);  // less order to begin with
  CHECK(front.stats.edge_over_h_sd < 0.11);
}

TEST_CASE("distribute_particles: too many or too few particles are brought to the right count",
          "[particles][unit]") {
  const auto domain = ball(20, 40, constant(3));
  const auto context = silent_context();
  const double expected =
      seed_particles(Sheets(domain.view()), {}, context).stats.expected_interface_particles;
  for (const double seed_h : {2.6, 3.5}) {
    const auto other = ball(20, 40, constant(seed_h));
    auto set = seed_particles(Sheets(other.view()), {}, context).particles;
    for (Particle& p : set.particles)
      p.h_mm = 3;
    const auto result = distribute_particles(set, Sheets(domain.view()), {}, context);
    CHECK(double(result.particles.particles.size()) == expected);
    CHECK((result.stats.split > result.stats.deleted) == (seed_h > 3));
    CHECK(result.stats.edge_over_h_sd < 0.14);
  }
}

TEST_CASE("distribute_particles: sweeps end when particles are at rest, and more change nothing",
          "[particles][unit]") {
  const auto domain = ball(20, 40, [](const Vec3& p) { return 1.5 + 0.02 * p.x; });
  const Sheets sheets(domain.view());
  const auto context = silent_context();
  const auto relaxed = distribute(domain);
  CHECK(relaxed.stats.sweeps < 30);
  // too few sweeps for one that deletes and splits
  const auto again = distribute_particles(relaxed.particles, sheets, {.max_sweeps = 4}, context);
  REQUIRE(again.particles.particles.size() == relaxed.particles.particles.size());
  CHECK(again.stats.energy.back() > 0.998 * relaxed.stats.energy.back());
  std::size_t moved = 0;
  for (std::size_t i = 0; i < again.particles.particles.size(); ++i) {
    const Particle& before = relaxed.particles.particles[i];
    moved += distance(again.particles.particles[i].position, before.position) > 0.1 * before.h_mm;
  }
  CHECK(20 * moved < relaxed.particles.particles.size());
}

TEST_CASE("sizes_at_short_loops: room around a tube and a torus, spheres and discs untouched",
          "[particles][unit]") {
  const auto all_facets = [](const AnalyticDomain& domain) {
    std::vector<std::int32_t> facets(domain.dense.facets.size());
    std::iota(facets.begin(), facets.end(), 0);
    return facets;
  };
  const double minor = 3, around = 2 * std::numbers::pi * minor;
  for (const int open_parts : {0, 20}) {
    const auto domain = torus(14, minor, 60, 20, constant(20), open_parts);
    auto h = domain.sizing_field.h_mm;
    const auto lowered = sizes_at_short_loops(domain.dense, all_facets(domain), 0.4, h);
    REQUIRE_FALSE(lowered.empty());
    for (const LoweredSize& size : lowered) {
      CHECK(size.h_mm < h[size.vertex]);
      h[size.vertex] = size.h_mm;
    }
    // Three particles fit around most of the tube, two and a quarter between the loops (loop
    // guards add what is missing there), and nowhere twice as many.
    CHECK(median(h) < around / 3);
    CHECK(*std::max_element(h.begin(), h.end()) < around / 2.25);
    CHECK(*std::min_element(h.begin(), h.end()) > around / 6);
    const auto fine = std::vector<double>(h.size(), around / 6);
    CHECK(sizes_at_short_loops(domain.dense, all_facets(domain), 0.4, fine).empty());
  }
  // A narrow waist is no tunnel.
  const auto closed = ellipsoids(49, {{{24, 24, 24}, {20, 2, 2}, 24}}, constant(20));
  auto h = closed.sizing_field.h_mm;
  CHECK(sizes_at_short_loops(closed.dense, all_facets(closed), 0.4, h).empty());
  const auto halved = halved_ball(12, 12, constant(30));
  std::vector<std::int32_t> disc;
  for (std::size_t f = 0; f < halved.dense.facets.size(); ++f)
    if (halved.dense.patch_of[f].sides == Sides{2, 1}) disc.push_back(static_cast<std::int32_t>(f));
  h = halved.sizing_field.h_mm;
  CHECK(sizes_at_short_loops(halved.dense, disc, 0.4, h).empty());
}

TEST_CASE("LoopTest: three particles hold a loop, fewer do not", "[particles][unit]") {
  const auto all_facets = [](const AnalyticDomain& domain) {
    std::vector<std::int32_t> facets(domain.dense.facets.size());
    std::iota(facets.begin(), facets.end(), 0);
    return facets;
  };
  static constexpr int kSectors = 60, kRing = 18;
  // Vertex of a torus by sector and place on the ring.
  const auto at = [](int sector, int place) { return sector % kSectors * kRing + place % kRing; };
  // `around` particles on each of `along` rings.
  const auto particles = [&](int along, int around, int sectors) {
    std::vector<std::int32_t> list;
    for (int i = 0; i < along; ++i)
      for (int j = 0; j < around; ++j)
        list.push_back(at(i * sectors / along, j * kRing / around));
    return list;
  };
  const auto closed = torus(14, 3, kSectors, kRing, constant(20));
  const auto missing = [&](const std::vector<std::int32_t>& list) {
    return LoopTest(closed.dense, all_facets(closed)).missing(list);
  };
  CHECK(missing(particles(12, 4, kSectors)).empty());
  CHECK(missing(particles(6, 3, kSectors)).empty());
  CHECK_FALSE(missing(particles(12, 2, kSectors)).empty());  // around the tube
  CHECK_FALSE(missing(particles(12, 1, kSectors)).empty());
  CHECK_FALSE(missing(particles(2, 6, kSectors)).empty());  // through the hole
  CHECK_FALSE(missing({}).empty());
  // What it asks for is enough, and never what is there already.
  auto list = particles(12, 1, kSectors);
  int rounds = 0;
  for (auto more = missing(list); !more.empty(); more = missing(list)) {
    REQUIRE(++rounds < 10);
    for (const auto v : more) {
      CHECK(std::find(list.begin(), list.end(), v) == list.end());
      list.push_back(v);
    }
  }
  CHECK(list.size() < 80);

  // A tube: its rims count, a loop around it has to pass three particles.
  const auto tube = torus(14, 3, kSectors, kRing, constant(20), 20);
  const auto tube_missing = [&](int around) {
    return LoopTest(tube.dense, all_facets(tube)).missing(particles(10, around, 40));
  };
  CHECK(tube_missing(3).empty());
  CHECK_FALSE(tube_missing(2).empty());
  const auto ball_domain = ball(8, 8, constant(20));
  CHECK(LoopTest(ball_domain.dense, all_facets(ball_domain)).missing({0}).empty());
}

TEST_CASE("distribute_particles: a torus keeps three particles around its tube at any h",
          "[particles][unit]") {
  auto domain = torus(14, 3, 60, 20, constant(20));
  const auto context = silent_context();
  const auto seeds = seed_particles(Sheets(domain.view()), {}, context);
  CHECK(seeds.stats.guard_particles > 20);
  const auto result = distribute_particles(seeds.particles, Sheets(domain.view()), {}, context);
  check_carriers(result.particles, domain);

  // Where h makes no room for them, loops get the fewest that hold them, and any loop does.
  domain.sizing_field.leaves_room = false;
  const Sheets sheets(domain.view());
  const auto few =
      distribute_particles(seed_particles(sheets, {}, context).particles, sheets, {}, context);
  check_carriers(few.particles, domain);
  CHECK(few.particles.particles.size() < result.particles.particles.size());
  std::vector<std::int32_t> at;
  for (const Particle& p : few.particles.particles)
    at.push_back(sheets.nearest_vertex(p.carrier[0], p.position));
  CHECK(LoopTest(domain.dense, sheets.sheets[0].facets).missing(at).empty());

  const double middle = 0.5 * (domain.level_sets.frame().dims[0] - 1);
  // In every eighth of the torus, particles in at least three quarters of the tube.
  std::array<std::set<int>, 8> quarters;
  for (const Particle& p : result.particles.particles) {
    const double x = p.position.x - middle, y = p.position.y - middle, z = p.position.z - middle;
    const double u = std::atan2(y, x) / std::numbers::pi + 1;
    const double v = std::atan2(z, std::hypot(x, y) - 14) / std::numbers::pi + 1;
    quarters[std::min(7, int(4 * u))].insert(std::min(3, int(2 * v)));
  }
  for (const auto& q : quarters)
    CHECK(q.size() >= 3);
}

TEST_CASE("seed_particles, distribute_particles: another seed, another layout; same seed, same",
          "[particles][unit]") {
  const auto domain = ball(12, 20, constant(3));
  const auto first = distribute(domain), again = distribute(domain),
             other = distribute(domain, Seeding::Front, 2);
  REQUIRE(first.particles.particles.size() == again.particles.particles.size());
  for (std::size_t i = 0; i < first.particles.particles.size(); ++i)
    CHECK(first.particles.particles[i].position == again.particles.particles[i].position);
  CHECK_FALSE(first.particles.particles[0].position == other.particles.particles[0].position);
}

TEST_CASE("seed_particles, distribute_particles: same bytes at 1, 2 and 8 threads",
          "[particles][determinism]") {
  for (const Seeding seeding : {Seeding::Front, Seeding::Dense}) {
    const auto domain = halved_ball(16, 24, [](const Vec3& p) { return 1.5 + 0.1 * p.x; });
    std::vector<DistributeParticlesResult> results;
    for (const int threads : {1, 2, 8}) {
      const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, 8);
      tbb::task_arena arena(threads);
      arena.execute([&] { results.push_back(distribute(domain, seeding)); });
    }
    for (std::size_t r = 1; r < results.size(); ++r) {
      const auto& a = results[0].particles.particles;
      const auto& b = results[r].particles.particles;
      REQUIRE(a.size() == b.size());
      bool is_same = true;
      for (std::size_t i = 0; i < a.size(); ++i)
        is_same = is_same && a[i].position == b[i].position && a[i].h_mm == b[i].h_mm &&
                  a[i].carrier[0] == b[i].carrier[0] && a[i].carrier[1] == b[i].carrier[1] &&
                  a[i].stratum == b[i].stratum && a[i].origin == b[i].origin;
      CHECK(is_same);
      CHECK(results[0].stats.energy == results[r].stats.energy);
      CHECK(results[0].stats.edge_over_h_sd == results[r].stats.edge_over_h_sd);
    }
  }
}

TEST_CASE("seed_particles, distribute_particles: errors name the value and the bound",
          "[particles][unit]") {
  const auto domain = ball(6, 6, constant(3));
  const auto context = silent_context();
  CHECK_THROWS_WITH(seed_particles(Sheets(domain.view()), {.min_component_particles = 3}, context),
                    Catch::Contains("min_component_particles (3)"));
  CHECK_THROWS_WITH(distribute_particles({}, Sheets(domain.view()), {.max_sweeps = -1}, context),
                    Catch::Contains("max_sweeps (-1)"));
  std::atomic<bool> cancel{true};
  auto cancelled = context;
  cancelled.cancel = &cancel;
  CHECK_THROWS_AS(seed_particles(Sheets(domain.view()), {}, cancelled), Error);
}
