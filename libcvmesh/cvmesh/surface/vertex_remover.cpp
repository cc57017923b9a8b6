// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/surface/vertex_remover.h"

#include "cvmesh/core/id_bits.h"
#include "cvmesh/core/parallel.h"
#include "cvmesh/mesh/flat_triangle.h"
#include "cvmesh/surface/embedding_guard.h"
#include "cvmesh/surface/independent_batches.h"

#include <tbb/enumerable_thread_specific.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <span>
#include <utility>

namespace cvmesh {
namespace {

using Sheet = MaterialSurfaces::Sheet;
using Triangulation = MaterialSurfaces::Triangulation;

// Samples of a facet that rank triangulations; the exact assignment afterwards uses all.
constexpr std::size_t kRankingSamples = 16;

// What the removal of one vertex would do; or why it cannot be done.
struct RemovalPlan {
  std::int32_t vertex = -1;
  Refusal refusal = Refusal::None;
  Box3 box;  // of all that is replaced and all that replaces it; nothing else was looked at
  std::vector<Sheet> sheets;
  std::vector<Triangulation> triangulations;
  std::vector<std::uint16_t> heirs;  // see `MaterialSurfaces::Removal`
};

// Plans removals. Only looks at the surfaces: planners of several threads work at the same time.
class RemovalPlanner {
 public:
  RemovalPlanner(const MaterialSurfaces& surfaces,
                 const FacetIndex& index,
                 double voxel_mm,
                 double deviation_mm)
      : surfaces_(surfaces),
        guard_(surfaces, index, kClearanceVox * voxel_mm),
        objective_{deviation_mm} {}

  /// Begins a plan: the sheets around the vertex, and the box that they span.
  void outline(std::int32_t vertex, RemovalPlan& plan) const {
    plan.vertex = vertex;
    plan.refusal =
        surfaces_.collect_sheets(vertex, plan.sheets) ? Refusal::None : Refusal::Topology;
    const auto& points = surfaces_.points();
    plan.box = {};
    plan.box.add(points[vertex]);
    if (plan.refusal != Refusal::None) return;
    for (const Sheet& sheet : plan.sheets) {
      if (sheet.ring.size() > RingProblem::kMaxRing) plan.refusal = Refusal::Topology;
      for (const auto v : sheet.ring)
        plan.box.add(points[v]);
    }
  }

  /// Completes a plan, while nothing in its box has changed.
  void complete(const RingLimits& limits, RemovalPlan& plan) {
    if (plan.refusal == Refusal::None) plan.refusal = find_triangulations(limits, plan);
    if (plan.refusal == Refusal::None) choose_heirs(plan);
  }

 private:
  Refusal find_triangulations(const RingLimits& limits, RemovalPlan& plan) {
    look_around(plan);
    if (!set_up_problems(plan)) return Refusal::Topology;
    // Each attempt forbids the triangles that the last optimum failed with.
    constexpr int kMaxAttempts = 12;
    Refusal refusal = Refusal::Shape;
    for (int attempt = 0; attempt < kMaxAttempts; ++attempt) {
      plan.triangulations.resize(plan.sheets.size());
      for (std::size_t s = 0; s < plan.sheets.size(); ++s) {
        if (attempt > 0 && !needs_solution_[s]) continue;
        auto solution = triangulate_ring(problems_[s], limits, objective_);
        if (!solution) return attempt == 0 ? Refusal::Shape : refusal;
        plan.triangulations[s] = std::move(*solution);
      }
      needs_solution_.assign(plan.sheets.size(), false);
      const Refusal now = check_embedding(plan);
      if (now == Refusal::None) return Refusal::None;
      refusal = now;
    }
    return refusal;
  }

  void look_around(const RemovalPlan& plan) {
    star_.clear();
    ring_.clear();
    for (const Sheet& sheet : plan.sheets) {
      star_.insert(star_.end(), sheet.facets.begin(), sheet.facets.end());
      ring_.insert(ring_.end(), sheet.ring.begin(), sheet.ring.end());
    }
    guard_.begin(plan.box, star_, ring_);
  }

