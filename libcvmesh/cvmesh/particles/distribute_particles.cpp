// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/particles/distribute_particles.h"

#include "cvmesh/core/error.h"
#include "cvmesh/core/parallel.h"
#include "cvmesh/mesh/neighbour_tree.h"
#include "cvmesh/particles/particle_energy.h"
#include "cvmesh/particles/sheets.h"
#include "cvmesh/particles/short_loops.h"
#include "cvmesh/particles/size_grid.h"

#include <spdlog/spdlog.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <numeric>
#include <string>
#include <utility>

namespace cvmesh {
namespace {

namespace energy = particle_energy;

constexpr char kStage[] = "particle optimisation";
constexpr double kListSlack = 1.25;      // neighbour lists reach farther than forces: they are kept
constexpr double kListTravel = 0.2;      //   until a particle is so many h from where it was
constexpr int kSweepsPerControl = 3;     // between two rounds of splitting and deleting
constexpr double kControlShare = 0.6;    // of the sweeps; the rest only relaxes
constexpr double kOverRelaxation = 1.3;  // Newton steps of the radial part alone are too short
constexpr double kLongestStep = 0.5;     // over h
constexpr double kStill = 0.02;          // over h: a shorter step does not wake the neighbours
constexpr int kStepTries = 4;            // each a third of the one before
constexpr double kHole = 1.3;            // empty circle over that of the ideal triangle
constexpr double kLeastRoom = 0.25;      // over h around a new one; twice that between two
constexpr double kLeastHole = 1.0;       // no particle is added to what is closer than ideal
constexpr double kCoincident = 0.6;      // distance over h; relaxed neighbours keep more
constexpr std::size_t kExchangePart = 40;  // one in so many is moved to a hole at a time
constexpr std::size_t kLeastExchange = 8;  // particles on a sheet where that makes sense
constexpr double kFullSightCosine = 0.25, kOpposedSight = 0.15;
constexpr double kCrowded = 1.75;    // energy over the ideal: delete [Meyer 2007]
constexpr double kFirstRing = 1.5;   // over the nearest distance
constexpr double kThinAbove = 1.25;  // seeds over the count that is wanted
constexpr std::size_t kThinNeighbours = 24;
constexpr double kConverged = 1e-3;     // relative change of a sheet's energy
constexpr std::size_t kFewMoving = 20;  // or one particle in so many still moves
constexpr int kGuardRounds = 8;         // of adding particles to loops; two or three are usual
constexpr double kCurveClearanceVox = 0.1, kLeastDistanceVox = 1e-3;

// The particles of one sheet; the rim comes first and does not move.
struct Cloud {
  std::int32_t sheet = -1;
  std::size_t rim_size = 0, wanted = 0;
  double h_scale = 1;  // of guarded sheets
  std::vector<Vec3> position, normal;
  std::vector<double> h;
  std::vector<std::int32_t> facet;
  std::vector<std::uint8_t> is_projected, is_guard;
  // Whether the last visit moved a particle, or one beside it was deleted since. Only particles are
  // looked at for which this holds, or for a neighbour.
  std::vector<std::uint8_t> is_moving;
  std::vector<std::int32_t> first, neighbour;      // lists, ascending
  std::vector<Vec3> listed_at;                     // where the particles were then
  std::vector<std::vector<std::int32_t>> classes;  // no two of a class are neighbours
  double last_energy = std::numeric_limits<double>::infinity();
  bool is_settled = false;

  [[nodiscard]] std::size_t size() const { return position.size(); }

  [[nodiscard]] std::size_t free_count() const { return size() - rim_size; }

  [[nodiscard]] std::size_t moving_count() const {
    return static_cast<std::size_t>(std::count(is_moving.begin(), is_moving.end(), 1));
  }

  void add(const SurfacePoint& p, bool guard) {
    position.push_back(p.position);
    normal.push_back(p.normal);
    h.push_back(h_scale * p.h_mm);
    facet.push_back(p.facet);
    is_projected.push_back(p.is_projected);
    is_guard.push_back(guard);
    is_moving.push_back(1);
  }

  void set(std::size_t i, const SurfacePoint& p) {
    position[i] = p.position;
    normal[i] = p.normal;
    h[i] = h_scale * p.h_mm;
    facet[i] = p.facet;
    is_projected[i] = p.is_projected;
  }

