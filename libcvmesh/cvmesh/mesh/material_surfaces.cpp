// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/mesh/material_surfaces.h"

#include "cvmesh/core/assert.h"
#include "cvmesh/core/error.h"
#include "cvmesh/core/parallel.h"
#include "cvmesh/mesh/local_numbers.h"

#include <CGAL/boost/graph/Euler_operations.h>

#include <algorithm>
#include <limits>
#include <string>
#include <tuple>
#include <utility>

namespace cvmesh {

MaterialSurfaces::MaterialSurfaces(const InterfaceMesh& mesh, std::size_t material_count)
    : meshes_(material_count), points_(mesh.points), copies_(mesh.points.size()) {
  facets_.resize(mesh.facets.size());
  std::vector<std::vector<std::int32_t>> facets_of(material_count);
  for (std::size_t f = 0; f < mesh.facets.size(); ++f) {
    facets_[f] = {mesh.facets[f], mesh.patch_of[f], {}, {}, -1, true};
    facets_of[mesh.patch_of[f].sides.inside].push_back(static_cast<std::int32_t>(f));
    facets_of[mesh.patch_of[f].sides.outside].push_back(static_cast<std::int32_t>(f));
  }
  for (auto& m : meshes_) {
    vertex_id_.push_back(m.add_property_map<VertexCopy, std::int32_t>("v:id", -1).first);
    facet_id_.push_back(m.add_property_map<Face, std::int32_t>("f:id", -1).first);
  }
  parallel_for_each_index(
      0, material_count,
      [&](std::size_t m) { build_material(static_cast<MaterialId>(m), facets_of[m]); }, 1);
  for (std::size_t m = 0; m < material_count; ++m)
    for (const auto v : meshes_[m].vertices())
      copies_[vertex_id_[m][v]].push_back({static_cast<MaterialId>(m), v});
  for (const auto& c : copies_)
    vertex_count_ += c.empty() ? 0 : 1;
}

// Links halfedges by sorted edges instead of face by face: the order of insertion cannot fail.
void MaterialSurfaces::build_material(MaterialId m, const std::vector<std::int32_t>& facet_ids) {
  HalfedgeMesh& mesh = meshes_[m];

  std::vector<std::array<std::int32_t, 3>> corners(facet_ids.size());
  for (std::size_t f = 0; f < facet_ids.size(); ++f) {
    const Facet& facet = facets_[facet_ids[f]];
    corners[f] = facet.vertices;
    if (facet.patch.sides.inside != m) std::swap(corners[f][1], corners[f][2]);
  }
  const LocalNumbers numbers(corners);
  for (auto& triple : corners)
    for (auto& v : triple)
      v = numbers(v);
  const std::vector<std::int32_t>& ids = numbers.vertices();
  const std::vector<FacetSide> sides = sides_by_edge(corners, ids.size());

  mesh.reserve(static_cast<HalfedgeMesh::size_type>(ids.size()),
               static_cast<HalfedgeMesh::size_type>(sides.size() / 2),
               static_cast<HalfedgeMesh::size_type>(facet_ids.size()));
  for (const auto id : ids)
    vertex_id_[m][mesh.add_vertex()] = id;
  std::vector<Halfedge> halfedge_at(sides.size());
  const auto are_of_one_edge = [&](std::size_t s, std::size_t t) {
    return t < sides.size() && sides[s].a == sides[t].a && sides[s].b == sides[t].b;
  };
  for (std::size_t s = 0; s < sides.size(); s += 2) {
    if (!are_of_one_edge(s, s + 1) || are_of_one_edge(s, s + 2))
      throw Error(ErrorCode::Internal, "surfaces",
                  "the boundary of material " + std::to_string(m) +
                      " is not a closed 2-manifold at edge " + std::to_string(ids[sides[s].a]) +
                      "-" + std::to_string(ids[sides[s].b]));
    const Halfedge h = mesh.add_edge();
    halfedge_at[sides[s].place] = h;
    halfedge_at[sides[s + 1].place] = mesh.opposite(h);
  }
  for (std::size_t f = 0; f < facet_ids.size(); ++f) {
    const Face face = mesh.add_face();
    facet_id_[m][face] = facet_ids[f];
    Facet& facet = facets_[facet_ids[f]];
    // each facet is written by two materials, each its own member
    (facet.patch.sides.inside == m ? facet.inside_face : facet.outside_face) = face;
    for (std::size_t c = 0; c < 3; ++c) {
      const Halfedge h = halfedge_at[3 * f + c];
      const auto target = VertexCopy(static_cast<HalfedgeMesh::size_type>(corners[f][(c + 1) % 3]));
      mesh.set_target(h, target);
      mesh.set_halfedge(target, h);
      mesh.set_face(h, face);
      mesh.set_next(h, halfedge_at[3 * f + (c + 1) % 3]);
    }
    mesh.set_halfedge(face, halfedge_at[3 * f]);
  }
}

bool MaterialSurfaces::collect_sheets(std::int32_t vertex, std::vector<Sheet>& sheets) const {
  sheets.clear();
  for (const Copy& copy : copies_[vertex]) {
    const MaterialId m = copy.material;
    const HalfedgeMesh& mesh = meshes_[m];
    const auto patch_at = [&](Halfedge h) -> const PatchKey& {
      return facets_[facet_id_[m][mesh.face(h)]].patch;
    };
    const Halfedge start = mesh.halfedge(copy.vertex);
    // counter-clockwise: from halfedge u_i -> v to u_{i+1} -> v over facet (v, u_i, u_{i+1})
    const auto following = [&](Halfedge h) { return mesh.prev(mesh.opposite(h)); };
    Halfedge h = start;
    int curve_edges = 0;
    Halfedge first_curve_edge = start;
    do {
      if (patch_at(h) != patch_at(following(h))) {
        if (curve_edges == 0) first_curve_edge = h;
        ++curve_edges;
      }
      h = following(h);
    } while (h != start);
    if (curve_edges != 0 && curve_edges != 2) return false;
    // A sheet is read in the mesh of its inside material only, where its facets are
    // counter-clockwise.
    h = first_curve_edge;
    const Halfedge begin = h;
    do {
      const Halfedge next = following(h);
      const PatchKey& patch = patch_at(next);
      if (patch.sides.inside == m) {
        const bool is_new = sheets.empty() || sheets.back().patch != patch;
        if (is_new) {
          sheets.emplace_back();
          sheets.back().patch = patch;
          sheets.back().is_disk = curve_edges == 0;
          sheets.back().ring.push_back(vertex_id_[m][mesh.source(h)]);
        }
        sheets.back().facets.push_back(facet_id_[m][mesh.face(next)]);
        sheets.back().ring.push_back(vertex_id_[m][mesh.source(next)]);
      }
      h = next;
    } while (h != begin);
    if (!sheets.empty() && sheets.back().is_disk && sheets.back().patch.sides.inside == m)
      sheets.back().ring.pop_back();
  }
  std::sort(sheets.begin(), sheets.end(),
            [](const Sheet& a, const Sheet& b) { return a.patch < b.patch; });
  return true;
}

void MaterialSurfaces::collect_star(std::int32_t vertex, std::vector<std::int32_t>& facets) const {
  facets.clear();
  for (const Copy& copy : copies_[vertex]) {
    const HalfedgeMesh& mesh = meshes_[copy.material];
    const Halfedge start = mesh.halfedge(copy.vertex);
    Halfedge h = start;
    do {
      const std::int32_t f = facet_id_[copy.material][mesh.face(h)];
      if (facets_[f].patch.sides.inside == copy.material) facets.push_back(f);
      h = mesh.opposite(mesh.next(h));
    } while (h != start);
  }
}

MaterialSurfaces::VertexCopy MaterialSurfaces::copy_in(std::int32_t vertex, MaterialId m) const {
  for (const Copy& copy : copies_[vertex])
    if (copy.material == m) return copy.vertex;
  return HalfedgeMesh::null_vertex();
}

MaterialSurfaces::Halfedge MaterialSurfaces::halfedge_between(MaterialId m,
                                                              std::int32_t source,
                                                              std::int32_t target) const {
  const HalfedgeMesh& mesh = meshes_[m];
  const VertexCopy v = copy_in(target, m);
  if (v == HalfedgeMesh::null_vertex()) return HalfedgeMesh::null_halfedge();
  const Halfedge start = mesh.halfedge(v);
  Halfedge h = start;
  do {
    if (vertex_id_[m][mesh.source(h)] == source) return h;
    h = mesh.opposite(mesh.next(h));
  } while (h != start);
  return HalfedgeMesh::null_halfedge();
}

bool MaterialSurfaces::facets_of_edge(std::int32_t a,
                                      std::int32_t b,
                                      std::int32_t& first,
                                      std::int32_t& second) const {
  for (const Copy& copy : copies_[a]) {
    const MaterialId m = copy.material;
    const Halfedge h = halfedge_between(m, a, b);
    if (h == HalfedgeMesh::null_halfedge()) continue;
    const std::int32_t left = facet_id_[m][meshes_[m].face(h)];
    const std::int32_t right = facet_id_[m][meshes_[m].face(meshes_[m].opposite(h))];
    if (facets_[left].patch != facets_[right].patch) return false;
    const bool is_inside = facets_[left].patch.sides.inside == m;
    first = is_inside ? left : right;
    second = is_inside ? right : left;
    return true;
  }
  return false;
}

std::int32_t MaterialSurfaces::facet_across(std::int32_t facet,
                                            std::int32_t a,
                                            std::int32_t b) const {
  const MaterialId m = facets_[facet].patch.sides.inside;
  const HalfedgeMesh& mesh = meshes_[m];
  Halfedge h = mesh.halfedge(facets_[facet].inside_face);
  for (int side = 0; side < 3; ++side, h = mesh.next(h)) {
    const std::int32_t source = vertex_id_[m][mesh.source(h)];
    const std::int32_t target = vertex_id_[m][mesh.target(h)];
    if ((source != a || target != b) && (source != b || target != a)) continue;
    const std::int32_t other = facet_id_[m][mesh.face(mesh.opposite(h))];
    return facets_[other].patch == facets_[facet].patch ? other : -1;
  }
  return -1;
}

std::int32_t MaterialSurfaces::add_vertex(const Vec3& position) {
  points_.push_back(position);
  copies_.emplace_back();
  ++vertex_count_;
  return static_cast<std::int32_t>(points_.size() - 1);
}

std::int32_t MaterialSurfaces::add_facet(const Facet& facet) {
  if (free_facets_.empty()) {
    facets_.push_back(facet);
    return static_cast<std::int32_t>(facets_.size() - 1);
  }
  const std::int32_t id = free_facets_.back();
  free_facets_.pop_back();
  facets_[id] = facet;
  return id;
}

// Ties the face at halfedge h of material m to the facet among `facets` that has its vertices.
void MaterialSurfaces::attach(MaterialId m, Halfedge h, const std::vector<std::int32_t>& facets) {
  const HalfedgeMesh& mesh = meshes_[m];
  const std::array<std::int32_t, 3> corners{vertex_id_[m][mesh.source(h)],
                                            vertex_id_[m][mesh.target(h)],
                                            vertex_id_[m][mesh.target(mesh.next(h))]};
  for (const std::int32_t f : facets) {
    Facet& facet = facets_[f];
    if (facet.patch.sides.inside != m && facet.patch.sides.outside != m) continue;
    if (!std::is_permutation(corners.begin(), corners.end(), facet.vertices.begin())) continue;
    const Face face = mesh.face(h);
    facet_id_[m][face] = f;
    (facet.patch.sides.inside == m ? facet.inside_face : facet.outside_face) = face;
    return;
  }
  throw Error(ErrorCode::Internal, "surfaces", "a face has no facet to mirror");
}

// Unlinks the samples of some facets and joins them to one list, in order. @return its head
std::int32_t MaterialSurfaces::take_samples(std::span<const std::int32_t> facets) {
  std::int32_t head = -1, last = -1;
  for (const std::int32_t f : facets)
    for (std::int32_t s = std::exchange(facets_[f].first_sample, -1); s >= 0; s = next_sample_[s]) {
      (last < 0 ? head : next_sample_[last]) = s;
      last = s;
    }
  return head;
}

// Hands the samples of a list to the facets that `heirs` says.
void MaterialSurfaces::give_to_heirs(std::int32_t sample,
                                     std::span<const std::uint16_t> heirs,
                                     const std::vector<std::int32_t>& facets) {
  for (const std::uint16_t heir : heirs) {
    CVMESH_ASSERT(sample >= 0 && heir < facets.size());
    std::int32_t& first = facets_[facets[heir]].first_sample;
    const std::int32_t next = std::exchange(next_sample_[sample], first);
    first = sample;
    sample = next;
  }
  CVMESH_ASSERT(sample < 0);
}

// Hands every sample of a list to the nearest of some facets (ties: the first).
void MaterialSurfaces::give_samples(std::int32_t sample, const std::vector<std::int32_t>& facets) {
  while (sample >= 0) {
    const std::int32_t next = next_sample_[sample];
    std::int32_t nearest = facets.front();
    double least = std::numeric_limits<double>::infinity();
    for (const std::int32_t f : facets) {
      const auto& v = facets_[f].vertices;
      const Vec3& p = samples_[sample];
      const double d2 =
          squared_norm(nearest_on_triangle(p, points_[v[0]], points_[v[1]], points_[v[2]]) - p);
      if (d2 < least) {
        least = d2;
        nearest = f;
      }
    }
    next_sample_[sample] = facets_[nearest].first_sample;
    facets_[nearest].first_sample = sample;
    sample = next;
  }
}

std::int32_t MaterialSurfaces::split_facet(std::int32_t facet, const Vec3& position) {
  const Facet old = facets_[facet];
  const std::int32_t sample_list = take_samples({&facet, 1});
  const std::int32_t center = add_vertex(position);
  std::vector<std::int32_t> created;
  for (int c = 0; c < 3; ++c) {
    const Facet part{
        {old.vertices[c], old.vertices[(c + 1) % 3], center}, old.patch, {}, {}, -1, true};
    if (c == 0) facets_[facet] = part;
    created.push_back(c == 0 ? facet : add_facet(part));
  }
  for (const MaterialId m : {old.patch.sides.inside, old.patch.sides.outside}) {
    HalfedgeMesh& mesh = meshes_[m];
    const Face face = m == old.patch.sides.inside ? old.inside_face : old.outside_face;
    const Halfedge spoke = CGAL::Euler::add_center_vertex(mesh.halfedge(face), mesh);
    const VertexCopy v = mesh.target(spoke);
    vertex_id_[m][v] = center;
    copies_[center].push_back({m, v});
    Halfedge h = spoke;
    for (int c = 0; c < 3; ++c, h = mesh.opposite(mesh.next(h)))
      attach(m, h, created);
  }
  give_samples(sample_list, created);
  return center;
}

std::int32_t MaterialSurfaces::split_edge(std::int32_t a, std::int32_t b, const Vec3& position) {
  const std::int32_t middle = add_vertex(position);
  // the facets on the edge, each replaced by two
  std::vector<std::int32_t> old_facets;
  std::vector<MaterialId> materials;
  for (const Copy& copy : copies_[a]) {
    const Halfedge h = halfedge_between(copy.material, a, b);
    if (h == HalfedgeMesh::null_halfedge()) continue;
    materials.push_back(copy.material);
    for (const Halfedge side : {h, meshes_[copy.material].opposite(h)}) {
      const std::int32_t f = facet_id_[copy.material][meshes_[copy.material].face(side)];
      if (std::find(old_facets.begin(), old_facets.end(), f) == old_facets.end())
        old_facets.push_back(f);
    }
  }
  CVMESH_ASSERT(!old_facets.empty());
  std::vector<std::int32_t> created;
  std::vector<std::pair<std::int32_t, std::vector<std::int32_t>>> heirs;  // samples -> facets
  for (const std::int32_t f : old_facets) {
    const std::int32_t sample_list = take_samples({&f, 1});
    Facet first = facets_[f], second = facets_[f];
    std::replace(first.vertices.begin(), first.vertices.end(), b, middle);
    std::replace(second.vertices.begin(), second.vertices.end(), a, middle);
    facets_[f] = first;
    const std::int32_t g = add_facet(second);
    created.push_back(f);
    created.push_back(g);
    heirs.push_back({sample_list, {f, g}});
  }
  for (const MaterialId m : materials) {
    HalfedgeMesh& mesh = meshes_[m];
    const Halfedge h = halfedge_between(m, a, b);
    const Halfedge to_middle = CGAL::Euler::split_edge(h, mesh);  // a -> middle, then h: -> b
    const VertexCopy v = mesh.target(to_middle);
    vertex_id_[m][v] = middle;
    copies_[middle].push_back({m, v});
    const Halfedge opposite_to_middle = mesh.prev(mesh.opposite(to_middle));  // b -> middle
    for (const Halfedge side : {to_middle, opposite_to_middle}) {
      const Halfedge apex = mesh.next(mesh.next(side));  // target: the vertex across the edge
      const Halfedge diagonal = CGAL::Euler::split_face(side, apex, mesh);
      attach(m, diagonal, created);
      attach(m, mesh.opposite(diagonal), created);
    }
  }
  for (const auto& [sample_list, facets] : heirs)
    give_samples(sample_list, facets);
  return middle;
}

void MaterialSurfaces::flip_edge(std::int32_t a, std::int32_t b) {
  std::int32_t first = -1, second = -1;
  const bool is_inner = facets_of_edge(a, b, first, second);
  require(is_inner, ErrorCode::Internal, "surfaces", "only an edge inside a patch can be flipped");
  const auto opposite_vertex = [&](std::int32_t f) {
    for (const std::int32_t v : facets_[f].vertices)
      if (v != a && v != b) return v;
    return -1;
  };
  const std::int32_t c = opposite_vertex(first), d = opposite_vertex(second);
  const std::vector<std::int32_t> pair{first, second};
  const std::int32_t sample_list = take_samples(pair);
  // first has a -> b: (a, b, c); second (b, a, d)
  facets_[first].vertices = {a, d, c};
  facets_[second].vertices = {d, b, c};
  const Sides sides = facets_[first].patch.sides;
  for (const MaterialId m : {sides.inside, sides.outside}) {
    const Halfedge h = halfedge_between(m, a, b);
    CGAL::Euler::flip_edge(h, meshes_[m]);
    attach(m, h, pair);
    attach(m, meshes_[m].opposite(h), pair);
  }
  give_samples(sample_list, pair);
}

void MaterialSurfaces::remove_vertices(std::span<const Removal> removals,
                                       const std::function<void()>& meanwhile) {
  std::vector<MaterialId> materials;
  for (const Removal& removal : removals) {
    replace_facets(removal);
    for (const Copy& copy : copies_[removal.vertex])
      materials.push_back(copy.material);
  }
  std::sort(materials.begin(), materials.end());
  materials.erase(std::unique(materials.begin(), materials.end()), materials.end());
  // Each mesh has its own lists of free elements, and of a facet only the face on its own side.
  parallel_for_each_index(
      0, materials.size() + 1,
      [&](std::size_t task) {
        if (task == 0) return meanwhile();
        for (const Removal& removal : removals)
          remove_copy(materials[task - 1], removal);
      },
      1);
  for (const Removal& removal : removals)
    copies_[removal.vertex].clear();
  vertex_count_ -= removals.size();
}

// All but the halfedge meshes. New facets take the places of the sheets' old ones.
void MaterialSurfaces::replace_facets(const Removal& removal) {
  boost::container::small_vector<std::int32_t, 24> star;
  for (const Sheet& sheet : removal.sheets)
    star.insert(star.end(), sheet.facets.begin(), sheet.facets.end());
  samples_.push_back(points_[removal.vertex]);
  next_sample_.push_back(take_samples({star.data(), star.size()}));
  const auto own_sample = static_cast<std::int32_t>(samples_.size() - 1);

  for (std::size_t s = 0; s < removal.sheets.size(); ++s) {
    const Sheet& sheet = removal.sheets[s];
    const Triangulation& triangulation = removal.triangulations[s];
    for (std::size_t t = 0; t < triangulation.size(); ++t) {
      const auto& [i, j, k] = triangulation[t];
      facets_[sheet.facets[t]] = {
          {sheet.ring[i], sheet.ring[j], sheet.ring[k]}, sheet.patch, {}, {}, -1, true};
    }
    for (std::size_t f = triangulation.size(); f < sheet.facets.size(); ++f) {
      facets_[sheet.facets[f]].is_alive = false;
      free_facets_.push_back(sheet.facets[f]);
    }
  }
  give_to_heirs(own_sample, removal.heirs, created_by(removal));
}

// In the order of the triangles.
std::vector<std::int32_t> MaterialSurfaces::created_by(const Removal& removal) {
  std::vector<std::int32_t> created;
  for (std::size_t s = 0; s < removal.sheets.size(); ++s) {
    const auto& facets = removal.sheets[s].facets;
    created.insert(created.end(), facets.begin(),
                   facets.begin() + static_cast<std::ptrdiff_t>(removal.triangulations[s].size()));
  }
  return created;
}

// The removal in the mesh of one material, if the vertex has a copy there.
void MaterialSurfaces::remove_copy(MaterialId m, const Removal& removal) {
  const auto copy = std::find_if(copies_[removal.vertex].begin(), copies_[removal.vertex].end(),
                                 [m](const Copy& c) { return c.material == m; });
  if (copy == copies_[removal.vertex].end()) return;
  HalfedgeMesh& mesh = meshes_[m];
  const Halfedge ring = CGAL::Euler::remove_center_vertex(mesh.halfedge(copy->vertex), mesh);
  boost::container::small_vector<Halfedge, 32> loose;  // one halfedge or more of every new face
  {
    Halfedge h = ring;
    do {
      loose.push_back(h);
      h = mesh.next(h);
    } while (h != ring);
  }
  const auto cut = [&](std::int32_t a, std::int32_t b) {
    // the face that still has both ends: look through the faces around a
    for (std::size_t n = 0; n < loose.size(); ++n) {
      const Halfedge at_a = loose[n];
      if (vertex_id_[m][mesh.target(at_a)] != a) continue;
      for (Halfedge h = mesh.next(at_a); h != at_a; h = mesh.next(h)) {
        if (vertex_id_[m][mesh.target(h)] != b) continue;
        const Halfedge diagonal = CGAL::Euler::split_face(at_a, h, mesh);
        loose.push_back(diagonal);
        loose.push_back(mesh.opposite(diagonal));
        return;
      }
    }
    throw Error(ErrorCode::Internal, "surfaces", "a diagonal has no face to split");
  };
  cut_closing_edge(m, removal, cut);
  for (std::size_t s = 0; s < removal.sheets.size(); ++s) {
    const Sheet& sheet = removal.sheets[s];
    if (!is_beside(sheet, m)) continue;
    const auto n = static_cast<int>(sheet.ring.size());
    for (const auto& triangle : removal.triangulations[s])
      for (int c = 0; c < 3; ++c) {
        const int i = triangle[c], j = triangle[(c + 1) % 3];
        const bool is_side = j == i + 1 || (j == 0 && i == n - 1);
        if (i < j && !is_side) cut(sheet.ring[i], sheet.ring[j]);
      }
  }
  const std::vector<std::int32_t> created = created_by(removal);
  boost::container::small_vector<Face, 12> attached;
  for (const Halfedge h : loose) {
    const Face face = mesh.face(h);
    if (std::find(attached.begin(), attached.end(), face) != attached.end()) continue;
    attach(m, h, created);
    attached.push_back(face);
  }
}

// On a curve the neighbours along it get an edge. Where a sheet vanishes it is there already, in
// the meshes that the sheet touches.
template <typename Cut>
void MaterialSurfaces::cut_closing_edge(MaterialId m, const Removal& removal, const Cut& cut) {
  const Sheet* beside = nullptr;
  for (const Sheet& sheet : removal.sheets) {
    if (sheet.is_disk || !is_beside(sheet, m)) continue;
    if (sheet.facets.size() == 1) return;
    if (beside == nullptr) beside = &sheet;
  }
  if (beside != nullptr) cut(beside->ring.front(), beside->ring.back());
}

bool MaterialSurfaces::is_beside(const Sheet& sheet, MaterialId m) {
  return sheet.patch.sides.inside == m || sheet.patch.sides.outside == m;
}

void MaterialSurfaces::add_sample(std::int32_t facet, const Vec3& position) {
  samples_.push_back(position);
  next_sample_.push_back(facets_[facet].first_sample);
  facets_[facet].first_sample = static_cast<std::int32_t>(samples_.size() - 1);
}

std::vector<std::int32_t> MaterialSurfaces::samples_of(std::int32_t facet) const {
  std::vector<std::int32_t> samples;
  for (auto s = facets_[facet].first_sample; s >= 0; s = next_sample_[s])
    samples.push_back(s);
  return samples;
}

void MaterialSurfaces::set_samples(std::int32_t facet, std::span<const std::int32_t> samples) {
  std::int32_t head = -1;
  for (auto s = samples.rbegin(); s != samples.rend(); ++s) {
    next_sample_[*s] = head;
    head = *s;
  }
  facets_[facet].first_sample = head;
}

void MaterialSurfaces::drop_removed() {
  std::vector<std::int32_t> new_id(facets_.size(), -1);
  std::vector<Facet> kept;
  kept.reserve(facets_.size() - free_facets_.size());
  for (std::size_t f = 0; f < facets_.size(); ++f) {
    if (!facets_[f].is_alive) continue;
    new_id[f] = static_cast<std::int32_t>(kept.size());
    kept.push_back(facets_[f]);
  }
  facets_ = std::move(kept);
  free_facets_ = {};
  parallel_for_each_index(
      0, meshes_.size(),
      [&](std::size_t n) {
        const auto m = static_cast<MaterialId>(n);
        HalfedgeMesh& mesh = meshes_[m];
        mesh.collect_garbage();
        mesh.shrink_to_fit();
        for (const Face face : mesh.faces()) {
          const std::int32_t f = facet_id_[m][face] = new_id[facet_id_[m][face]];
          // each facet is written by two materials, each its own member
          (facets_[f].patch.sides.inside == m ? facets_[f].inside_face : facets_[f].outside_face) =
              face;
        }
        for (const VertexCopy v : mesh.vertices())
          for (Copy& copy : copies_[vertex_id_[m][v]])
            if (copy.material == m) copy.vertex = v;
      },
      1);
}

InterfaceMesh MaterialSurfaces::to_interface_mesh(std::vector<std::int32_t>* vertex_ids) const {
  InterfaceMesh mesh;
  std::vector<std::int32_t> compact(points_.size(), -1);
  if (vertex_ids != nullptr) vertex_ids->clear();
  for (std::size_t v = 0; v < points_.size(); ++v) {
    if (copies_[v].empty()) continue;
    compact[v] = static_cast<std::int32_t>(mesh.points.size());
    mesh.points.push_back(points_[v]);
    if (vertex_ids != nullptr) vertex_ids->push_back(static_cast<std::int32_t>(v));
  }

  struct Entry {
    PatchKey patch;
    std::array<std::int32_t, 3> vertices;

    bool operator<(const Entry& other) const {
      return std::tie(patch, vertices) < std::tie(other.patch, other.vertices);
    }
  };

  std::vector<Entry> entries;
  for (const Facet& facet : facets_) {
    if (!facet.is_alive) continue;
    Entry entry{facet.patch, facet.vertices};
    for (auto& v : entry.vertices)
      v = compact[v];
    const auto least = std::min_element(entry.vertices.begin(), entry.vertices.end());
    std::rotate(entry.vertices.begin(), least, entry.vertices.end());
    entries.push_back(entry);
  }
  parallel_sort(entries.begin(), entries.end());
  for (const Entry& entry : entries) {
    mesh.facets.push_back(entry.vertices);
    mesh.patch_of.push_back(entry.patch);
  }
  return mesh;
}

Validation MaterialSurfaces::validate() const {
  Validation result;
  const auto fault = [&](const std::string& text) {
    if (result.faults.size() < 10) result.faults.push_back(text);
  };
  std::vector<int> mirrors(facets_.size(), 0);
  for (std::size_t m = 0; m < meshes_.size(); ++m) {
    const HalfedgeMesh& mesh = meshes_[m];
    if (!mesh.is_valid()) fault("halfedge mesh " + std::to_string(m) + " is not valid");
    for (const auto h : mesh.halfedges())
      if (mesh.is_border(h)) fault("mesh " + std::to_string(m) + " has a border");
    for (const Face face : mesh.faces()) {
      const std::int32_t f = facet_id_[m][face];
      if (f < 0 || !facets_[f].is_alive) {
        fault("a face of mesh " + std::to_string(m) + " has no living facet");
        continue;
      }
      ++mirrors[f];
      const Facet& facet = facets_[f];
      const bool is_inside = facet.patch.sides.inside == m;
      if ((is_inside ? facet.inside_face : facet.outside_face) != face)
        fault("facet " + std::to_string(f) + " does not know its face");
      Halfedge h = mesh.halfedge(face);
      std::array<std::int32_t, 3> v{};
      for (int c = 0; c < 3; ++c, h = mesh.next(h))
        v[c] = vertex_id_[m][mesh.target(h)];
      if (h != mesh.halfedge(face))
        fault("a face of mesh " + std::to_string(m) + " is no triangle");
      if (!is_inside) std::swap(v[1], v[2]);
      std::rotate(v.begin(), std::find(v.begin(), v.end(), facet.vertices[0]), v.end());
      if (v != facet.vertices) fault("facet " + std::to_string(f) + " and its face differ");
    }
  }
  for (std::size_t f = 0; f < facets_.size(); ++f)
    if (facets_[f].is_alive && mirrors[f] != 2)
      fault("facet " + std::to_string(f) + " has " + std::to_string(mirrors[f]) + " mirrors");
  return result;
}

}  // namespace cvmesh