  // Rings, normals, samples and forbidden edges of all sheets; false where the complex forbids the
  // removal whatever the triangulation.
  bool set_up_problems(const RemovalPlan& plan) {
    problems_.resize(std::max(problems_.size(), plan.sheets.size()));
    needs_solution_.assign(plan.sheets.size(), true);
    samples_.assign(1, surfaces_.points()[plan.vertex]);
    samples_end_.clear();
    int vanishing = 0;
    for (std::size_t s = 0; s < plan.sheets.size(); ++s) {
      const Sheet& sheet = plan.sheets[s];
      RingProblem& problem = problems_[s];
      problem.clear(sheet.ring.size());
      problem.is_disk = sheet.is_disk;
      if (!sheet.is_disk && sheet.facets.size() == 1) ++vanishing;
      for (const auto v : sheet.ring)
        problem.ring.push_back(surfaces_.points()[v]);
      gather_samples(plan.vertex, sheet, problem);
      samples_end_.push_back(samples_.size());
    }
    if (vanishing > 1) return false;
    return mark_surroundings(plan.sheets, vanishing == 1);
  }

  void gather_samples(std::int32_t vertex, const Sheet& sheet, RingProblem& problem) {
    problem.samples.push_back(surfaces_.points()[vertex]);
    Vec3 normal;
    double area = 0;
    for (const auto f : sheet.facets) {
      const auto& v = surfaces_.facets()[f].vertices;
      const auto& p = surfaces_.points();
      const Vec3 twice = area_vector2(p[v[0]], p[v[1]], p[v[2]]);
      normal += twice;
      area += norm(twice) / 2;
      const std::size_t begin = samples_.size();
      surfaces_.for_each_sample(f, [&](const Vec3& sample) { samples_.push_back(sample); });
      const std::size_t count = samples_.size() - begin;
      const std::size_t stride = (count + kRankingSamples - 1) / kRankingSamples;
      for (std::size_t n = 0; n < count; n += stride)
        problem.samples.push_back(samples_[begin + n]);
    }
    problem.normal = normalized(normal);
    problem.spacing_mm = std::sqrt(area / static_cast<double>(problem.samples.size()));
  }

  [[nodiscard]] static int place_in(const Sheet& sheet, std::int32_t vertex) {
    const auto it = std::find(sheet.ring.begin(), sheet.ring.end(), vertex);
    return it == sheet.ring.end() ? -1 : static_cast<int>(it - sheet.ring.begin());
  }

  // From the facets around the star: normals across the sides of the rings, and edges between ring
  // vertices, which may not be made again. False where these forbid the removal.
  bool mark_surroundings(const std::vector<Sheet>& sheets, bool has_vanishing) {
    const std::int32_t p = sheets.front().ring.front(), q = sheets.front().ring.back();
    const IdBits ring_bits(ring_);
    int facets_at_closing_edge = 0;
    PatchKey patch_at_closing_edge;
    for (const auto& entry : guard_.nearby()) {
      const auto& facet = surfaces_.facets()[entry.id];
      if (std::count_if(facet.vertices.begin(), facet.vertices.end(),
                        [&](std::int32_t v) { return ring_bits.may_hold(v); }) < 2)
        continue;
      for (std::size_t s = 0; s < sheets.size(); ++s) {
        const std::array<int, 3> place{place_in(sheets[s], facet.vertices[0]),
                                       place_in(sheets[s], facet.vertices[1]),
                                       place_in(sheets[s], facet.vertices[2])};
        const auto found = 3 - std::count(place.begin(), place.end(), -1);
        if (found < 2) continue;
        if (found == 3 && sheets[s].ring.size() == 3) return false;  // would be doubled
        mark_edges(facet, place, facet.patch == sheets[s].patch, problems_[s]);
      }
      const auto has = [&](std::int32_t v) {
        return std::find(facet.vertices.begin(), facet.vertices.end(), v) != facet.vertices.end();
      };
      if (has(p) && has(q)) {
        ++facets_at_closing_edge;
        patch_at_closing_edge = facet.patch;
      }
    }
    if (sheets.front().is_disk) return true;
    // On a curve, the closing edge p-q is new, or it is the far edge of the one facet of a
    // vanishing sheet, with that sheet's patch going on behind it.
    if (!has_vanishing) return facets_at_closing_edge == 0;
    for (const Sheet& sheet : sheets)
      if (sheet.facets.size() == 1)
        return facets_at_closing_edge == 1 && patch_at_closing_edge == sheet.patch;
    return false;
  }

