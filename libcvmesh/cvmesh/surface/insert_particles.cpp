// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/surface/insert_particles.h"

#include "cvmesh/core/error.h"
#include "cvmesh/surface/embedding_guard.h"

#include <algorithm>
#include <array>
#include <limits>
#include <map>
#include <span>
#include <string>
#include <utility>

namespace cvmesh {
namespace {

// A moved vertex may not turn a facet by more than this, nor flatten it below this quality.
constexpr double kMinTurnCosine = 0.3;
constexpr double kMinMovedQuality = 0.002;
// Nor fold two facets of a patch more sharply (10 degrees, as the last pass of decimation). Turns
// add up where all corners of a facet move: without this bound facets came to lie on each other to
// the last bit, and neither decimation nor flips unfold what only has particles for corners.
constexpr double kMinFoldCosine = -0.985;
// A particle takes over a free dense vertex within this part of the facet's or edge's size;
// otherwise it gets a vertex of its own.
constexpr double kSnapShare = 0.5;
/// Over a voxel: no vertex is made nearer than this to another one. Where particles crowd at the
/// end of a dense edge, each would get a tenth of what the one before left: edges down to 5e-8
/// voxel, and tetrahedra that no file can hold.
constexpr double kLeastSpacingVox = 0.01;

class Inserter {
 public:
  Inserter(MaterialSurfaces& surfaces, const Strata& strata, double voxel_mm)
      : surfaces_(surfaces),
        strata_(strata),
        index_(index_facets(surfaces, voxel_mm)),
        guard_(surfaces, index_, 0),
        least_spacing_mm_(kLeastSpacingVox * voxel_mm),
        is_taken_(surfaces.points().size(), false) {}

  std::int32_t insert(const Particle& particle, InsertParticlesStats& stats) {
    switch (particle.dimension) {
      case 0:
        return take_corner(particle.carrier[0], particle.position, stats);
      case 1:
        return insert_on_curve(particle, stats);
      default:
        return insert_on_patch(particle, stats);
    }
  }

 private:
  // A corner has no other vertex to be: it stays where it is when it cannot move.
  std::int32_t take_corner(std::int32_t vertex, const Vec3& position, InsertParticlesStats& stats) {
    is_taken_.resize(surfaces_.points().size(), false);
    require(!is_taken_[vertex], ErrorCode::StageFailed, "insertion",
            "two particles ask for dense vertex " + std::to_string(vertex));
    is_taken_[vertex] = true;
    ++stats.snapped;
    if (!try_move(vertex, position)) ++stats.off_position;
    return vertex;
  }

  // Snaps a free dense vertex to a particle where it can move there.
  bool try_take(std::int32_t vertex, const Vec3& position, InsertParticlesStats& stats) {
    if (!try_move(vertex, position)) return false;
    is_taken_.resize(surfaces_.points().size(), false);
    is_taken_[vertex] = true;
    ++stats.snapped;
    return true;
  }

  // The vertex stands for one more particle, where it is.
  std::int32_t share(std::int32_t vertex, InsertParticlesStats& stats) {
    is_taken_.resize(surfaces_.points().size(), false);
    is_taken_[vertex] = true;
    ++stats.shared;
    return vertex;
  }

  // The first of the vertices that is too near to a new one at p, or -1.
  [[nodiscard]] std::int32_t crowded_vertex(const Vec3& p,
                                            std::span<const std::int32_t> vertices) const {
    const auto near = std::find_if(vertices.begin(), vertices.end(), [&](std::int32_t v) {
      return distance(surfaces_.points()[v], p) < least_spacing_mm_;
    });
    return near == vertices.end() ? -1 : *near;
  }

  std::int32_t take_new(std::int32_t vertex, const Vec3& position, InsertParticlesStats& stats) {
    is_taken_.resize(surfaces_.points().size(), false);
    is_taken_[vertex] = true;
    if (!try_move(vertex, position)) ++stats.off_position;
    return vertex;
  }

  [[nodiscard]] bool is_free(std::int32_t vertex, int dimension) const {
    return static_cast<std::size_t>(vertex) < strata_.dimension.size() && !is_taken_[vertex] &&
           strata_.dimension[vertex] == dimension;
  }

