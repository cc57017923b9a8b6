// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/surface/embedding_guard.h"

#include "cvmesh/core/id_bits.h"

#include <algorithm>

namespace cvmesh {
namespace {

/// Side of the smallest cells of the index over the mean longest side of the facets' boxes; and the
/// bounds of that side over a voxel. Dense facets fit into the largest one. Where many labels meet
/// in each voxel facets are smaller, and cells of that size would hold hundreds.
constexpr double kCellOverFacet = 2.5, kFinestVox = 0.5, kCoarsestVox = 1.5;

Box3 bounds_of(const MaterialSurfaces& surfaces) {
  Box3 box;
  for (std::size_t v = 0; v < surfaces.points().size(); ++v)
    if (surfaces.is_alive(static_cast<std::int32_t>(v))) box.add(surfaces.points()[v]);
  return box;
}

/// Of the longest sides of the facets' boxes.
double mean_side(const MaterialSurfaces& surfaces) {
  double sum = 0;
  std::size_t count = 0;
  for (const auto& facet : surfaces.facets()) {
    if (!facet.is_alive) continue;
    const Vec3 extent = box_of(surfaces.points(), facet.vertices).extent();
    sum += std::max({extent.x, extent.y, extent.z});
    ++count;
  }
  return sum / static_cast<double>(std::max<std::size_t>(count, 1));
}

Box3 grown(Box3 box, double margin) {
  box.lo -= margin * Vec3{1, 1, 1};
  box.hi += margin * Vec3{1, 1, 1};
  return box;
}

bool holds(std::span<const std::int32_t> ids, std::int32_t id) {
  return std::find(ids.begin(), ids.end(), id) != ids.end();
}

}  // namespace

FacetIndex index_facets(const MaterialSurfaces& surfaces, double voxel_mm) {
  FacetIndex index(bounds_of(surfaces), std::clamp(kCellOverFacet * mean_side(surfaces),
                                                   kFinestVox * voxel_mm, kCoarsestVox * voxel_mm));
  for (std::size_t f = 0; f < surfaces.facets().size(); ++f)
    if (surfaces.facets()[f].is_alive) insert_facet(surfaces, static_cast<std::int32_t>(f), index);
  return index;
}

void insert_facet(const MaterialSurfaces& surfaces, std::int32_t facet, FacetIndex& index) {
  index.insert(facet, box_of(surfaces.points(), surfaces.facets()[facet].vertices));
}

void EmbeddingGuard::begin(const Box3& box,
                           std::span<const std::int32_t> replaced,
                           std::span<const std::int32_t> ring) {
  nearby_.clear();
  nearby_vertices_.clear();
  middles_.clear();
  // Facets and points lie all over the memory: asked for together, they are waited for once.
  const IdBits replaced_bits(replaced);
  index_.query(grown(box, clearance_mm_), [&](const FacetIndex::Entry& entry) {
    if (replaced_bits.may_hold(entry.id) && holds(replaced, entry.id)) return;
    nearby_.push_back(entry);
    __builtin_prefetch(&surfaces_.facets()[entry.id]);
  });
  for (const FacetIndex::Entry& entry : nearby_)
    for (const auto v : surfaces_.facets()[entry.id].vertices)
      __builtin_prefetch(&surfaces_.points()[v]);
  const auto& p = surfaces_.points();
  for (const FacetIndex::Entry& entry : nearby_) {
    const VertexTriple& t = surfaces_.facets()[entry.id].vertices;
    int on_ring = 0;
    for (const auto v : t) {
      if (!box.contains(p[v])) continue;
      if (holds(ring, v))
        ++on_ring;
      else if (!holds(nearby_vertices_, v))
        nearby_vertices_.push_back(v);
    }
    if (on_ring == 3) middles_.push_back((p[t[0]] + p[t[1]] + p[t[2]]) / 3);
  }
}

bool EmbeddingGuard::intersects_nearby(const VertexTriple& t) const {
  const FloatBox box(grown(box_of(surfaces_.points(), t), clearance_mm_));
  return std::any_of(nearby_.begin(), nearby_.end(), [&](const FacetIndex::Entry& entry) {
    if (!entry.box.overlaps(box)) return false;
    const VertexTriple& s = surfaces_.facets()[entry.id].vertices;
    // without a clearance to spare, only the exact test will do
    if (!(clearance_mm_ > 0)) return facets_intersect(surfaces_.points(), t, s);
    if (are_facets_apart(surfaces_.points(), s, t, clearance_mm_)) return false;
    return facets_intersect(surfaces_.points(), t, s) ||
           are_facets_near(surfaces_.points(), s, t, clearance_mm_);
  });
}

bool EmbeddingGuard::sweeps_over_part(const Vec3& apex, const VertexTriple& t) const {
  const auto& p = surfaces_.points();
  Box3 box = box_of(p, t);
  box.add(apex);
  const auto is_swept = [&](const Vec3& point) {
    return box.contains(point) && is_in_tet(point, apex, p[t[0]], p[t[1]], p[t[2]]);
  };
  return std::any_of(nearby_vertices_.begin(), nearby_vertices_.end(),
                     [&](std::int32_t v) { return is_swept(p[v]); }) ||
         std::any_of(middles_.begin(), middles_.end(), is_swept);
}

}  // namespace cvmesh
