// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/surface/decimate.h"

#include "cvmesh/core/error.h"
#include "cvmesh/core/random.h"
#include "cvmesh/surface/embedding_guard.h"
#include "cvmesh/surface/triangulate_ring.h"

#include <spdlog/spdlog.h>

#include <algorithm>
#include <array>
#include <utility>

namespace cvmesh {
namespace {

using Sheet = MaterialSurfaces::Sheet;
using Triangulation = MaterialSurfaces::Triangulation;

// Limits of each pass, strict ones first: an early removal must not spoil the shape of what is
// left, a late one only has to be valid.
constexpr std::array<RingLimits, 4> kPasses{{
    {0.10, 0.26, -0.50},    // normals within 75 degrees of the mean, dihedral angles over 60
    {0.05, 0.00, -0.80},    // 90 and 37 degrees
    {0.01, -0.50, -0.94},   // 120 and 20 degrees
    {1e-3, -1.01, -0.985},  // any direction; dihedral angles over 10 degrees
}};

// Samples of a facet that rank triangulations; the exact assignment afterwards uses all.
constexpr std::size_t kRankingSamples = 16;

enum class Refusal { None, Topology, Shape, Intersection, Jump };

constexpr std::array<const char*, 5> kRefusalNames{"none", "topology", "fold", "intersection",
                                                   "jump"};

class Decimator {
 public:
  Decimator(MaterialSurfaces& surfaces, double voxel_mm, const DecimateOptions& options)
      : surfaces_(surfaces),
        guard_(surfaces, voxel_mm),
        objective_{options.deviation_vox * voxel_mm} {}

  Refusal try_remove(std::int32_t vertex, const RingLimits& limits) {
    if (!collect(vertex)) return Refusal::Topology;
    if (!set_up_problems(vertex)) return Refusal::Topology;
    // Each attempt forbids the triangles that the last optimum failed with.
    constexpr int kMaxAttempts = 12;
    Refusal refusal = Refusal::Shape;
    for (int attempt = 0; attempt < kMaxAttempts; ++attempt) {
      triangulations_.resize(sheets_.size());
      for (std::size_t s = 0; s < sheets_.size(); ++s) {
        if (attempt > 0 && !needs_solution_[s]) continue;
        auto solution = triangulate_ring(problems_[s], limits, objective_);
        if (!solution) return attempt == 0 ? Refusal::Shape : refusal;
        triangulations_[s] = std::move(*solution);
      }
      needs_solution_.assign(sheets_.size(), false);
      const Refusal now = check_embedding(vertex);
      if (now == Refusal::None) {
        commit(vertex);
        return Refusal::None;
      }
      refusal = now;
    }
    return refusal;
  }

 private:
  bool collect(std::int32_t vertex) {
    if (!surfaces_.collect_sheets(vertex, sheets_)) return false;
    star_.clear();
    ring_.clear();
    Box3 box;
    for (const Sheet& sheet : sheets_) {
      if (sheet.ring.size() > RingProblem::kMaxRing) return false;
      star_.insert(star_.end(), sheet.facets.begin(), sheet.facets.end());
      ring_.insert(ring_.end(), sheet.ring.begin(), sheet.ring.end());
      for (const auto v : sheet.ring)
        box.add(surfaces_.points()[v]);
    }
    box.add(surfaces_.points()[vertex]);
    guard_.begin(box, star_);
    guard_.mark_ring(ring_);
    return true;
  }

  // Rings, normals, samples and forbidden edges of all sheets; false where the complex forbids the
  // removal whatever the triangulation.
  bool set_up_problems(std::int32_t vertex) {
    problems_.assign(sheets_.size(), {});
    needs_solution_.assign(sheets_.size(), true);
    int vanishing = 0;
    for (std::size_t s = 0; s < sheets_.size(); ++s) {
      const Sheet& sheet = sheets_[s];
      RingProblem& problem = problems_[s];
      problem.is_disk = sheet.is_disk;
      problem.forbidden_edges.assign(sheet.ring.size(), 0);
      if (!sheet.is_disk && sheet.facets.size() == 1) ++vanishing;
      for (const auto v : sheet.ring)
        problem.ring.push_back(surfaces_.points()[v]);
      gather_samples(vertex, sheet, problem);
    }
    if (vanishing > 1) return false;
    return mark_existing_edges(vanishing == 1) && mark_outer_normals();
  }

  void gather_samples(std::int32_t vertex, const Sheet& sheet, RingProblem& problem) const {
    problem.samples.push_back(surfaces_.points()[vertex]);
    Vec3 normal;
    for (const auto f : sheet.facets) {
      const auto& v = surfaces_.facets()[f].vertices;
      const auto& p = surfaces_.points();
      normal += area_vector2(p[v[0]], p[v[1]], p[v[2]]);
      std::size_t count = 0;
      surfaces_.for_each_sample(f, [&](const Vec3&) { ++count; });
      const std::size_t stride = (count + kRankingSamples - 1) / kRankingSamples;
      std::size_t n = 0;
      surfaces_.for_each_sample(f, [&](const Vec3& sample) {
        if (n++ % stride == 0) problem.samples.push_back(sample);
      });
    }
    problem.normal = normalized(normal);
  }

