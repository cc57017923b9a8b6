// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/surface/fit_vertices.h"

#include "cvmesh/core/parallel.h"
#include "cvmesh/core/random.h"
#include "cvmesh/mesh/flat_triangle.h"
#include "cvmesh/surface/embedding_guard.h"
#include "cvmesh/surface/independent_batches.h"

#include <tbb/enumerable_thread_specific.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <utility>
#include <vector>

namespace cvmesh {
namespace {

/// Shorter steps, over a voxel, are not worth the tests.
constexpr double kLeastStepVox = 0.005;
/// A move must take this share of the sum of squares around the vertex.
constexpr double kLeastGain = 0.005;
/// After longer steps, over a voxel, the neighbours look again.
constexpr double kWakingStepVox = 0.02;
/// Steps are tried in full, then in half and so on.
constexpr int kMostTries = 3;
/// No facet may become poorer than this share of what it was, or of a good one.
constexpr double kShapeKept = 0.8, kGoodShape = 0.6;
/// Normals this far apart (75 degrees) are a fold, and no edge may be folded more than it was.
constexpr double kFoldCosine = 0.26;

double quality(const MaterialSurfaces& surfaces, const VertexTriple& t) {
  const auto& p = surfaces.points();
  return triangle_quality(p[t[0]], p[t[1]], p[t[2]]);
}

Vec3 unit_normal(const MaterialSurfaces& surfaces, const VertexTriple& t) {
  const auto& p = surfaces.points();
  return normalized(area_vector2(p[t[0]], p[t[1]], p[t[2]]));
}

/// The samples of each facet side by side: as lists, most of the time went into waiting for memory.
class FacetSamples {
 public:
  explicit FacetSamples(const MaterialSurfaces& surfaces) {
    const std::size_t count = surfaces.facets().size();
    first_.reserve(count + 1);
    positions_.reserve(surfaces.samples().size());
    for (std::size_t f = 0; f < count; ++f) {
      first_.push_back(positions_.size());
      if (surfaces.facets()[f].is_alive)
        surfaces.for_each_sample(static_cast<std::int32_t>(f),
                                 [&](const Vec3& s) { positions_.push_back(s); });
    }
    first_.push_back(positions_.size());
  }

  [[nodiscard]] std::span<const Vec3> of(std::int32_t facet) const {
    return {positions_.data() + first_[facet],
            positions_.data() + first_[static_cast<std::size_t>(facet) + 1]};
  }

  [[nodiscard]] std::size_t count() const { return positions_.size(); }

 private:
  std::vector<std::size_t> first_;
  std::vector<Vec3> positions_;
};

/// Of points to triangle abc: the sum of the squared distances.
double sum_of_squares(std::span<const Vec3> points, const Vec3& a, const Vec3& b, const Vec3& c) {
  const FlatTriangle triangle(a, b, c);
  double sum = 0;
  std::size_t n = 0;
  for (; n + 1 < points.size(); n += 2) {
    const DoublePair mm2 = triangle.squared_distance({points[n], points[n + 1]});
    sum += mm2[0] + mm2[1];
  }
  if (n < points.size()) sum += triangle.squared_distance({points[n], points[n]})[0];
  return sum;
}

double root_mean_square(const MaterialSurfaces& surfaces, const FacetSamples& samples) {
  const auto& p = surfaces.points();
  const double sum = deterministic_reduce(
      0, surfaces.facets().size(), 0.0,
      [&](std::size_t f) {
        const auto& [a, b, c] = surfaces.facets()[f].vertices;
        const auto facet = static_cast<std::int32_t>(f);
        return sum_of_squares(samples.of(facet), p[a], p[b], p[c]);
      },
      std::plus<>());
  return samples.count() > 0 ? std::sqrt(sum / static_cast<double>(samples.count())) : 0;
}

/// Normal equations of a least squares problem for one step.
class NormalEquations {
 public:
  /// More rows, all along `direction`: the step's component there should be wanted / weight.
  void add(const Vec3& direction, double weight, double wanted) {
    x_ += weight * direction.x * direction;
    y_ += weight * direction.y * direction;
    z_ += weight * direction.z * direction;
    right_ += wanted * direction;
  }

  /// @pre the rows span all directions (Cramer's rule)
  [[nodiscard]] Vec3 solve() const {
    const Vec3 yz = cross(y_, z_);
    return (right_.x * yz + right_.y * cross(z_, x_) + right_.z * cross(x_, y_)) / dot(x_, yz);
  }

 private:
  Vec3 x_, y_, z_;  // rows of the matrix, which is symmetric
  Vec3 right_;
};

/// The facets around a vertex while it tries other places.
class Star {
 public:
  Star(const MaterialSurfaces& surfaces, const FacetSamples& samples)
      : surfaces_(surfaces), samples_(samples) {}