  void erase(const std::vector<bool>& is_deleted) {
    for (std::size_t i = 0; i < size(); ++i)
      for (auto k = first[i]; is_deleted[i] && k < first[i + 1]; ++k)
        if (static_cast<std::size_t>(neighbour[k]) >= rim_size) is_moving[neighbour[k]] = 1;
    std::size_t kept = 0;
    for (std::size_t i = 0; i < size(); ++i) {
      if (is_deleted[i]) continue;
      position[kept] = position[i];
      normal[kept] = normal[i];
      h[kept] = h[i];
      facet[kept] = facet[i];
      is_projected[kept] = is_projected[i];
      is_guard[kept] = is_guard[i];
      is_moving[kept] = is_moving[i];
      ++kept;
    }
    position.resize(kept);
    normal.resize(kept);
    h.resize(kept);
    facet.resize(kept);
    is_projected.resize(kept);
    is_guard.resize(kept);
    is_moving.resize(kept);
  }
};

double mean_h(const Cloud& c, std::size_t i, std::size_t j) {
  return 0.5 * (c.h[i] + c.h[j]);
}

// Particles see each other fully with normals up to 75 degrees apart. Those on opposite walls of a
// thin part must not, or they push each other aside at large epsilon; they only keep a small
// distance, which stops pairs from meeting where the walls join in a sharp rim. Smooth in between.
double sight(const Vec3& n, const Vec3& m) {
  const double cosine = dot(n, m);
  if (cosine >= kFullSightCosine) return 1;
  const double t = std::max(0.0, 0.5 + 0.5 * cosine / kFullSightCosine);
  return kOpposedSight + (1 - kOpposedSight) * t * t * (3 - 2 * t);
}

// ---- neighbours -------------------------------------------------------------------------------

// Lists within reach. Each pair is found from its larger h, so one search radius per particle is
// enough however steep the sizing field is.
std::vector<std::vector<std::int32_t>> pairs_within_reach(const Cloud& c) {
  const NeighbourTree tree(c.position);
  std::vector<std::vector<std::int32_t>> found(c.size());
  parallel_for_each_index(
      0, c.size(),
      [&](std::size_t i) {
        std::vector<std::int32_t> near;
        tree.within(c.position[i], kListSlack * energy::kReach * c.h[i], near);
        for (const auto j : near) {
          if (std::pair(c.h[j], std::size_t(j)) >= std::pair(c.h[i], i)) continue;
          if (i < c.rim_size && std::size_t(j) < c.rim_size) continue;
          if (distance(c.position[i], c.position[j]) <
              kListSlack * energy::kReach * mean_h(c, i, j) * sight(c.normal[i], c.normal[j]))
            found[i].push_back(j);
        }
      },
      128);
  return found;
}

// The few nearest, for seeds much denser than h: their full lists would hold hundreds.
std::vector<std::vector<std::int32_t>> nearest_pairs(const Cloud& c) {
  const NeighbourTree tree(c.position);
  std::vector<std::vector<std::int32_t>> found(c.size());
  parallel_for_each_index(
      c.rim_size, c.size(),
      [&](std::size_t i) {
        std::vector<std::int32_t> near;
        tree.nearest(c.position[i], kThinNeighbours, near);
        for (const auto j : near)
          if (std::size_t(j) != i && dot(c.normal[i], c.normal[j]) > 0) found[i].push_back(j);
      },
      128);
  return found;
}

void build_lists(Cloud& c, const std::vector<std::vector<std::int32_t>>& pairs) {
  std::vector<std::vector<std::int32_t>> both(c.size());
  for (std::size_t i = 0; i < c.size(); ++i)
    for (const auto j : pairs[i]) {
      both[i].push_back(j);
      both[j].push_back(static_cast<std::int32_t>(i));
    }
  c.first.assign(c.size() + 1, 0);
  c.neighbour.clear();
  for (std::size_t i = 0; i < c.size(); ++i) {
    std::sort(both[i].begin(), both[i].end());
    both[i].erase(std::unique(both[i].begin(), both[i].end()), both[i].end());
    c.neighbour.insert(c.neighbour.end(), both[i].begin(), both[i].end());
    c.first[i + 1] = static_cast<std::int32_t>(c.neighbour.size());
  }
}

// Greedy colouring of the lists, by index: particles of one class never read each other, so they
// can move at the same time with the same result as one after the other.
void colour(Cloud& c) {
  std::vector<int> colour_of(c.size(), -1);
  std::vector<std::size_t> last_use;
  c.classes.clear();
  for (std::size_t i = c.rim_size; i < c.size(); ++i) {
    for (auto k = c.first[i]; k < c.first[i + 1]; ++k)
      if (const int used = colour_of[c.neighbour[k]]; used >= 0) last_use[used] = i;
    std::size_t free = 0;
    while (free < last_use.size() && last_use[free] == i)
      ++free;
    if (free == last_use.size()) {
      last_use.push_back(0);
      c.classes.emplace_back();
    }
    colour_of[i] = static_cast<int>(free);
    c.classes[free].push_back(static_cast<std::int32_t>(i));
  }
}

void rebuild(Cloud& c, bool is_thinning = false) {
  build_lists(c, is_thinning ? nearest_pairs(c) : pairs_within_reach(c));
  colour(c);
  c.listed_at = c.position;
}

// Whether the lists may lack a pair that has come within reach [Verlet 1967].
bool are_lists_old(const Cloud& c) {
  if (c.listed_at.size() != c.size()) return true;
  for (std::size_t i = c.rim_size; i < c.size(); ++i)
    if (squared_norm(c.position[i] - c.listed_at[i]) > kListTravel * kListTravel * c.h[i] * c.h[i])
      return true;
  return false;
}

// ---- energy and moves -------------------------------------------------------------------------

double energy_at(const Cloud& c, std::size_t i, const Vec3& x, const Vec3& normal, double h) {
  double sum = 0;
  for (auto k = c.first[i]; k < c.first[i + 1]; ++k) {
    const auto j = c.neighbour[k];
    const double full = energy::kReach * 0.5 * (h + c.h[j]);
    const double squared = squared_norm(x - c.position[j]);
    if (squared >= full * full) continue;
    sum += energy::pair(std::sqrt(squared) / (full * sight(normal, c.normal[j])));
  }
  return sum;
}

double energy_of(const Cloud& c, std::size_t i) {
  return energy_at(c, i, c.position[i], c.normal[i], c.h[i]);
}

double total_energy(const Cloud& c) {
  return deterministic_reduce(
      c.rim_size, c.size(), 0.0, [&](std::size_t i) { return energy_of(c, i); },
      [](double a, double b) { return a + b; });
}

// The step that minimises the energy in the tangent plane to second order. The Hessian keeps the
// part along the pair only: the part across it is negative, and dropping it leaves a matrix that
// is never indefinite (a Gauss-Newton matrix, as in Levenberg-Marquardt's method).
Vec3 newton_step(const Cloud& c, std::size_t i) {
  const Vec3 n = c.normal[i];
  const auto [u, v] = TangentFrame(n);
  double gu = 0, gv = 0, huu = 0, huv = 0, hvv = 0;
  for (auto k = c.first[i]; k < c.first[i + 1]; ++k) {
    const auto j = c.neighbour[k];
    const Vec3 r = c.position[i] - c.position[j];
    const double length = norm(r), full = energy::kReach * mean_h(c, i, j);
    if (length >= full || !(length > 0)) continue;
    const double reach = full * sight(n, c.normal[j]), d = length / reach;
    if (d >= 1) continue;
    const double ru = dot(r, u) / length, rv = dot(r, v) / length;
    const double slope = energy::slope(d) / reach;
    const double curvature = energy::curvature(d) / (reach * reach);
    gu += slope * ru;
    gv += slope * rv;
    huu += curvature * ru * ru;
    huv += curvature * ru * rv;
    hvv += curvature * rv * rv;
  }
  const double damping = 0.02 * (huu + hvv);
  huu += damping;
  hvv += damping;
  const double determinant = huu * hvv - huv * huv;
  if (!(determinant > 0)) return {};
  const double su = -(hvv * gu - huv * gv) / determinant;
  const double sv = -(huu * gv - huv * gu) / determinant;
  Vec3 step = kOverRelaxation * (su * u + sv * v);
  const double length = norm(step), longest = kLongestStep * c.h[i];
  if (length > longest) step *= longest / length;
  return step;
}

bool is_awake(const Cloud& c, std::size_t i) {
  if (c.is_moving[i] != 0) return true;
  const auto is_moving = [&](std::int32_t j) { return c.is_moving[j] != 0; };
  return std::any_of(c.neighbour.begin() + c.first[i], c.neighbour.begin() + c.first[i + 1],
                     is_moving);
}

void relax(Cloud& c, std::size_t i, const Sheets& sheets) {
  if (!is_awake(c, i)) return;
  c.is_moving[i] = 0;
  Vec3 step = newton_step(c, i);
  if (!(norm(step) > 1e-4 * c.h[i])) return;
  const double before = energy_of(c, i);
  const double clearance = kCurveClearanceVox * sheets.voxel_mm();
  for (int attempt = 0; attempt < kStepTries; ++attempt, step *= 1.0 / 3) {
    const SurfacePoint there = sheets.move(c.facet[i], c.position[i] + step);
    if (there.curve_distance < clearance) continue;
    if (energy_at(c, i, there.position, there.normal, c.h_scale * there.h_mm) >= before) continue;
    c.is_moving[i] = distance(c.position[i], there.position) > kStill * c.h[i];
    c.set(i, there);
    return;
  }
}

void sweep(Cloud& c, const Sheets& sheets) {
  for (const auto& members : c.classes)
    parallel_for_each_index(
        0, members.size(), [&](std::size_t k) { relax(c, members[k], sheets); }, 32);
}

// ---- population -------------------------------------------------------------------------------

energy::Star star_of(const Cloud& c, std::size_t i) {
  std::vector<Vec3> offsets;
  std::vector<std::int32_t> particles;
  for (auto k = c.first[i]; k < c.first[i + 1]; ++k) {
    const auto j = c.neighbour[k];
    if (!(dot(c.normal[i], c.normal[j]) > 0)) continue;
    particles.push_back(j);
    offsets.push_back(c.position[j] - c.position[i]);
  }
  energy::Star star = energy::find_star(offsets, c.normal[i]);
  for (auto& index : star.ring)
    index = particles[index];
  return star;
}

struct Crowd {
  double energy;
  std::int32_t particle;