  // A facet with its corners' places in the ring of a problem, -1 for those that are not in it.
  void mark_edges(const MaterialSurfaces::Facet& facet,
                  const std::array<int, 3>& place,
                  bool is_of_patch,
                  RingProblem& problem) const {
    const auto n = static_cast<int>(problem.ring.size());
    for (int c = 0; c < 3; ++c) {
      const int i = place[c], j = place[(c + 1) % 3];
      if (i < 0 || j < 0) continue;
      problem.forbidden_edges[i] |= std::uint64_t{1} << j;
      problem.forbidden_edges[j] |= std::uint64_t{1} << i;
      // across the ring the edge runs the other way round
      if (!is_of_patch || i != (j + 1) % n) continue;
      const auto& points = surfaces_.points();
      problem.outer_normals[j] = normalized(area_vector2(
          points[facet.vertices[0]], points[facet.vertices[1]], points[facet.vertices[2]]));
    }
  }

  // Looks at the chosen triangles; those that fail are forbidden for the next attempt.
  Refusal check_embedding(const RemovalPlan& plan) {
    Refusal refusal = Refusal::None;
    const auto forbid = [&](std::size_t sheet, std::size_t triangle, Refusal reason) {
      problems_[sheet].forbidden_triangles.push_back(plan.triangulations[sheet][triangle]);
      needs_solution_[sheet] = true;
      if (refusal == Refusal::None) refusal = reason;
    };
    list_created(plan);
    const Vec3& apex = surfaces_.points()[plan.vertex];
    for (const CreatedTriple& created : created_)
      if (guard_.intersects_nearby(created.vertices))
        forbid(created.sheet, created.triangle, Refusal::Intersection);
      else if (guard_.sweeps_over_part(apex, created.vertices))
        forbid(created.sheet, created.triangle, Refusal::Jump);
    if (refusal != Refusal::None) return refusal;
    for (std::size_t a = 0; a < created_.size(); ++a)
      for (std::size_t b = a + 1; b < created_.size(); ++b)
        if (facets_intersect(surfaces_.points(), created_[a].vertices, created_[b].vertices)) {
          forbid(created_[b].sheet, created_[b].triangle, Refusal::Intersection);
          return refusal;
        }
    return Refusal::None;
  }

  void list_created(const RemovalPlan& plan) {
    created_.clear();
    for (std::size_t s = 0; s < plan.sheets.size(); ++s)
      for (std::size_t t = 0; t < plan.triangulations[s].size(); ++t) {
        const auto& [i, j, k] = plan.triangulations[s][t];
        const auto& ring = plan.sheets[s].ring;
        created_.push_back({{ring[i], ring[j], ring[k]}, s, t});
      }
  }

  // Every sample goes to the nearest triangle of its own sheet; from a sheet that vanishes, and for
  // the vertex itself, to the nearest of all.
  void choose_heirs(RemovalPlan& plan) {
    triangles_.clear();
    for (const CreatedTriple& created : created_) {
      const auto& [a, b, c] = created.vertices;
      triangles_.emplace_back(surfaces_.points()[a], surfaces_.points()[b], surfaces_.points()[c]);
    }
    plan.heirs.clear();
    add_nearest({samples_.data(), 1}, 0, triangles_.size(), plan.heirs);
    std::size_t begin = 0, sample = 1;
    for (std::size_t s = 0; s < plan.sheets.size(); ++s) {
      const std::size_t end = begin + plan.triangulations[s].size();
      const std::span<const Vec3> samples{samples_.data() + sample, samples_end_[s] - sample};
      if (begin == end)
        add_nearest(samples, 0, triangles_.size(), plan.heirs);
      else
        add_nearest(samples, begin, end, plan.heirs);
      begin = end;
      sample = samples_end_[s];
    }
  }

  // For each sample the first of the nearest triangles begin to end - 1; two samples at a time.
  void add_nearest(std::span<const Vec3> samples,
                   std::size_t begin,
                   std::size_t end,
                   std::vector<std::uint16_t>& heirs) const {
    for (std::size_t n = 0; n < samples.size(); n += 2) {
      const bool is_pair = n + 1 < samples.size();
      const Vec3Pair pair(samples[n], samples[is_pair ? n + 1 : n]);
      DoublePair least = both(std::numeric_limits<double>::infinity());
      std::array<std::uint16_t, 2> nearest{static_cast<std::uint16_t>(begin),
                                           static_cast<std::uint16_t>(begin)};
      for (std::size_t t = begin; t < end; ++t) {
        const DoublePair d2 = triangles_[t].squared_distance(pair);
        for (int lane = 0; lane < 2; ++lane)
          if (d2[lane] < least[lane]) nearest[lane] = static_cast<std::uint16_t>(t);
        least = smaller_of(d2, least);
      }
      heirs.push_back(nearest[0]);
      if (is_pair) heirs.push_back(nearest[1]);
    }
  }