  /// @param facets  those around v
  /// @pre nothing around the vertex changes from here on but its own place
  void look_at(std::int32_t v, const std::vector<std::int32_t>& facets) {
    ids_ = facets;
    std::sort(ids_.begin(), ids_.end());
    facets_.clear();
    ring_.clear();
    for (const auto f : ids_) {
      VertexTriple t = surfaces_.facets()[f].vertices;
      while (t[0] != v)
        std::rotate(t.begin(), t.begin() + 1, t.end());
      facets_.push_back({f, t, unit_normal(surfaces_, t)});
      for (const auto u : t)
        if (std::find(ring_.begin(), ring_.end(), u) == ring_.end()) ring_.push_back(u);
    }
    find_folds();
  }

  [[nodiscard]] const std::vector<std::int32_t>& facets() const { return ids_; }

  /// The vertex itself and its neighbours.
  [[nodiscard]] const std::vector<std::int32_t>& ring() const { return ring_; }

  /// Where the squared distances of the samples to the planes of the facets are least, the vertex's
  /// own distance to `home` among them.
  [[nodiscard]] Vec3 best_place(const Vec3& home) const {
    const auto& p = surfaces_.points();
    const Vec3& here = p[facets_.front().vertices[0]];
    NormalEquations equations;
    for (const Facet& facet : facets_) {
      const Vec3 &b = p[facet.vertices[1]], &c = p[facet.vertices[2]];
      const Vec3 inwards = cross(facet.normal, c - b);  // from the edge across
      const double full = dot(here - b, inwards);
      // All rows of a facet point along its normal.
      double weights = 0, wanted = 0;
      for (const Vec3& sample : samples_.of(facet.id)) {
        const double weight = std::clamp(dot(sample - b, inwards) / full, 0.0, 1.0);
        weights += weight * weight;
        wanted += weight * dot(sample - here, facet.normal);
      }
      if (full > 0) equations.add(facet.normal, weights, wanted);
    }
    for (const Vec3& axis : {Vec3{1, 0, 0}, Vec3{0, 1, 0}, Vec3{0, 0, 1}})
      equations.add(axis, 1, dot(axis, home - here));
    return here + equations.solve();
  }

  /// What is minimised, as far as it depends on the vertex.
  [[nodiscard]] double squares(const Vec3& home) const {
    const auto& p = surfaces_.points();
    double sum = squared_norm(p[facets_.front().vertices[0]] - home);
    for (const Facet& facet : facets_) {
      const auto& [a, b, c] = facet.vertices;
      sum += sum_of_squares(samples_.of(facet.id), p[a], p[b], p[c]);
    }
    return sum;
  }

  /// @param first_quality  of every facet, before the first move of all
  [[nodiscard]] bool keeps_shapes(const std::vector<double>& first_quality) const {
    for (const Facet& facet : facets_) {
      const double least = kShapeKept * std::min(first_quality[facet.id], kGoodShape);
      if (quality(surfaces_, facet.vertices) < least) return false;
    }
    return std::all_of(folds_.begin(), folds_.end(), [&](const Fold& fold) {
      const Vec3 normal = unit_normal(surfaces_, facets_[fold.facet].vertices);
      const Vec3 other =
          fold.other ? unit_normal(surfaces_, facets_[*fold.other].vertices) : fold.across;
      return dot(normal, other) >= std::min(fold.cosine, kFoldCosine);
    });
  }

  /// The facets are apart from what is nearby and from each other, and nothing is between them and
  /// where they were with the vertex at `from`.
  [[nodiscard]] bool is_embedded(const EmbeddingGuard& guard, const Vec3& from) const {
    const auto& p = surfaces_.points();
    for (std::size_t n = 0; n < facets_.size(); ++n) {
      const VertexTriple& t = facets_[n].vertices;
      if (guard.intersects_nearby(t) || guard.sweeps_over_part(from, t)) return false;
      for (const auto u : ring_)
        if (u != t[0] && u != t[1] && u != t[2] && is_in_tet(p[u], from, p[t[0]], p[t[1]], p[t[2]]))
          return false;
      for (std::size_t m = 0; m < n; ++m)
        if (facets_intersect(p, t, facets_[m].vertices)) return false;
    }
    return true;
  }

 private:
  struct Facet {
    std::int32_t id;
    VertexTriple vertices;  // the one that moves comes first
    Vec3 normal;
  };

  /// Two facets of one patch with an edge in common, one of them in the star.
  struct Fold {
    std::size_t facet;                 // number in `facets_`
    std::optional<std::size_t> other;  // likewise; none where it lies across the ring
    Vec3 across;                       // its normal there
    double cosine;
  };