  [[nodiscard]] static int place_in(const Sheet& sheet, std::int32_t vertex) {
    const auto it = std::find(sheet.ring.begin(), sheet.ring.end(), vertex);
    return it == sheet.ring.end() ? -1 : static_cast<int>(it - sheet.ring.begin());
  }

  // Edges between ring vertices that exist outside the star may not be made again.
  bool mark_existing_edges(bool has_vanishing) {
    const bool is_on_curve = !sheets_.front().is_disk;
    const std::int32_t p = sheets_.front().ring.front(), q = sheets_.front().ring.back();
    int facets_at_closing_edge = 0;
    PatchKey patch_at_closing_edge;
    for (const auto f : guard_.nearby()) {
      const auto& facet = surfaces_.facets()[f];
      for (std::size_t s = 0; s < sheets_.size(); ++s) {
        std::array<int, 3> place;
        int found = 0;
        for (int c = 0; c < 3; ++c) {
          place[c] = place_in(sheets_[s], facet.vertices[c]);
          found += place[c] >= 0 ? 1 : 0;
        }
        if (found < 2) continue;
        if (found == 3 && sheets_[s].ring.size() == 3) return false;  // would be doubled
        for (int c = 0; c < 3; ++c) {
          const int i = place[c], j = place[(c + 1) % 3];
          if (i < 0 || j < 0) continue;
          problems_[s].forbidden_edges[i] |= std::uint64_t{1} << j;
          problems_[s].forbidden_edges[j] |= std::uint64_t{1} << i;
        }
      }
      if (!is_on_curve) continue;
      const auto has = [&](std::int32_t v) {
        return std::find(facet.vertices.begin(), facet.vertices.end(), v) != facet.vertices.end();
      };
      if (has(p) && has(q)) {
        ++facets_at_closing_edge;
        patch_at_closing_edge = facet.patch;
      }
    }
    if (!is_on_curve) return true;
    // The closing edge p-q is new, or it is the far edge of the one facet of a vanishing sheet,
    // with that sheet's patch going on behind it.
    if (!has_vanishing) return facets_at_closing_edge == 0;
    for (const Sheet& sheet : sheets_)
      if (sheet.facets.size() == 1)
        return facets_at_closing_edge == 1 && patch_at_closing_edge == sheet.patch;
    return false;
  }

  // Normals of the facets across the sides of the rings, found among the nearby facets.
  bool mark_outer_normals() {
    for (auto& problem : problems_)
      problem.outer_normals.assign(problem.ring.size(), Vec3{});
    const auto& points = surfaces_.points();
    for (const auto f : guard_.nearby()) {
      const auto& facet = surfaces_.facets()[f];
      for (std::size_t s = 0; s < sheets_.size(); ++s) {
        if (facet.patch != sheets_[s].patch) continue;
        const auto n = static_cast<int>(sheets_[s].ring.size());
        for (int c = 0; c < 3; ++c) {
          // across the ring the edge runs the other way round
          const int j = place_in(sheets_[s], facet.vertices[c]);
          if (j < 0) continue;
          const int i = place_in(sheets_[s], facet.vertices[(c + 1) % 3]);
          if (i >= 0 && j == (i + 1) % n)
            problems_[s].outer_normals[i] = normalized(area_vector2(
                points[facet.vertices[0]], points[facet.vertices[1]], points[facet.vertices[2]]));
        }
      }
    }
    return true;
  }

  // Looks at the chosen triangles; those that fail are forbidden for the next attempt.
  Refusal check_embedding(std::int32_t vertex) {
    Refusal refusal = Refusal::None;
    const auto forbid = [&](std::size_t sheet, std::size_t triangle, Refusal reason) {
      problems_[sheet].forbidden_triangles.push_back(triangulations_[sheet][triangle]);
      needs_solution_[sheet] = true;
      if (refusal == Refusal::None) refusal = reason;
    };
    created_triples_.clear();
    const Vec3& apex = surfaces_.points()[vertex];
    for (std::size_t s = 0; s < sheets_.size(); ++s)
      for (std::size_t t = 0; t < triangulations_[s].size(); ++t) {
        const auto& [i, j, k] = triangulations_[s][t];
        const VertexTriple triple{sheets_[s].ring[i], sheets_[s].ring[j], sheets_[s].ring[k]};
        created_triples_.push_back({triple, s, t});
        if (guard_.intersects_nearby(triple))
          forbid(s, t, Refusal::Intersection);
        else if (guard_.sweeps_over_vertex(apex, triple))
          forbid(s, t, Refusal::Jump);
      }
    if (refusal != Refusal::None) return refusal;
    for (std::size_t a = 0; a < created_triples_.size(); ++a)
      for (std::size_t b = a + 1; b < created_triples_.size(); ++b)
        if (facets_intersect(surfaces_.points(), created_triples_[a].vertices,
                             created_triples_[b].vertices)) {
          forbid(created_triples_[b].sheet, created_triples_[b].triangle, Refusal::Intersection);
          return refusal;
        }
    return Refusal::None;
  }