  // Moves a vertex unless that folds a facet, makes facets meet, or jumps over something.
  bool try_move(std::int32_t vertex, const Vec3& position) {
    const Vec3 old = surfaces_.points()[vertex];
    if (old == position) return true;
    surfaces_.collect_star(vertex, star_);
    const auto& points = surfaces_.points();
    Box3 box;
    box.add(position);
    ring_.assign(1, vertex);
    for (const auto f : star_)
      for (const auto v : surfaces_.facets()[f].vertices) {
        box.add(points[v]);
        ring_.push_back(v);
      }
    guard_.begin(box, star_, ring_);
    if (!keeps_shape(vertex, position)) return false;
    const double fold_before = sharpest_fold();
    for (const auto f : star_)
      index_.remove(f);
    surfaces_.move_vertex(vertex, position);
    // what the dense surface folds more sharply may stay so
    bool is_good = sharpest_fold() >= std::min(fold_before, kMinFoldCosine);
    for (std::size_t a = 0; a < star_.size() && is_good; ++a) {
      const auto& t = surfaces_.facets()[star_[a]].vertices;
      is_good = !guard_.intersects_nearby(t) && !guard_.sweeps_over_part(old, t);
      for (std::size_t b = a + 1; b < star_.size() && is_good; ++b)
        is_good = !facets_intersect(points, t, surfaces_.facets()[star_[b]].vertices);
    }
    if (!is_good) surfaces_.move_vertex(vertex, old);
    for (const auto f : star_)
      insert_facet(surfaces_, f, index_);
    return is_good;
  }

  /// The least cosine between the normals of a facet of the star and its neighbours in the patch.
  [[nodiscard]] double sharpest_fold() const {
    const auto normal_of = [&](std::int32_t f) {
      const auto& points = surfaces_.points();
      const auto& [a, b, c] = surfaces_.facets()[f].vertices;
      return normalized(area_vector2(points[a], points[b], points[c]));
    };
    double least = 1;
    for (const auto f : star_) {
      const auto& corners = surfaces_.facets()[f].vertices;
      for (std::size_t c = 0; c < 3; ++c) {
        std::int32_t first = -1, second = -1;
        if (surfaces_.facets_of_edge(corners[c], corners[(c + 1) % 3], first, second))
          least = std::min(least, dot(normal_of(first), normal_of(second)));
      }
    }
    return least;
  }

  [[nodiscard]] bool keeps_shape(std::int32_t vertex, const Vec3& position) const {
    const auto& points = surfaces_.points();
    for (const auto f : star_) {
      std::array<Vec3, 3> before, after;
      for (int c = 0; c < 3; ++c) {
        const auto v = surfaces_.facets()[f].vertices[c];
        before[c] = points[v];
        after[c] = v == vertex ? position : points[v];
      }
      const Vec3 n0 = normalized(area_vector2(before[0], before[1], before[2]));
      const Vec3 n1 = normalized(area_vector2(after[0], after[1], after[2]));
      if (dot(n0, n1) < kMinTurnCosine) return false;
      // poor facets (a clamped cut point) may stay as poor as they are
      const double quality = triangle_quality(after[0], after[1], after[2]);
      if (quality < kMinMovedQuality && quality < triangle_quality(before[0], before[1], before[2]))
        return false;
    }
    return true;
  }