  struct CreatedTriple {
    VertexTriple vertices;
    std::size_t sheet, triangle;
  };

  const MaterialSurfaces& surfaces_;
  EmbeddingGuard guard_;
  SurfaceObjective objective_;
  std::vector<RingProblem> problems_;
  std::vector<bool> needs_solution_;
  std::vector<std::int32_t> star_, ring_;
  std::vector<CreatedTriple> created_;
  std::vector<FlatTriangle> triangles_;   // the same
  std::vector<Vec3> samples_;             // of the vertex itself, then sheet by sheet
  std::vector<std::size_t> samples_end_;  // by sheet
};

}  // namespace

class VertexRemover::Batches {
 public:
  Batches(MaterialSurfaces& surfaces, double voxel_mm, double deviation_mm)
      : surfaces_(surfaces),
        index_(index_facets(surfaces, voxel_mm)),
        planners_([this, voxel_mm, deviation_mm] {
          return RemovalPlanner(surfaces_, index_, voxel_mm, deviation_mm);
        }) {}

  void try_each(const std::vector<std::int32_t>& queue,
                const RingLimits& limits,
                const std::function<void(std::int32_t, Refusal)>& tell) {
    batches_.for_each(
        queue, [&](const std::vector<std::int32_t>& candidates) { outline(candidates); },
        [&](std::size_t n) -> const Box3& { return plans_[n].box; },
        [&](const std::vector<std::size_t>& batch) {
          parallel_for_each_index(
              0, batch.size(),
              [&](std::size_t n) { planners_.local().complete(limits, plans_[batch[n]]); }, kGrain);
          removals_.clear();
          for (const std::size_t n : batch) {
            const RemovalPlan& plan = plans_[n];
            if (plan.refusal == Refusal::None)
              removals_.push_back({plan.vertex, plan.sheets, plan.triangulations, plan.heirs});
            tell(plan.vertex, plan.refusal);
          }
          surfaces_.remove_vertices(removals_, [&] { update_index(); });
          planned_ += batch.size();
        });
  }

  [[nodiscard]] std::size_t planned() const { return planned_; }

 private:
  static constexpr std::size_t kGrain = 8;

  void outline(const std::vector<std::int32_t>& candidates) {
    plans_.resize(std::max(plans_.size(), candidates.size()));
    parallel_for_each_index(
        0, candidates.size(),
        [&](std::size_t n) { planners_.local().outline(candidates[n], plans_[n]); }, kGrain);
  }

  void update_index() {
    for (const MaterialSurfaces::Removal& removal : removals_) {
      for (const Sheet& sheet : removal.sheets)
        for (const auto f : sheet.facets)
          index_.remove(f);
      for (std::size_t s = 0; s < removal.sheets.size(); ++s)
        for (std::size_t t = 0; t < removal.triangulations[s].size(); ++t)
          insert_facet(surfaces_, removal.sheets[s].facets[t], index_);
    }
  }

  MaterialSurfaces& surfaces_;
  FacetIndex index_;
  tbb::enumerable_thread_specific<RemovalPlanner> planners_;
  std::vector<RemovalPlan> plans_;  // of the candidates
  std::vector<MaterialSurfaces::Removal> removals_;
  IndependentBatches batches_;
  std::size_t planned_ = 0;
};

VertexRemover::VertexRemover(MaterialSurfaces& surfaces, double voxel_mm, double deviation_mm)
    : batches_(std::make_unique<Batches>(surfaces, voxel_mm, deviation_mm)) {}

VertexRemover::~VertexRemover() = default;

void VertexRemover::try_each(const std::vector<std::int32_t>& queue,
                             const RingLimits& limits,
                             const std::function<void(std::int32_t, Refusal)>& tell) {
  batches_->try_each(queue, limits, tell);
}

std::size_t VertexRemover::planned() const {
  return batches_->planned();
}

}  // namespace cvmesh