  void find_folds() {
    folds_.clear();
    for (std::size_t i = 0; i < facets_.size(); ++i) {
      const Facet& facet = facets_[i];
      const auto other = surfaces_.facet_across(facet.id, facet.vertices[1], facet.vertices[2]);
      if (other >= 0) {
        const Vec3 across = unit_normal(surfaces_, surfaces_.facets()[other].vertices);
        folds_.push_back({i, std::nullopt, across, dot(facet.normal, across)});
      }
      for (std::size_t j = 0; j < facets_.size(); ++j)
        if (facets_[j].vertices[2] == facet.vertices[1] &&
            surfaces_.facets()[facets_[j].id].patch == surfaces_.facets()[facet.id].patch)
          folds_.push_back({i, j, {}, dot(facet.normal, facets_[j].normal)});
    }
  }

  const MaterialSurfaces& surfaces_;
  const FacetSamples& samples_;
  std::vector<std::int32_t> ids_, ring_;
  std::vector<Facet> facets_;
  std::vector<Fold> folds_;
};

/// Moves the vertices of a batch at the same time. A vertex whose box (its star, wherever it may
/// move it to) meets that of another one waits for it, so nobody reads a place that is written.
class VertexFitter {
 public:
  VertexFitter(MaterialSurfaces& surfaces,
               const FacetSamples& samples,
               double voxel_mm,
               double max_shift_mm,
               std::uint64_t seed)
      : surfaces_(surfaces),
        index_(index_facets(surfaces, voxel_mm)),
        clearance_mm_(kClearanceVox * voxel_mm),
        least_step_mm_(kLeastStepVox * voxel_mm),
        waking_step_mm_(kWakingStepVox * voxel_mm),
        max_shift_mm_(max_shift_mm),
        home_(surfaces.points()),
        is_free_(home_.size(), false),
        first_quality_(surfaces.facets().size(), 0),
        workers_([this, &samples] {
          return Worker{Star(surfaces_, samples), EmbeddingGuard(surfaces_, index_, clearance_mm_)};
        }) {
    for (std::size_t v = 0; v < home_.size(); ++v)
      is_free_[v] = surfaces.is_alive(static_cast<std::int32_t>(v));
    for (std::size_t f = 0; f < first_quality_.size(); ++f) {
      const auto& facet = surfaces.facets()[f];
      if (!facet.is_alive) continue;
      first_quality_[f] = quality(surfaces, facet.vertices);
      if (facet.patch.wall == 0) continue;
      for (const auto v : facet.vertices)
        is_free_[v] = false;
    }
    const CounterRandom random(seed, "vertex fit");
    for (std::size_t v = 0; v < home_.size(); ++v)
      if (is_free_[v]) order_.push_back(static_cast<std::int32_t>(v));
    std::sort(order_.begin(), order_.end(), [&](std::int32_t a, std::int32_t b) {
      return std::pair(random.bits(static_cast<std::size_t>(a)), a) <
             std::pair(random.bits(static_cast<std::size_t>(b)), b);
    });
    is_due_ = is_free_;
  }

  /// Looks at every vertex around which something has changed. @return moves
  /// @param tell  called after every batch with the share that is done; may throw
  template <typename Tell>
  std::size_t sweep(const Tell& tell) {
    std::vector<std::int32_t> queue;
    for (const auto v : order_)
      if (is_due_[v]) queue.push_back(v);
    for (const auto v : queue)
      is_due_[v] = false;
    std::size_t moves = 0, done = 0;
    batches_.for_each(
        queue,
        [&](const std::vector<std::int32_t>& candidates) {
          tries_.resize(std::max(tries_.size(), candidates.size()));
          parallel_for_each_index(
              0, candidates.size(), [&](std::size_t n) { outline(candidates[n], tries_[n]); },
              kGrain);
        },
        [&](std::size_t n) -> const Box3& { return tries_[n].box; },
        [&](const std::vector<std::size_t>& batch) {
          parallel_for_each_index(
              0, batch.size(), [&](std::size_t n) { fit(tries_[batch[n]]); }, kGrain);
          for (const std::size_t n : batch) {
            refused_ += tries_[n].outcome == Outcome::Refused ? 1 : 0;
            if (tries_[n].outcome != Outcome::Moved) continue;
            settle(tries_[n]);
            ++moves;
          }
          done += batch.size();
          tell(static_cast<double>(done) / static_cast<double>(queue.size()));
        });
    return moves;
  }

  [[nodiscard]] std::size_t refused() const { return refused_; }

  /// Where the vertices were.
  [[nodiscard]] const std::vector<Vec3>& home() const { return home_; }

 private:
  static constexpr std::size_t kGrain = 8;

  enum class Outcome { Stays, Moved, Refused };

  struct Try {
    std::int32_t vertex = -1;
    Box3 box;
    std::vector<std::int32_t> facets, ring;
    Outcome outcome = Outcome::Stays;
    bool wakes = false;  // the neighbours
  };