  friend bool operator<(const Crowd& a, const Crowd& b) {
    return a.energy != b.energy ? a.energy > b.energy : a.particle < b.particle;
  }
};

// Deletes up to `most` particles of at least `least_energy`, the most crowded first, and never two
// within the `touching(i)` of the first one in one round: the energy of those beside a deleted one
// is out of date.
template <typename Touching>
std::size_t delete_crowded(Cloud& c,
                           std::size_t most,
                           double least_energy,
                           const Touching& touching) {
  if (most == 0) return 0;
  std::vector<Crowd> crowds(c.free_count());
  parallel_for_each_index(0, crowds.size(), [&](std::size_t k) {
    crowds[k] = {energy_of(c, c.rim_size + k), static_cast<std::int32_t>(c.rim_size + k)};
  });
  std::sort(crowds.begin(), crowds.end());
  std::vector<bool> is_deleted(c.size(), false), is_kept(c.size(), false);
  std::size_t count = 0;
  for (const Crowd& crowd : crowds) {
    if (count == most || crowd.energy < least_energy) break;
    const auto i = static_cast<std::size_t>(crowd.particle);
    if (is_kept[i]) continue;
    is_deleted[i] = true;
    ++count;
    const double reach = touching(i);
    for (auto k = c.first[i]; k < c.first[i + 1]; ++k) {
      const auto j = c.neighbour[k];
      if (distance(c.position[i], c.position[j]) < reach) is_kept[j] = true;
    }
  }
  c.erase(is_deleted);
  return count;
}

// Splits up to `most` particles beside the largest gaps: the child goes to the middle of the
// largest empty circle that touches its parent. (Meyer's child, half way to the farthest
// neighbour, lands in a gap only if there is one on that side.)
std::size_t split_sparse(Cloud& c, const Sheets& sheets, double threshold, std::size_t most) {
  if (most == 0) return 0;

  struct Gap {
    double width = 0;
    Vec3 centre;
  };

  std::vector<Gap> gaps(c.size());
  parallel_for_each_index(
      c.rim_size, c.size(),
      [&](std::size_t i) {
        const energy::Star star = star_of(c, i);
        const double ideal = c.h[i] / std::sqrt(3.0);
        if (star.ring.empty() || (!star.is_closed && sheets.sheets[c.sheet].is_closed)) {
          // Alone, or with all neighbours on one side: away from them.
          Vec3 away{};
          for (const auto j : star.ring)
            away += normalized(c.position[i] - c.position[j]);
          if (star.ring.empty()) away = cross(c.normal[i], {0.36, 0.48, 0.8});
          gaps[i] = {2 * kHole, c.position[i] + c.h[i] * normalized(away)};
        } else if (star.hole_radius > 0) {
          const double radius = std::min(star.hole_radius, c.h[i]);
          gaps[i] = {star.hole_radius / ideal,
                     c.position[i] + radius * normalized(star.hole_centre)};
        }
      },
      128);
  std::vector<std::int32_t> order(c.size());
  std::iota(order.begin(), order.end(), 0);
  std::stable_sort(order.begin(), order.end(),
                   [&](std::int32_t a, std::int32_t b) { return gaps[a].width > gaps[b].width; });
  SizeGrid grid;
  for (std::size_t i = 0; i < c.size(); ++i)
    grid.add(static_cast<std::int32_t>(i), c.position[i], c.h[i]);
  const std::size_t old_size = c.size();
  std::size_t count = 0;
  for (const auto i : order) {
    if (count == most || gaps[i].width < threshold) break;
    const SurfacePoint child = sheets.move(c.facet[i], gaps[i].centre);
    if (child.curve_distance < kCurveClearanceVox * sheets.voxel_mm()) continue;
    // The projection may have ended elsewhere than beside its parent, even on the opposite wall.
    const double h = c.h_scale * child.h_mm, room = kLeastRoom * h;
    bool is_free = true;
    grid.visit_near(child.position, 2 * room, 0, [&](std::int32_t j) {
      const bool is_child = static_cast<std::size_t>(j) >= old_size;
      const double d = distance(child.position, c.position[j]);
      is_free = is_free && d > (is_child ? 2 : 1) * room * sight(child.normal, c.normal[j]);
    });
    if (!is_free) continue;
    grid.add(static_cast<std::int32_t>(c.size()), child.position, h);
    c.add(child, false);
    ++count;
  }
  return count;
}

// Deletes inner particles that are much too near to another: what is left of folds in the dense
// surface, and of sheets too narrow for h. Guards stay, and so does the last particle.
std::size_t delete_coincident(Cloud& c) {
  if (c.h_scale < 1) return 0;  // guarded: every particle counts
  std::vector<bool> is_deleted(c.size(), false);
  std::size_t count = 0;
  for (std::size_t i = c.rim_size; i < c.size() && count + 1 < c.free_count(); ++i) {
    if (c.is_guard[i] != 0) continue;
    for (auto k = c.first[i]; k < c.first[i + 1] && !is_deleted[i]; ++k) {
      const auto j = static_cast<std::size_t>(c.neighbour[k]);
      if (is_deleted[j] || (j > i && c.is_guard[j] == 0)) continue;
      is_deleted[i] = dot(c.normal[i], c.normal[j]) > 0 &&
                      distance(c.position[i], c.position[j]) < kCoincident * mean_h(c, i, j);
    }
    count += is_deleted[i];
  }
  if (count > 0) {
    c.erase(is_deleted);
    rebuild(c);
  }
  return count;
}

struct Changes {
  std::size_t split = 0, deleted = 0;