  std::int32_t insert_on_curve(const Particle& particle, InsertParticlesStats& stats) {
    const std::int32_t a = particle.carrier[0], b = particle.carrier[1];
    const auto& points = surfaces_.points();
    const double reach = kSnapShare * distance(points[a], points[b]);
    const bool a_is_nearer =
        distance(points[a], particle.position) <= distance(points[b], particle.position);
    for (const auto v : {a_is_nearer ? a : b, a_is_nearer ? b : a})
      if (is_free(v, 1) && distance(points[v], particle.position) <= reach &&
          try_take(v, particle.position, stats))
        return v;
    // the piece of the (possibly already split) dense edge that is nearest
    auto& chain = chains_[std::minmax(a, b)];
    if (chain.empty()) chain = {std::min(a, b), std::max(a, b)};
    std::size_t piece = 0;
    double least = std::numeric_limits<double>::infinity();
    for (std::size_t n = 0; n + 1 < chain.size(); ++n) {
      const Vec3 on = nearest_on_segment(particle.position, points[chain[n]], points[chain[n + 1]]);
      if (distance(on, particle.position) < least) {
        least = distance(on, particle.position);
        piece = n;
      }
    }
    const std::array<std::int32_t, 2> ends{chain[piece], chain[piece + 1]};
    const Vec3 at = point_on_edge(ends[0], ends[1], particle.position);
    if (const auto near = crowded_vertex(at, ends); near >= 0) return share(near, stats);
    const std::int32_t v = split_edge(ends[0], ends[1], at);
    chain.insert(chain.begin() + static_cast<std::ptrdiff_t>(piece) + 1, v);
    ++stats.edge_splits;
    return take_new(v, particle.position, stats);
  }

  // The point of an edge nearest to `position`, kept off its ends.
  [[nodiscard]] Vec3 point_on_edge(std::int32_t a, std::int32_t b, const Vec3& position) const {
    const auto& points = surfaces_.points();
    const Vec3 d = points[b] - points[a];
    const double t = std::clamp(dot(position - points[a], d) / squared_norm(d), 0.1, 0.9);
    return points[a] + t * d;
  }

  std::int32_t split_edge(std::int32_t a, std::int32_t b, const Vec3& at) {
    star_.clear();
    std::vector<std::int32_t> around_b;
    surfaces_.collect_star(a, star_);
    surfaces_.collect_star(b, around_b);
    for (const auto f : star_)
      if (std::find(around_b.begin(), around_b.end(), f) != around_b.end()) index_.remove(f);
    const std::int32_t v = surfaces_.split_edge(a, b, at);
    surfaces_.collect_star(v, star_);
    for (const auto f : star_)
      insert_facet(surfaces_, f, index_);
    return v;
  }

  std::int32_t insert_on_patch(const Particle& particle, InsertParticlesStats& stats) {
    const auto carrier = surfaces_.facets()[particle.carrier[0]];
    if (const auto v = free_vertex_near(carrier, particle.position);
        v >= 0 && try_take(v, particle.position, stats))
      return v;
    const std::int32_t f = nearest_facet(carrier, particle.position);
    const auto corners = surfaces_.facets()[f].vertices;
    const auto& points = surfaces_.points();
    const Vec3 on = nearest_on_triangle(particle.position, points[corners[0]], points[corners[1]],
                                        points[corners[2]]);
    if (const auto [a, b] = side_to_split(f, on); a >= 0) {
      const Vec3 at = point_on_edge(a, b, on);
      if (const auto near = crowded_vertex(at, corners); near >= 0) return share(near, stats);
      ++stats.edge_splits;
      return take_new(split_edge(a, b, at), particle.position, stats);
    }
    // off the sides, so that no new facet is flat
    const Vec3 center = (points[corners[0]] + points[corners[1]] + points[corners[2]]) / 3;
    const Vec3 at = on + 0.15 * (center - on);
    if (const auto near = crowded_vertex(at, corners); near >= 0) return share(near, stats);
    index_.remove(f);
    const std::int32_t v = surfaces_.split_facet(f, at);
    surfaces_.collect_star(v, star_);
    for (const auto g : star_)
      insert_facet(surfaces_, g, index_);
    ++stats.facet_splits;
    return take_new(v, particle.position, stats);
  }