  struct Worker {
    Star star;
    EmbeddingGuard guard;
  };

  void outline(std::int32_t v, Try& attempt) const {
    attempt.vertex = v;
    surfaces_.collect_star(v, attempt.facets);
    attempt.box = {};
    for (const auto f : attempt.facets)
      for (const auto u : surfaces_.facets()[f].vertices)
        attempt.box.add(surfaces_.points()[u]);
    const Vec3 reach = max_shift_mm_ * Vec3{1, 1, 1}, margin = 2 * clearance_mm_ * Vec3{1, 1, 1};
    attempt.box.add(home_[v] - reach);
    attempt.box.add(home_[v] + reach);
    attempt.box = {attempt.box.lo - margin, attempt.box.hi + margin};
  }

  void fit(Try& attempt) {
    attempt.outcome = Outcome::Stays;
    auto& [star, guard] = workers_.local();
    const std::int32_t v = attempt.vertex;
    star.look_at(v, attempt.facets);
    attempt.ring = star.ring();
    const Vec3 from = surfaces_.points()[v], &home = home_[v];
    Vec3 shift = star.best_place(home) - home;
    if (const double length = norm(shift); length > max_shift_mm_) shift *= max_shift_mm_ / length;
    const Vec3 step = home + shift - from;
    if (norm(step) < least_step_mm_) return;
    Box3 box;
    box.add(from + step);
    for (const auto u : star.ring())
      box.add(surfaces_.points()[u]);
    guard.begin(box, star.facets(), star.ring());
    const double enough = (1 - kLeastGain) * star.squares(home);
    double share = 1;
    for (int k = 0; k < kMostTries; ++k, share /= 2) {
      surfaces_.move_vertex(v, from + share * step);
      if (star.squares(home) > enough) continue;
      attempt.outcome = Outcome::Refused;
      if (!star.keeps_shapes(first_quality_) || !star.is_embedded(guard, from)) continue;
      attempt.outcome = Outcome::Moved;
      attempt.wakes = share * norm(step) > waking_step_mm_;
      return;
    }
    surfaces_.move_vertex(v, from);
  }

  void settle(const Try& attempt) {
    for (const auto f : attempt.facets) {
      index_.remove(f);
      insert_facet(surfaces_, f, index_);
    }
    if (!attempt.wakes) return;
    for (const auto u : attempt.ring)
      is_due_[u] = is_free_[u];
  }

  MaterialSurfaces& surfaces_;
  FacetIndex index_;
  double clearance_mm_, least_step_mm_, waking_step_mm_, max_shift_mm_;
  std::vector<Vec3> home_;
  std::vector<char> is_free_, is_due_;  // by vertex
  std::vector<double> first_quality_;   // by facet
  std::vector<std::int32_t> order_;     // of the vertices, random
  tbb::enumerable_thread_specific<Worker> workers_;
  IndependentBatches batches_;
  std::vector<Try> tries_;
  std::size_t refused_ = 0;
};

/// How far the vertices are from where they were.
void measure_shifts(const MaterialSurfaces& surfaces,
                    const std::vector<Vec3>& home,
                    FitVerticesStats& stats) {
  double sum = 0;
  for (std::size_t v = 0; v < home.size(); ++v) {
    const double shift = distance(home[v], surfaces.points()[v]);
    if (shift == 0) continue;
    ++stats.vertices;
    sum += shift;
    stats.max_shift_mm = std::max(stats.max_shift_mm, shift);
  }
  if (stats.vertices > 0) stats.mean_shift_mm = sum / static_cast<double>(stats.vertices);
}

}  // namespace

FitVerticesResult fit_vertices(MaterialSurfaces surfaces,
                               double voxel_mm,
                               const FitVerticesOptions& options,
                               const StageContext& context) {
  FitVerticesResult result;
  FitVerticesStats& stats = result.stats;
  const FacetSamples samples(surfaces);
  stats.rms_before_mm = stats.rms_after_mm = root_mean_square(surfaces, samples);
  if (options.max_shift_vox > 0) {
    VertexFitter fitter(surfaces, samples, voxel_mm, options.max_shift_vox * voxel_mm,
                        context.seed);
    for (std::size_t moves = 1; moves > 0 && stats.sweeps < options.max_sweeps; ++stats.sweeps) {
      moves = fitter.sweep([&](double share) {
        report_progress(context, "vertex fit", (stats.sweeps + share) / options.max_sweeps);
      });
    }
    stats.refused = fitter.refused();
    measure_shifts(surfaces, fitter.home(), stats);
    stats.rms_after_mm = root_mean_square(surfaces, samples);
  }
  result.surfaces = std::move(surfaces);
  return result;
}

}  // namespace cvmesh
