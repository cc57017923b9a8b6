// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/tet/tet_part.h"

#include "cvmesh/mesh/facet_index.h"
#include "cvmesh/mesh/facet_predicates.h"

#include <algorithm>
#include <utility>

namespace cvmesh {
namespace {

constexpr std::int32_t kNone = -1;
// What a vertex of the whole is to the part: `kFree` ones have all their tets in it.
constexpr std::uint8_t kElsewhere = 0, kFree = 1, kFrozen = 2;

bool is_outer(const InterfaceMesh& surface, std::size_t f) {
  return surface.patch_of[f].sides.outside == kExterior;
}

Box3 grown(Box3 box, double margin) {
  box.lo -= Vec3{margin, margin, margin};
  box.hi += Vec3{margin, margin, margin};
  return box;
}

}  // namespace

TetPart::TetPart(const TetMesh& whole,
                 const std::vector<std::int32_t>& tets,
                 int rings,
                 double reach_mm) {
  choose_tets(whole, tets, rings);
  choose_facets(whole, reach_mm);
  number_vertices(whole);
}

void TetPart::choose_tets(const TetMesh& whole, const std::vector<std::int32_t>& tets, int rings) {
  role_of_.assign(whole.points.size(), kElsewhere);
  for (const std::int32_t t : tets)
    for (const std::int32_t v : whole.tets[t])
      role_of_[v] = kFree;
  is_here_.assign(whole.tets.size(), false);
  std::vector<std::int32_t> next;
  for (int ring = 0; ring <= rings; ++ring) {
    next.clear();
    for (std::size_t t = 0; t < whole.tets.size(); ++t) {
      if (is_here_[t]) continue;
      const auto& tet = whole.tets[t];
      if (std::none_of(tet.begin(), tet.end(),
                       [&](std::int32_t v) { return role_of_[v] == kFree; }))
        continue;
      is_here_[t] = true;
      for (const std::int32_t v : tet)
        if (role_of_[v] == kElsewhere) next.push_back(v);
    }
    for (const std::int32_t v : next)
      role_of_[v] = ring < rings ? kFree : kFrozen;
  }
}

void TetPart::choose_facets(const TetMesh& whole, double reach_mm) {
  const InterfaceMesh& surface = whole.surface;
  std::vector<std::int32_t> others;
  Box3 bounds;
  for (std::size_t f = 0; f < surface.facets.size(); ++f) {
    const auto& facet = surface.facets[f];
    const bool is_own = std::all_of(facet.begin(), facet.end(),
                                    [&](std::int32_t v) { return role_of_[v] != kElsewhere; });
    (is_own ? facets_ : others).push_back(static_cast<std::int32_t>(f));
    for (const std::int32_t v : facet)
      if (is_own) bounds.add(surface.points[v]);
  }
  own_facets_ = facets_.size();
  if (facets_.empty()) return;
  constexpr double kFacetsAcross = 200;  // of the longest side, roughly
  FacetIndex own(bounds, bounds.diagonal() / kFacetsAcross);
  for (const std::int32_t f : facets_)
    if (is_outer(surface, static_cast<std::size_t>(f)))
      own.insert(f, box_of(surface.points, surface.facets[f]));
  for (const std::int32_t f : others) {
    if (!is_outer(surface, static_cast<std::size_t>(f))) continue;
    bool is_near = false;
    own.query(grown(box_of(surface.points, surface.facets[f]), reach_mm),
              [&](const FacetIndex::Entry&) { is_near = true; });
    if (!is_near) continue;
    facets_.push_back(f);
    for (const std::int32_t v : surface.facets[f])
      if (role_of_[v] == kElsewhere) role_of_[v] = kFrozen;
  }
}

void TetPart::number_vertices(const TetMesh& whole) {
  const std::size_t surface_count = whole.surface.points.size();
  const auto comes_first = [&](std::size_t v) {
    return role_of_[v] == kFrozen || (role_of_[v] == kFree && v < surface_count);
  };
  std::vector<std::int32_t> number(whole.points.size(), kNone);
  const auto add = [&](std::size_t v) {
    number[v] = static_cast<std::int32_t>(whole_of_.size());
    whole_of_.push_back(static_cast<std::int32_t>(v));
    mesh.points.push_back(whole.points[v]);
  };
  for (std::size_t v = 0; v < role_of_.size(); ++v)
    if (comes_first(v)) {
      add(v);
      is_frozen.push_back(role_of_[v] == kFrozen);
    }
  mesh.surface.points = mesh.points;
  for (std::size_t v = surface_count; v < role_of_.size(); ++v)
    if (role_of_[v] == kFree) add(v);
  const auto numbered = [&](auto simplex) {
    for (std::int32_t& v : simplex)
      v = number[v];
    return simplex;
  };
  for (std::size_t t = 0; t < is_here_.size(); ++t) {
    if (!is_here_[t]) continue;
    mesh.tets.push_back(numbered(whole.tets[t]));
    mesh.material_of.push_back(whole.material_of[t]);
  }
  for (const std::int32_t f : facets_) {
    mesh.surface.facets.push_back(numbered(whole.surface.facets[f]));
    mesh.surface.patch_of.push_back(whole.surface.patch_of[f]);
  }
}

std::vector<Vec3> TetPart::of_surface(const std::vector<Vec3>& of_whole) const {
  std::vector<Vec3> values = mesh.surface.points;
  for (std::size_t v = 0; v < is_frozen.size(); ++v)
    if (static_cast<std::size_t>(whole_of_[v]) < of_whole.size())
      values[v] = of_whole[whole_of_[v]];
  return values;
}

void TetPart::put_back(TetMesh& whole) const {
  InterfaceMesh& surface = whole.surface;
  const std::size_t old_count = surface.points.size(), given = is_frozen.size();
  const std::size_t new_count = mesh.surface.points.size() - given;
  for (std::size_t v = 0; v < given; ++v)
    if (static_cast<std::size_t>(whole_of_[v]) < old_count)
      surface.points[whole_of_[v]] = mesh.surface.points[v];
  surface.points.insert(surface.points.end(),
                        mesh.surface.points.begin() + static_cast<std::ptrdiff_t>(given),
                        mesh.surface.points.end());

  // vertices: the surface's, those of the interior that the part left alone, those of the part's
  std::vector<Vec3> points = surface.points;
  std::vector<std::int32_t> number(whole.points.size(), kNone);
  for (std::size_t v = 0; v < whole.points.size(); ++v) {
    if (v < old_count) {
      number[v] = static_cast<std::int32_t>(v);
    } else if (role_of_[v] != kFree) {
      number[v] = static_cast<std::int32_t>(points.size());
      points.push_back(whole.points[v]);
    }
  }
  const auto number_in_whole = [&, kept = points.size()](std::int32_t v) {
    if (static_cast<std::size_t>(v) < given) return number[whole_of_[v]];
    const std::size_t new_vertex = static_cast<std::size_t>(v) - given;
    return static_cast<std::int32_t>(new_vertex < new_count ? old_count + new_vertex
                                                            : kept + new_vertex - new_count);
  };
  points.insert(points.end(), mesh.points.begin() + static_cast<std::ptrdiff_t>(given + new_count),
                mesh.points.end());
  const auto numbered = [&](auto simplex) {
    for (std::int32_t& v : simplex)
      v = number_in_whole(v);
    return simplex;
  };

  for (std::size_t f = 0; f < mesh.surface.facets.size(); ++f) {
    if (f < own_facets_) {
      surface.facets[facets_[f]] = numbered(mesh.surface.facets[f]);
    } else if (f >= facets_.size()) {
      surface.facets.push_back(numbered(mesh.surface.facets[f]));
      surface.patch_of.push_back(mesh.surface.patch_of[f]);
    }
  }
  std::size_t kept = 0;
  for (std::size_t t = 0; t < is_here_.size(); ++t) {
    if (is_here_[t]) continue;
    whole.tets[kept] = whole.tets[t];
    for (std::int32_t& v : whole.tets[kept])
      v = number[v];
    whole.material_of[kept++] = whole.material_of[t];
  }
  whole.tets.resize(kept);
  whole.material_of.resize(kept);
  for (const auto& tet : mesh.tets)
    whole.tets.push_back(numbered(tet));
  whole.material_of.insert(whole.material_of.end(), mesh.material_of.begin(),
                           mesh.material_of.end());
  whole.points = std::move(points);
}

}  // namespace cvmesh