  void commit(std::int32_t vertex) {
    for (const auto f : star_)
      guard_.remove(f);
    surfaces_.remove_vertex(vertex, sheets_, triangulations_, created_);
    for (const auto f : created_)
      guard_.insert(f);
  }

  struct CreatedTriple {
    VertexTriple vertices;
    std::size_t sheet, triangle;
  };

  MaterialSurfaces& surfaces_;
  EmbeddingGuard guard_;
  SurfaceObjective objective_;
  std::vector<Sheet> sheets_;
  std::vector<RingProblem> problems_;
  std::vector<Triangulation> triangulations_;
  std::vector<bool> needs_solution_;
  std::vector<std::int32_t> star_, ring_, created_;
  std::vector<CreatedTriple> created_triples_;
};

// The vertices to remove, in random rounds: which round a vertex goes in is random, inside a round
// they go in the order of their ids, which follow the lattice. A round is a random thinning of the
// whole surface, so no front between dense and sparse parts advances (paper, §7.4), and what is
// touched one after the other lies together in memory.
std::vector<std::int32_t> random_queue(const MaterialSurfaces& surfaces,
                                       const std::vector<bool>& keep,
                                       std::uint64_t seed) {
  constexpr double kRounds = 32;
  const CounterRandom random(seed, "decimation");
  std::vector<std::pair<int, std::int32_t>> order;
  for (std::size_t n = 0; n < keep.size(); ++n) {
    const auto v = static_cast<std::int32_t>(n);
    if (!keep[n] && surfaces.is_alive(v))
      order.emplace_back(static_cast<int>(kRounds * random.uniform(n)), v);
  }
  std::sort(order.begin(), order.end());
  std::vector<std::int32_t> queue;
  queue.reserve(order.size());
  for (const auto& [round, v] : order)
    queue.push_back(v);
  return queue;
}

}  // namespace

DecimateResult decimate(MaterialSurfaces surfaces,
                        const std::vector<bool>& keep,
                        double voxel_mm,
                        const DecimateOptions& options,
                        const StageContext& context) {
  DecimateResult result;
  std::vector<std::int32_t> queue = random_queue(surfaces, keep, context.seed);
  const std::size_t total = queue.size();
  std::array<std::size_t, kRefusalNames.size()> refusals{};
  std::vector<Refusal> reason(keep.size(), Refusal::None);

  {
    Decimator decimator(surfaces, voxel_mm, options);
    std::size_t pass = 0;
    while (pass < kPasses.size() && !queue.empty()) {
      std::vector<std::int32_t> deferred;
      for (std::size_t n = 0; n < queue.size(); ++n) {
        reason[queue[n]] = decimator.try_remove(queue[n], kPasses[pass]);
        if (reason[queue[n]] == Refusal::None) {
          ++result.stats.removed;
        } else {
          ++refusals[static_cast<std::size_t>(reason[queue[n]])];
          deferred.push_back(queue[n]);
        }
        if (n % 4096 == 0)
          report_progress(context, "decimation",
                          static_cast<double>(result.stats.removed) /
                              static_cast<double>(std::max<std::size_t>(total, 1)));
      }
      ++result.stats.passes;
      result.stats.deferrals += deferred.size();
      context.log->debug("decimation: limits {}, {} of {} left", pass, deferred.size(),
                         queue.size());
      // the same limits again while they still help one in fifty
      const bool has_stalled = deferred.size() + queue.size() / 50 + 1 > queue.size();
      queue = std::move(deferred);
      if (has_stalled) ++pass;
    }
  }

  for (std::size_t r = 1; r < refusals.size(); ++r)
    if (refusals[r] > 0) result.stats.refusals[kRefusalNames[r]] = refusals[r];
  std::sort(queue.begin(), queue.end());
  for (const auto v : queue)
    result.stats.kept.push_back(
        {v, surfaces.points()[v], kRefusalNames[static_cast<std::size_t>(reason[v])]});
  if (options.on_degenerate == OnDegenerate::Fail && !queue.empty()) {
    const Vec3& p = surfaces.points()[queue.front()];
    throw Error(ErrorCode::StageFailed, "decimation",
                "degenerate vertex distribution: " + std::to_string(queue.size()) +
                    " vertices cannot be removed, the first at (" + std::to_string(p.x) + ", " +
                    std::to_string(p.y) + ", " + std::to_string(p.z) +
                    ") grid mm; lower epsilon or raise r, or set on_degenerate to \"keep\"");
  }
  result.surfaces = std::move(surfaces);
  return result;
}

}  // namespace cvmesh
