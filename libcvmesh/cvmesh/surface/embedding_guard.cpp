// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/surface/embedding_guard.h"

namespace cvmesh {
namespace {

Box3 bounds_of(const MaterialSurfaces& surfaces) {
  Box3 box;
  for (std::size_t v = 0; v < surfaces.points().size(); ++v)
    if (surfaces.is_alive(static_cast<std::int32_t>(v))) box.add(surfaces.points()[v]);
  return box;
}

}  // namespace

EmbeddingGuard::EmbeddingGuard(const MaterialSurfaces& surfaces, double voxel_mm)
    : surfaces_(surfaces), index_(bounds_of(surfaces), voxel_mm) {
  for (std::size_t f = 0; f < surfaces.facets().size(); ++f)
    if (surfaces.facets()[f].is_alive) insert(static_cast<std::int32_t>(f));
}

void EmbeddingGuard::insert(std::int32_t facet) {
  index_.insert(facet, box_of(surfaces_.points(), surfaces_.facets()[facet].vertices));
}

void EmbeddingGuard::begin(const Box3& box, std::span<const std::int32_t> replaced) {
  facet_stamp_.resize(surfaces_.facets().size(), 0);
  vertex_stamp_.resize(surfaces_.points().size(), 0);
  ++stamp_;
  for (const auto f : replaced)
    facet_stamp_[f] = stamp_;
  nearby_.clear();
  nearby_box_.clear();
  nearby_vertices_.clear();
  index_.query(box, [&](std::int32_t f) {
    if (facet_stamp_[f] != stamp_) nearby_.push_back(f);
  });
  for (const auto f : nearby_)
    nearby_box_.push_back(box_of(surfaces_.points(), surfaces_.facets()[f].vertices));
}

void EmbeddingGuard::mark_ring(std::span<const std::int32_t> vertices) {
  for (const auto v : vertices)
    vertex_stamp_[v] = stamp_;
  for (const auto f : nearby_)
    for (const auto v : surfaces_.facets()[f].vertices)
      if (vertex_stamp_[v] != stamp_) {
        vertex_stamp_[v] = stamp_;
        nearby_vertices_.push_back(v);
      }
}

bool EmbeddingGuard::intersects_nearby(const VertexTriple& t) const {
  const Box3 box = box_of(surfaces_.points(), t);
  for (std::size_t n = 0; n < nearby_.size(); ++n)
    if (nearby_box_[n].overlaps(box) &&
        facets_intersect(surfaces_.points(), t, surfaces_.facets()[nearby_[n]].vertices))
      return true;
  return false;
}

bool EmbeddingGuard::sweeps_over_vertex(const Vec3& apex, const VertexTriple& t) const {
  const auto& p = surfaces_.points();
  Box3 box = box_of(p, t);
  box.add(apex);
  for (const auto v : nearby_vertices_)
    if (box.contains(p[v]) && is_in_tet(p[v], apex, p[t[0]], p[t[1]], p[t[2]])) return true;
  return false;
}

}  // namespace cvmesh