  [[nodiscard]] bool any() const { return split + deleted > 0; }
};

// Crowded particles move to gaps as long as there are both; then the count is made right.
Changes control_population(Cloud& c, const Sheets& sheets) {
  Changes changes;
  changes.deleted = delete_coincident(c);
  const std::size_t before = c.free_count();
  if (before >= kLeastExchange)
    changes.split = split_sparse(c, sheets, kHole, 1 + before / kExchangePart);
  if (changes.split > 0) rebuild(c);
  const std::size_t excess = c.free_count() > c.wanted ? c.free_count() - c.wanted : 0;
  changes.deleted += delete_crowded(c, excess, 0, [&](std::size_t i) { return c.h[i]; });
  if (c.free_count() < c.wanted) {
    rebuild(c);
    changes.split += split_sparse(c, sheets, kLeastHole, c.wanted - c.free_count());
  }
  return changes;
}

// Distance to the nearest particle that can be seen.
double nearest_distance(const Cloud& c, std::size_t i) {
  double nearest = std::numeric_limits<double>::infinity();
  for (auto k = c.first[i]; k < c.first[i + 1]; ++k) {
    const auto j = c.neighbour[k];
    if (dot(c.normal[i], c.normal[j]) > 0)
      nearest = std::min(nearest, distance(c.position[i], c.position[j]));
  }
  return nearest;
}

// Dense seeds: rounds of deleting and moving until no particle is crowded any more. In a round the
// first ring around a deleted particle stays, at the spacing that it has now, so that what is left
// is even. How many rounds a place needs depends on its own h; elsewhere nothing is deleted.
Changes thin(Cloud& c, const Sheets& sheets, int& rounds) {
  Changes changes;
  rounds = 0;
  while (static_cast<double>(c.free_count()) > kThinAbove * static_cast<double>(c.wanted)) {
    rebuild(c, true);
    const std::size_t deleted =
        delete_crowded(c, c.free_count() - c.wanted, kCrowded * energy::kIdeal,
                       [&](std::size_t i) { return kFirstRing * nearest_distance(c, i); });
    if (deleted == 0) break;
    changes.deleted += deleted;
    ++rounds;
    rebuild(c, true);
    sweep(c, sheets);
  }
  return changes;
}

// Particles where a loop of the sheet has too few; they push the others aside a little.
std::size_t add_loop_guards(Cloud& c, const Sheets& sheets) {
  const Sheet& sheet = sheets.sheets[c.sheet];
  if (!sheet.has_loops) return 0;
  const LoopTest loops(sheets.domain().dense, sheet.facets);
  std::size_t added = 0;
  for (int round = 0; round < kGuardRounds; ++round) {
    std::vector<std::int32_t> vertices;
    for (std::size_t i = 0; i < c.size(); ++i)
      vertices.push_back(sheets.nearest_vertex(c.facet[i], c.position[i]));
    const auto missing = loops.missing(vertices);
    if (missing.empty()) break;
    for (const auto v : missing)
      c.add(sheets.at_vertex(v, c.sheet), true);
    added += missing.size();
    rebuild(c);
    if (round + 1 < kGuardRounds) sweep(c, sheets);
  }
  return added;
}

// ---- in and out -------------------------------------------------------------------------------

std::vector<Cloud> gather(const std::vector<Particle>& particles,
                          const Sheets& sheets,
                          std::size_t frozen) {
  const std::vector<Particle> fixed(particles.begin(),
                                    particles.begin() + static_cast<std::ptrdiff_t>(frozen));
  const auto rims = find_rims(sheets, fixed);
  std::vector<Cloud> clouds(sheets.sheets.size());
  for (std::size_t s = 0; s < clouds.size(); ++s) {
    clouds[s].sheet = static_cast<std::int32_t>(s);
    clouds[s].rim_size = rims[s].size();
    for (const RimParticle& r : rims[s])
      clouds[s].add(r.place, false);
    clouds[s].is_moving.assign(clouds[s].rim_size, 0);
  }
  std::vector<std::size_t> guards(clouds.size(), 0);
  for (std::size_t i = frozen; i < particles.size(); ++i) {
    const Particle& p = particles[i];
    require(p.dimension == 2 && p.carrier[0] >= 0 &&
                p.carrier[0] < static_cast<std::int32_t>(sheets.sheet_of.size()),
            ErrorCode::Internal, kStage,
            "particle " + std::to_string(i) + " has no dense facet, or is not in the order " +
                "corners, curves, interfaces");
    Cloud& c = clouds[sheets.sheet_of[p.carrier[0]]];
    const SurfacePoint given = sheets.describe(p.carrier[0], p.position);
    // Guards of closed sheets have lowered h in the seeds, by one factor per sheet.
    if (c.free_count() == 0) c.h_scale = p.h_mm / given.h_mm;
    const bool is_guard = p.origin == ParticleOrigin::Guard;
    const SurfacePoint settled = sheets.move(p.carrier[0], p.position);
    const double clearance = kCurveClearanceVox * sheets.voxel_mm();
    c.add(settled.curve_distance >= clearance ? settled : given, is_guard);
    guards[c.sheet] += is_guard;
  }
  for (Cloud& c : clouds) {
    const Sheet& sheet = sheets.sheets[c.sheet];
    const double natural = natural_count(sheet, sheet.lattice_count, rims[c.sheet]);
    c.wanted = static_cast<std::size_t>(std::lround(natural / (c.h_scale * c.h_scale)));
    c.wanted = std::max(c.wanted, guards[c.sheet]);
  }
  return clouds;
}

// Particles of different sheets in one place: the later one goes back onto its own facet.
void separate(std::vector<Particle>& particles, const InterfaceMesh& dense, double voxel_mm) {
  std::vector<Vec3> places;
  for (const Particle& p : particles)
    places.push_back(p.position);
  if (places.empty()) return;
  const NeighbourTree tree(places);
  std::vector<std::int32_t> found;
  for (std::size_t i = 0; i < particles.size(); ++i) {
    Particle& p = particles[i];
    if (p.dimension != 2) continue;
    tree.within(p.position, kLeastDistanceVox * voxel_mm, found);
    if (found.size() < 2 || found.front() == static_cast<std::int32_t>(i)) continue;
    const auto& v = dense.facets[p.carrier[0]];
    p.position =
        nearest_on_triangle(p.position, dense.points[v[0]], dense.points[v[1]], dense.points[v[2]]);
    p.is_on_stratum = false;
  }
}

struct StarSums {
  double edges = 0, sum = 0, squares = 0, nearest = 0;
  double shortest = std::numeric_limits<double>::infinity(), longest = 0;
  std::size_t particles = 0, six = 0;
};

StarSums join(const StarSums& a, const StarSums& b) {
  return {a.edges + b.edges,
          a.sum + b.sum,
          a.squares + b.squares,
          a.nearest + b.nearest,
          std::min(a.shortest, b.shortest),
          std::max(a.longest, b.longest),
          a.particles + b.particles,
          a.six + b.six};
}

// Edges of the local triangulations: each once if both ends move, all that end at the rim.
StarSums measure(const Cloud& c) {
  return deterministic_reduce(
      c.rim_size, c.size(), StarSums{},
      [&](std::size_t i) {
        StarSums sums;
        const energy::Star star = star_of(c, i);
        if (!star.is_closed) return sums;
        sums.particles = 1;
        sums.six = star.ring.size() == 6;
        double nearest = std::numeric_limits<double>::infinity();
        for (const auto j : star.ring) {
          const double ratio = distance(c.position[i], c.position[j]) / mean_h(c, i, j);
          nearest = std::min(nearest, ratio);
          sums.longest = std::max(sums.longest, ratio);
          const double weight = std::size_t(j) < c.rim_size ? 1 : 0.5;
          sums.edges += weight;
          sums.sum += weight * ratio;
          sums.squares += weight * ratio * ratio;
        }
        sums.nearest = sums.shortest = nearest;
        return sums;
      },
      join);
}

void write_statistics(const std::vector<Cloud>& clouds, DistributeParticlesStats& stats) {
  StarSums all;
  for (const Cloud& c : clouds)
    all = join(all, measure(c));
  if (all.particles == 0) return;
  const auto particles = static_cast<double>(all.particles);
  stats.edge_over_h_mean = all.sum / all.edges;
  stats.edge_over_h_sd = std::sqrt(
      std::max(0.0, all.squares / all.edges - stats.edge_over_h_mean * stats.edge_over_h_mean));
  stats.edge_over_h_min = all.shortest;
  stats.edge_over_h_max = all.longest;
  stats.nearest_over_h_mean = all.nearest / particles;
  stats.six_neighbour_share = static_cast<double>(all.six) / particles;
}

}  // namespace

DistributeParticlesResult distribute_particles(ParticleSet particles,
                                               const Sheets& sheets,
                                               const DistributeParticlesOptions& options,
                                               const StageContext& context) {
  require(options.max_sweeps >= 0, ErrorCode::BadParameter, kStage,
          "max_sweeps (" + std::to_string(options.max_sweeps) + ") is negative; use 0 or more");
  report_progress(context, kStage, 0);
  DistributeParticlesResult result;
  auto& stats = result.stats;
  auto& all = particles.particles;
  const auto frozen = static_cast<std::size_t>(
      std::find_if(all.begin(), all.end(), [](const Particle& p) { return p.dimension == 2; }) -
      all.begin());
  std::vector<Cloud> clouds = gather(all, sheets, frozen);
  std::vector<Changes> changes(clouds.size());
  std::vector<int> rounds(clouds.size(), 0);
  std::vector<std::size_t> guards(clouds.size(), 0);
  const auto for_each_cloud = [&](const auto& body) {
    parallel_for_each_index(0, clouds.size(), body, 1);
    for (Changes& c : changes) {
      stats.split += c.split;
      stats.deleted += c.deleted;
      c = {};
    }
  };

  for_each_cloud([&](std::size_t s) {
    changes[s] = thin(clouds[s], sheets, rounds[s]);
    rebuild(clouds[s]);
  });
  for (const int r : rounds)
    stats.thinning_rounds = std::max(stats.thinning_rounds, r);

  const int last_control = static_cast<int>(kControlShare * options.max_sweeps);
  for (int pass = 1; pass <= options.max_sweeps; ++pass) {
    report_progress(context, kStage, 0.1 + 0.9 * (pass - 1) / options.max_sweeps);
    for_each_cloud([&](std::size_t s) {
      Cloud& c = clouds[s];
      if (c.is_settled || c.free_count() == 0) return;
      sweep(c, sheets);
      const bool is_control = pass % kSweepsPerControl == 0 && pass <= last_control;
      if (is_control) changes[s] = control_population(c, sheets);
      if (changes[s].any() || are_lists_old(c)) rebuild(c);
      const double now = total_energy(c);
      c.is_settled = pass > last_control && (std::abs(now - c.last_energy) <= kConverged * now ||
                                             kFewMoving * c.moving_count() <= c.free_count());
      c.last_energy = now;
    });
    double energy_now = 0;
    bool is_settled = true;
    for (const Cloud& c : clouds) {
      if (c.free_count() == 0) continue;
      energy_now += c.last_energy;
      is_settled = is_settled && c.is_settled;
    }
    stats.energy.push_back(energy_now);
    stats.sweeps = pass;
    context.log->debug("{}: sweep {}, energy {:.6g}", kStage, pass, energy_now);
    if (is_settled) break;
  }

  for_each_cloud([&](std::size_t s) {
    rebuild(clouds[s]);
    changes[s].deleted = delete_coincident(clouds[s]);
    guards[s] = add_loop_guards(clouds[s], sheets);
  });
  stats.loop_guards = std::accumulate(guards.begin(), guards.end(), std::size_t{0});
  write_statistics(clouds, stats);
  std::stable_sort(clouds.begin(), clouds.end(), [&](const Cloud& a, const Cloud& b) {
    return sheets.sheets[a.sheet].patch < sheets.sheets[b.sheet].patch;
  });
  all.resize(frozen);
  for (const Cloud& c : clouds)
    for (std::size_t i = c.rim_size; i < c.size(); ++i) {
      Particle p;
      p.position = c.position[i];
      p.h_mm = c.h[i];
      p.origin = c.is_guard[i] != 0 ? ParticleOrigin::Guard : ParticleOrigin::Optimised;
      p.stratum = sheets.sheets[c.sheet].patch;
      p.carrier[0] = c.facet[i];
      p.is_on_stratum = c.is_projected[i] != 0;
      all.push_back(p);
    }
  separate(all, sheets.domain().dense, sheets.voxel_mm());
  stats.on_dense_facet = static_cast<std::size_t>(
      std::count_if(all.begin() + static_cast<std::ptrdiff_t>(frozen), all.end(),
                    [](const Particle& p) { return !p.is_on_stratum; }));
  result.particles = std::move(particles);
  report_progress(context, kStage, 1);
  return result;
}

}  // namespace cvmesh