  // The side of facet f nearest to a point in it, where it is so near that splitting the facet
  // there would leave a thin one; or -1, -1. Where several particles lie in one needle, facets
  // nested in it would be flat to the last bit, and no flip could help them.
  [[nodiscard]] std::pair<std::int32_t, std::int32_t> side_to_split(std::int32_t f,
                                                                    const Vec3& point) const {
    constexpr double kAreaShare = 0.1;
    constexpr double kLeastSlope = 0.1;  // of the new facet at the side's nearer end
    const auto& corners = surfaces_.facets()[f].vertices;
    const auto& points = surfaces_.points();
    const double area2 =
        norm(area_vector2(points[corners[0]], points[corners[1]], points[corners[2]]));
    std::pair<std::int32_t, std::int32_t> nearest(-1, -1);
    double least = std::numeric_limits<double>::infinity();
    for (std::size_t c = 0; c < 3; ++c) {
      const auto a = corners[c], b = corners[(c + 1) % 3];
      const double part2 = norm(area_vector2(points[a], points[b], point));
      const double height = part2 / distance(points[a], points[b]);
      const double to_end = std::min(distance(points[a], point), distance(points[b], point));
      std::int32_t first = -1, second = -1;
      if ((part2 > kAreaShare * area2 && height > kLeastSlope * to_end) || height >= least ||
          !surfaces_.facets_of_edge(a, b, first, second))
        continue;
      least = height;
      nearest = {a, b};
    }
    return nearest;
  }

  // The nearest free vertex of the carrier facet within reach, or -1.
  [[nodiscard]] std::int32_t free_vertex_near(const MaterialSurfaces::Facet& carrier,
                                              const Vec3& position) const {
    const auto& points = surfaces_.points();
    double longest = 0;
    for (int c = 0; c < 3; ++c)
      longest = std::max(
          longest, distance(points[carrier.vertices[c]], points[carrier.vertices[(c + 1) % 3]]));
    std::int32_t best = -1;
    double least = kSnapShare * longest;
    for (const auto v : carrier.vertices)
      if (is_free(v, 2) && distance(points[v], position) <= least) {
        least = distance(points[v], position);
        best = v;
      }
    return best;
  }

  // The facet of the carrier's patch nearest to a position, among those within two rings of the
  // carrier's corners (the carrier itself may have been split since).
  std::int32_t nearest_facet(const MaterialSurfaces::Facet& carrier, const Vec3& position) {
    const auto& points = surfaces_.points();
    std::vector<std::int32_t> corners(carrier.vertices.begin(), carrier.vertices.end()), star;
    std::int32_t best = -1;
    double least = std::numeric_limits<double>::infinity();
    for (int ring = 0; ring < 2; ++ring) {
      std::vector<std::int32_t> next;
      for (const auto v : corners) {
        surfaces_.collect_star(v, star);
        for (const auto f : star) {
          const auto& facet = surfaces_.facets()[f];
          if (facet.patch != carrier.patch) continue;
          next.insert(next.end(), facet.vertices.begin(), facet.vertices.end());
          const double d =
              distance(nearest_on_triangle(position, points[facet.vertices[0]],
                                           points[facet.vertices[1]], points[facet.vertices[2]]),
                       position);
          if (d < least || (d == least && f < best)) {
            least = d;
            best = f;
          }
        }
      }
      std::sort(next.begin(), next.end());
      next.erase(std::unique(next.begin(), next.end()), next.end());
      corners = std::move(next);
    }
    return best;
  }

  MaterialSurfaces& surfaces_;
  const Strata& strata_;
  FacetIndex index_;
  EmbeddingGuard guard_;
  double least_spacing_mm_;
  std::vector<bool> is_taken_;
  std::map<std::pair<std::int32_t, std::int32_t>, std::vector<std::int32_t>> chains_;
  std::vector<std::int32_t> star_, ring_;
};

}  // namespace

InsertParticlesResult insert_particles(MaterialSurfaces surfaces,
                                       const Strata& strata,
                                       const ParticleSet& particles,
                                       double voxel_mm,
                                       const StageContext& context) {
  InsertParticlesResult result;
  Inserter inserter(surfaces, strata, voxel_mm);
  const std::size_t count = particles.particles.size();
  for (std::size_t p = 0; p < count; ++p) {
    result.vertex_of.push_back(inserter.insert(particles.particles[p], result.stats));
    if (p % 4096 == 0)
      report_progress(context, "insertion", static_cast<double>(p) / static_cast<double>(count));
  }
  result.surfaces = std::move(surfaces);
  return result;
}

}  // namespace cvmesh
