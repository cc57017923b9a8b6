// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/mesh/validate.h"

#include "cvmesh/core/disjoint_sets.h"
#include "cvmesh/core/parallel.h"
#include "cvmesh/mesh/facet_predicates.h"
#include "cvmesh/mesh/local_numbers.h"
#include "cvmesh/mesh/shape_tree.h"
#include "cvmesh/mesh/tet_faces.h"
#include "cvmesh/mesh/tet_predicates.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <map>
#include <numeric>
#include <span>
#include <utility>

namespace cvmesh {
namespace {

using Triangle = std::array<std::int32_t, 3>;

constexpr std::size_t kShownPerKind = 10;
constexpr double kVolumeTolerance = 1e-9;  // relative; sums of 10^7 doubles stay below 1e-11

// Collects faults of one kind: the first ten are named, the others counted.
class Faults {
 public:
  Faults(Validation& validation, std::string kind)
      : validation_(validation), kind_(std::move(kind)) {}

  Faults(const Faults&) = delete;
  Faults& operator=(const Faults&) = delete;

  ~Faults() {
    if (count_ > kShownPerKind) {
      validation_.faults.push_back(std::to_string(count_ - kShownPerKind) + " more: " + kind_);
    }
  }

  template <typename Describe>
  void add(const Describe& describe) {
    if (count_++ < kShownPerKind) validation_.faults.push_back(describe());
  }

 private:
  Validation& validation_;
  std::string kind_;
  std::size_t count_ = 0;
};

std::string text(std::int64_t i) {
  return std::to_string(i);
}

std::string text(const Triangle& t) {
  return "(" + text(t[0]) + ", " + text(t[1]) + ", " + text(t[2]) + ")";
}

std::string text(const Sides& s) {
  return text(s.inside) + "|" + text(s.outside);
}

// Whether an even number of swaps sorts the triple.
bool is_even(const Triangle& t) {
  return ((t[0] < t[1]) + (t[1] < t[2]) + (t[0] < t[2])) % 2 == 1;
}

// --- the boundary of one material ----------------------------------------------------------------

// The facets around each material, turned so that their normals point out of it.
std::vector<std::vector<Triangle>> split_by_material(const InterfaceMesh& mesh,
                                                     std::size_t material_count) {
  std::vector<std::vector<Triangle>> result(material_count);
  std::vector<std::size_t> count(material_count, 0);
  for (const PatchKey& patch : mesh.patch_of) {
    ++count[patch.sides.inside];
    ++count[patch.sides.outside];
  }
  for (std::size_t m = 0; m < material_count; ++m)
    result[m].reserve(count[m]);
  for (std::size_t f = 0; f < mesh.facets.size(); ++f) {
    const Sides sides = mesh.patch_of[f].sides;
    const auto& [a, b, c] = mesh.facets[f];
    result[sides.inside].push_back({a, b, c});
    result[sides.outside].push_back({a, c, b});
  }
  return result;
}

// Calls visit(sides) for each edge of a set of triangles, in ascending order. A side's place is the
// number of its halfedge: 3 t + c leads from corner c of triangle t to the next.
template <typename Visit>
void for_each_edge(const std::vector<Triangle>& triangles,
                   std::size_t point_count,
                   const Visit& visit) {
  const std::vector<FacetSide> sides = sides_by_edge(triangles, point_count);
  for (std::size_t i = 0; i < sides.size();) {
    std::size_t end = i + 1;
    while (end < sides.size() && sides[end].a == sides[i].a && sides[end].b == sides[i].b)
      ++end;
    visit(std::span(sides.data() + i, end - i));
    i = end;
  }
}

struct EdgeFault {
  std::int32_t a, b;   ///< the edge
  std::size_t facets;  ///< how many have it
};

// What is wrong with a boundary, and its topology.
struct BoundaryReport {
  BoundaryTopology topology;
  std::vector<EdgeFault> bad_edges;            ///< not in exactly two facets
  std::vector<EdgeFault> turned_edges;         ///< in two facets that run the same way
  std::vector<std::int32_t> pinched_vertices;  ///< more than one fan of facets
};

// Finds vertices whose facets form more than one fan by walking around each from its first corner.
// Corner 3 t + c is the one at the tail of halfedge 3 t + c.
std::vector<std::int32_t> find_pinched(const std::vector<Triangle>& triangles,
                                       const std::vector<std::uint32_t>& twin,
                                       std::size_t point_count) {
  std::vector<std::uint32_t> corners(point_count, 0);
  std::vector<std::uint32_t> first(point_count, 0);
  for (std::size_t h = triangles.size() * 3; h-- > 0;) {
    const std::int32_t v = triangles[h / 3][h % 3];
    ++corners[v];
    first[v] = static_cast<std::uint32_t>(h);
  }
  std::vector<char> is_pinched(point_count, 0);
  parallel_for_each_index(0, point_count, [&](std::size_t v) {
    if (corners[v] == 0) return;
    std::uint32_t seen = 0, h = first[v];
    do {
      ++seen;
      const std::uint32_t before = h % 3 == 0 ? h + 2 : h - 1;
      h = twin[before];
    } while (h != first[v] && seen <= corners[v]);
    is_pinched[v] = seen != corners[v];
  });
  std::vector<std::int32_t> result;
  for (std::size_t v = 0; v < point_count; ++v) {
    if (is_pinched[v] != 0) result.push_back(static_cast<std::int32_t>(v));
  }
  return result;
}

// The same where edges may have any number of facets: vertices whose facets hang together in more
// than one group, facets with a common edge at the vertex being of one group.
std::size_t count_pinched(const std::vector<Triangle>& triangles, std::size_t point_count) {
  std::vector<std::vector<std::array<std::int32_t, 2>>> links(point_count);
  for (const Triangle& t : triangles)
    for (int c = 0; c < 3; ++c)
      links[t[c]].push_back({t[(c + 1) % 3], t[(c + 2) % 3]});
  std::size_t pinched = 0;
  std::map<std::int32_t, std::int32_t> group;
  for (const auto& link : links) {
    group.clear();
    const auto find = [&](std::int32_t w) {
      while (group.at(w) != w)
        w = group.at(w);
      return w;
    };
    std::size_t groups = 0;
    for (const auto& [a, b] : link) {
      groups += group.try_emplace(a, a).second ? 1 : 0;
      groups += group.try_emplace(b, b).second ? 1 : 0;
      const std::int32_t first = find(a), second = find(b);
      if (first == second) continue;
      group[second] = first;
      --groups;
    }
    pinched += groups > 1 ? 1 : 0;
  }
  return pinched;
}

// Vertices in use, and their connected components.
class VertexSets {
 public:
  explicit VertexSets(const std::vector<Triangle>& triangles, std::size_t point_count) {
    DisjointSets sets(point_count);
    std::vector<bool> is_used(point_count, false);
    for (const Triangle& t : triangles) {
      for (const std::int32_t v : t) {
        if (is_used[v]) continue;
        is_used[v] = true;
        ++vertices_;
      }
      joins_ += sets.join(t[0], t[1]) ? 1 : 0;
      joins_ += sets.join(t[1], t[2]) ? 1 : 0;
    }
  }

  [[nodiscard]] std::size_t vertices() const { return vertices_; }

  [[nodiscard]] std::size_t components() const { return vertices_ - joins_; }

 private:
  std::size_t vertices_ = 0, joins_ = 0;
};

BoundaryReport inspect(const std::vector<Triangle>& triangles, std::size_t point_count) {
  BoundaryReport report;
  const auto tail = [&](std::int32_t h) { return triangles[h / 3][h % 3]; };
  const auto head = [&](std::int32_t h) { return triangles[h / 3][(h + 1) % 3]; };
  std::vector<std::uint32_t> twin(triangles.size() * 3);
  std::size_t edge_count = 0;
  for_each_edge(triangles, point_count, [&](std::span<const FacetSide> sides) {
    ++edge_count;
    const std::int32_t first = sides[0].place;
    const EdgeFault fault{tail(first), head(first), sides.size()};
    if (sides.size() != 2) {
      report.bad_edges.push_back(fault);
      return;
    }
    const std::int32_t second = sides[1].place;
    if (tail(first) == tail(second)) report.turned_edges.push_back(fault);
    twin[first] = static_cast<std::uint32_t>(second);
    twin[second] = static_cast<std::uint32_t>(first);
  });
  const VertexSets sets(triangles, point_count);
  report.topology.components = sets.components();
  report.topology.euler = static_cast<long long>(sets.vertices()) -
                          static_cast<long long>(edge_count) +
                          static_cast<long long>(triangles.size());
  const bool has_good_edges = report.bad_edges.empty() && report.turned_edges.empty();
  // Fans can only be walked where every edge leads on.
  if (has_good_edges) report.pinched_vertices = find_pinched(triangles, twin, point_count);
  report.topology.is_closed_manifold = has_good_edges && report.pinched_vertices.empty();
  report.topology.nonmanifold_edges = report.bad_edges.size();
  report.topology.nonmanifold_vertices =
      has_good_edges ? report.pinched_vertices.size() : count_pinched(triangles, point_count);
  return report;
}

// With vertices numbered from 0 to the number in use: small materials stay cheap.
BoundaryReport inspect_compacted(std::vector<Triangle> triangles) {
  const LocalNumbers numbers(triangles);
  parallel_for_each_index(0, triangles.size(), [&](std::size_t t) {
    for (std::int32_t& v : triangles[t])
      v = numbers(v);
  });
  const std::vector<std::int32_t>& vertex_of = numbers.vertices();
  BoundaryReport report = inspect(triangles, vertex_of.size());
  for (auto* list : {&report.bad_edges, &report.turned_edges}) {
    for (EdgeFault& fault : *list) {
      fault.a = vertex_of[fault.a];
      fault.b = vertex_of[fault.b];
    }
  }
  for (std::int32_t& v : report.pinched_vertices)
    v = vertex_of[v];
  return report;
}

std::vector<BoundaryReport> inspect_boundaries(const InterfaceMesh& mesh,
                                               std::size_t material_count) {
  std::vector<std::vector<Triangle>> boundaries = split_by_material(mesh, material_count);
  std::vector<BoundaryReport> reports(material_count);
  parallel_for_each_index(
      0, material_count,
      [&](std::size_t m) { reports[m] = inspect_compacted(std::move(boundaries[m])); }, 1);
  return reports;
}

// --- checks of an interface mesh -----------------------------------------------------------------

// Sizes, indices and materials; false when nothing else can be looked at.
bool check_indices(const InterfaceMesh& mesh, std::size_t material_count, Validation& result) {
  if (mesh.patch_of.size() != mesh.facets.size()) {
    result.faults.push_back(text(std::ssize(mesh.facets)) + " facets but " +
                            text(std::ssize(mesh.patch_of)) + " patch keys");
    return false;
  }
  Faults range(result, "facets with a vertex or material out of range");
  Faults order(result, "facets whose inside is not above their outside");
  Faults repeated(result, "facets that use a vertex twice");
  bool is_usable = true;
  const auto points = std::ssize(mesh.points);
  for (std::size_t f = 0; f < mesh.facets.size(); ++f) {
    const Triangle& t = mesh.facets[f];
    const Sides sides = mesh.patch_of[f].sides;
    const bool is_inside =
        std::all_of(t.begin(), t.end(), [&](std::int32_t v) { return v >= 0 && v < points; });
    if (!is_inside || sides.inside >= material_count || sides.outside >= material_count) {
      is_usable = false;
      range.add([&] {
        return "facet " + text(std::int64_t(f)) + " " + text(t) + ", materials " + text(sides) +
               ": there are " + text(points) + " points and " + text(std::int64_t(material_count)) +
               " materials";
      });
    } else if (t[0] == t[1] || t[1] == t[2] || t[2] == t[0]) {
      is_usable = false;
      repeated.add([&] {
        return "facet " + text(std::int64_t(f)) + " " + text(t) + " uses a vertex twice";
      });
    }
    if (sides.inside <= sides.outside) {
      order.add([&] {
        return "facet " + text(std::int64_t(f)) + " has materials " + text(sides) +
               "; inside must be above outside";
      });
    }
  }
  return is_usable;
}

bool check_points(const std::vector<Vec3>& points, Validation& result) {
  Faults infinite(result, "points that are not finite");
  bool is_finite = true;
  for (std::size_t v = 0; v < points.size(); ++v) {
    const Vec3& p = points[v];
    if (std::isfinite(p.x) && std::isfinite(p.y) && std::isfinite(p.z)) continue;
    is_finite = false;
    infinite.add([&] { return "vertex " + text(std::int64_t(v)) + " is not finite"; });
  }
  if (!is_finite) return false;
  std::vector<std::int32_t> order(points.size());
  std::iota(order.begin(), order.end(), 0);
  parallel_sort(order.begin(), order.end(), [&](std::int32_t i, std::int32_t j) {
    const Vec3 &p = points[i], &q = points[j];
    if (p.x != q.x) return p.x < q.x;
    if (p.y != q.y) return p.y < q.y;
    if (p.z != q.z) return p.z < q.z;
    return i < j;
  });
  Faults equal(result, "pairs of vertices at the same point");
  for (std::size_t i = 1; i < order.size(); ++i) {
    if (!(points[order[i - 1]] == points[order[i]])) continue;
    equal.add([&] {
      return "vertices " + text(order[i - 1]) + " and " + text(order[i]) + " are at the same point";
    });
  }
  return true;
}

void check_facets(const InterfaceMesh& mesh, Validation& result) {
  std::vector<std::pair<Triangle, std::int32_t>> keys(mesh.facets.size());
  std::vector<char> is_flat(mesh.facets.size());
  parallel_for_each_index(0, keys.size(), [&](std::size_t f) {
    keys[f] = {sorted(mesh.facets[f]), static_cast<std::int32_t>(f)};
    is_flat[f] = is_degenerate(mesh.points, mesh.facets[f]);
  });
  Faults flat(result, "facets of zero area");
  for (std::size_t f = 0; f < is_flat.size(); ++f) {
    if (is_flat[f] == 0) continue;
    flat.add([&] {
      return "facet " + text(std::int64_t(f)) + " " + text(mesh.facets[f]) + " has zero area";
    });
  }
  parallel_sort(keys.begin(), keys.end());
  Faults repeated(result, "facets that repeat another");
  for (std::size_t i = 1; i < keys.size(); ++i) {
    if (keys[i - 1].first != keys[i].first) continue;
    repeated.add([&] {
      return "facets " + text(keys[i - 1].second) + " and " + text(keys[i].second) +
             " have the same vertices " + text(keys[i].first);
    });
  }
}

void check_boundaries(const InterfaceMesh& mesh,
                      std::size_t material_count,
                      const MeshNames& names,
                      Validation& result) {
  Faults open(result, "edges of a material that are not in two facets");
  Faults turned(result, "edges between facets that face opposite ways");
  Faults pinched(result, "vertices where a material's boundary touches itself");
  const std::vector<BoundaryReport> reports = inspect_boundaries(mesh, material_count);
  for (std::size_t m = 0; m < material_count; ++m) {
    const BoundaryReport& report = reports[m];
    const auto at = [&](const std::string& fault, const Vec3& place) {
      return names.material(static_cast<MaterialId>(m)) + ", near " + names.place(place) + ": " +
             fault;
    };
    const auto at_edge = [&](const EdgeFault& e, const std::string& fault) {
      return at(fault, 0.5 * (mesh.points[e.a] + mesh.points[e.b]));
    };
    for (const EdgeFault& e : report.bad_edges) {
      open.add([&] {
        return at_edge(e, "edge (" + text(e.a) + ", " + text(e.b) + ") is in " +
                              text(std::int64_t(e.facets)) + " facets instead of 2");
      });
    }
    for (const EdgeFault& e : report.turned_edges) {
      turned.add([&] {
        return at_edge(
            e, "the two facets at edge (" + text(e.a) + ", " + text(e.b) + ") face opposite ways");
      });
    }
    for (const std::int32_t v : report.pinched_vertices) {
      pinched.add(
          [&] { return at("its boundary touches itself at vertex " + text(v), mesh.points[v]); });
    }
  }
}

// --- checks of a tet mesh ------------------------------------------------------------------------

// One use of a triangle: by a tet (owner >= 0) or by facet -1 - owner of the surface.
struct FaceUse {
  Triangle key;
  std::int32_t owner;
  bool is_even;  ///< whether the outward (or the facet's own) orientation is that of the key

  friend bool operator<(const FaceUse& a, const FaceUse& b) {
    return a.key != b.key ? a.key < b.key : a.owner < b.owner;
  }
};

std::vector<FaceUse> collect_faces(const TetMesh& mesh) {
  const std::size_t tets = mesh.tets.size();
  std::vector<FaceUse> uses(tets * 4 + mesh.surface.facets.size());
  parallel_for_each_index(0, tets, [&](std::size_t t) {
    for (std::size_t n = 0; n < 4; ++n) {
      const Triangle face = tet_face(mesh.tets[t], n);
      uses[t * 4 + n] = {sorted(face), static_cast<std::int32_t>(t), is_even(face)};
    }
  });
  parallel_for_each_index(0, mesh.surface.facets.size(), [&](std::size_t f) {
    const Triangle& facet = mesh.surface.facets[f];
    uses[tets * 4 + f] = {sorted(facet), -1 - static_cast<std::int32_t>(f), is_even(facet)};
  });
  parallel_sort(uses.begin(), uses.end());
  return uses;
}

// Compares each face's tets with the surface facet on it, or its absence.
class FaceCheck {
 public:
  FaceCheck(const TetMesh& mesh, Validation& result)
      : mesh_(mesh),
        crowded_(result, "faces in more than two tets"),
        folded_(result, "faces whose two tets are on the same side"),
        unmarked_(result, "faces between materials that are no facet"),
        absent_(result, "facets that are no face of a tet"),
        wrong_(result, "facets with the wrong materials beside them") {}

  void run(const std::vector<FaceUse>& uses) {
    for (std::size_t i = 0; i < uses.size();) {
      std::size_t end = i + 1;
      while (end < uses.size() && uses[end].key == uses[i].key)
        ++end;
      check(std::span(uses.data() + i, end - i));
      i = end;
    }
  }

 private:
  void check(std::span<const FaceUse> uses) {
    const bool has_facet = uses.front().owner < 0;
    // A repeated facet is the surface's own fault; here the first one speaks.
    std::size_t facets = 0;
    while (facets < uses.size() && uses[facets].owner < 0)
      ++facets;
    const auto tets = uses.subspan(facets);
    if (tets.size() > 2) {
      crowded_.add([&] {
        return "face " + text(uses.front().key) + " is in " + text(std::ssize(tets)) + " tets";
      });
      return;
    }
    if (tets.size() == 2 && tets[0].is_even == tets[1].is_even) {
      folded_.add([&] {
        return "tets " + text(tets[0].owner) + " and " + text(tets[1].owner) +
               " are on the same side of face " + text(uses.front().key);
      });
      return;
    }
    if (has_facet) {
      check_facet(uses[facets - 1], tets);
    } else if (tets.size() == 1 || material(tets[0]) != material(tets[1])) {
      unmarked_.add([&] {
        return "face " + text(uses.front().key) + " of tet " + text(tets[0].owner) +
               (tets.size() == 1 ? " is on the outside"
                                 : " and tet " + text(tets[1].owner) + " is between materials") +
               " but is no facet of the surface";
      });
    }
  }

  void check_facet(const FaceUse& facet, std::span<const FaceUse> tets) {
    const std::int32_t f = -1 - facet.owner;
    const Sides expected = mesh_.surface.patch_of[f].sides;
    if (tets.empty()) {
      absent_.add([&] {
        return "facet " + text(f) + " " + text(mesh_.surface.facets[f]) + " is no face of a tet";
      });
      return;
    }
    // The normal points out of the inside tet: that one has the facet's own orientation.
    Sides found{kExterior, kExterior};
    for (const FaceUse& tet : tets) {
      (tet.is_even == facet.is_even ? found.inside : found.outside) = material(tet);
    }
    if (found == expected) return;
    wrong_.add([&] {
      return "facet " + text(f) + " has materials " + text(expected) + " but lies between " +
             text(found);
    });
  }

  [[nodiscard]] MaterialId material(const FaceUse& tet) const {
    return mesh_.material_of[tet.owner];
  }

  const TetMesh& mesh_;
  Faults crowded_, folded_, unmarked_, absent_, wrong_;
};

bool check_tet_indices(const TetMesh& mesh, std::size_t material_count, Validation& result) {
  if (mesh.material_of.size() != mesh.tets.size()) {
    result.faults.push_back(text(std::ssize(mesh.tets)) + " tets but " +
                            text(std::ssize(mesh.material_of)) + " materials of tets");
    return false;
  }
  Faults range(result, "tets with a vertex or material out of range");
  bool is_usable = true;
  const auto points = std::ssize(mesh.points);
  for (std::size_t t = 0; t < mesh.tets.size(); ++t) {
    const auto& tet = mesh.tets[t];
    const bool is_inside =
        std::all_of(tet.begin(), tet.end(), [&](std::int32_t v) { return v >= 0 && v < points; });
    const MaterialId material = mesh.material_of[t];
    if (is_inside && material != kExterior && material < material_count) continue;
    is_usable = false;
    range.add([&] {
      return "tet " + text(std::int64_t(t)) + " of material " + text(material) +
             " has a vertex or a material out of range: there are " + text(points) +
             " points and the materials 1 to " + text(std::int64_t(material_count) - 1);
    });
  }
  return is_usable;
}

void check_orientation(const TetMesh& mesh, const MeshNames& names, Validation& result) {
  std::vector<std::int8_t> sign(mesh.tets.size());
  parallel_for_each_index(0, sign.size(), [&](std::size_t t) {
    const auto& [a, b, c, d] = mesh.tets[t];
    sign[t] = static_cast<std::int8_t>(
        tet_orientation(mesh.points[a], mesh.points[b], mesh.points[c], mesh.points[d]));
  });
  Faults inverted(result, "tets without positive volume");
  for (std::size_t t = 0; t < sign.size(); ++t) {
    if (sign[t] > 0) continue;
    inverted.add([&] {
      return "tet " + text(std::int64_t(t)) + " of " + names.material(mesh.material_of[t]) +
             ", near " + names.place(mesh.points[mesh.tets[t][0]]) +
             (sign[t] == 0 ? ", is flat" : ", is inverted");
    });
  }
}

void check_volumes(const TetMesh& mesh,
                   std::size_t material_count,
                   const MeshNames& names,
                   Validation& result) {
  std::vector<double> of_tets(material_count, 0), of_surface(material_count, 0);
  // Measured from the middle of the box: far from the origin the integral would cancel digits.
  Box3 box;
  for (const Vec3& p : mesh.points)
    box.add(p);
  const Vec3 middle = 0.5 * (box.lo + box.hi);
  for (std::size_t t = 0; t < mesh.tets.size(); ++t) {
    const auto& [a, b, c, d] = mesh.tets[t];
    of_tets[mesh.material_of[t]] +=
        volume6(mesh.points[a], mesh.points[b], mesh.points[c], mesh.points[d]) / 6;
  }
  for (std::size_t f = 0; f < mesh.surface.facets.size(); ++f) {
    const auto& [a, b, c] = mesh.surface.facets[f];
    const double volume =
        dot(mesh.points[a] - middle, cross(mesh.points[b] - middle, mesh.points[c] - middle)) / 6;
    of_surface[mesh.surface.patch_of[f].sides.inside] += volume;
    of_surface[mesh.surface.patch_of[f].sides.outside] -= volume;
  }
  Faults unequal(result, "materials whose tets do not fill their surface");
  for (std::size_t m = 1; m < material_count; ++m) {
    const double error = std::abs(of_tets[m] - of_surface[m]);
    if (error <= kVolumeTolerance * std::max(std::abs(of_tets[m]), std::abs(of_surface[m]))) {
      continue;
    }
    unequal.add([&] {
      return names.material(static_cast<MaterialId>(m)) + ": its tets fill " +
             std::to_string(of_tets[m]) + " mm^3, its surface encloses " +
             std::to_string(of_surface[m]) + " mm^3";
    });
  }
}

bool check_shared_points(const TetMesh& mesh, Validation& result) {
  const bool is_prefix =
      mesh.surface.points.size() <= mesh.points.size() &&
      std::equal(mesh.surface.points.begin(), mesh.surface.points.end(), mesh.points.begin());
  if (!is_prefix) {
    result.faults.emplace_back("the first points of the mesh are not those of its surface");
  }
  return is_prefix;
}

// Boxes of facets, for the search tree.
struct FacetBoxes {
  const InterfaceMesh& mesh;

  [[nodiscard]] std::size_t size() const { return mesh.facets.size(); }

  [[nodiscard]] Box3 box(std::size_t f) const { return box_of(mesh.points, mesh.facets[f]); }
};

}  // namespace

std::string Validation::summary() const {
  std::string result;
  for (const std::string& fault : faults)
    result += (result.empty() ? "" : "\n") + fault;
  return result;
}

std::vector<BoundaryTopology> boundary_topology(const InterfaceMesh& mesh,
                                                std::size_t material_count) {
  std::vector<BoundaryTopology> result;
  for (const BoundaryReport& report : inspect_boundaries(mesh, material_count))
    result.push_back(report.topology);
  return result;
}

Validation validate(const InterfaceMesh& mesh, std::size_t material_count, const MeshNames& names) {
  Validation result;
  if (!check_indices(mesh, material_count, result)) return result;
  if (check_points(mesh.points, result)) check_facets(mesh, result);
  check_boundaries(mesh, material_count, names, result);
  return result;
}

std::vector<std::pair<std::int32_t, std::int32_t>> find_intersections(const InterfaceMesh& mesh,
                                                                      std::size_t max_pairs) {
  using Pairs = std::vector<std::pair<std::int32_t, std::int32_t>>;
  constexpr std::size_t kChunk = 512;
  const FacetBoxes boxes{mesh};
  const ShapeTree<FacetBoxes> tree(boxes);
  // Facets of zero area touch all around them; `validate` reports them.
  std::vector<char> is_flat(mesh.facets.size());
  parallel_for_each_index(0, is_flat.size(), [&](std::size_t f) {
    is_flat[f] = is_degenerate(mesh.points, mesh.facets[f]);
  });
  const std::size_t chunks = (mesh.facets.size() + kChunk - 1) / kChunk;
  std::vector<Pairs> found(chunks);
  parallel_for_each_index(
      0, chunks,
      [&](std::size_t c) {
        const std::size_t end = std::min(mesh.facets.size(), (c + 1) * kChunk);
        for (std::size_t f = c * kChunk; f < end && found[c].size() < max_pairs; ++f) {
          if (is_flat[f] != 0) continue;
          const std::size_t before = found[c].size();
          tree.for_each_overlap(boxes.box(f), [&](std::uint32_t g) {
            if (g <= f || is_flat[g] != 0) return;
            if (!facets_intersect(mesh.points, mesh.facets[f], mesh.facets[g])) return;
            found[c].emplace_back(static_cast<std::int32_t>(f), static_cast<std::int32_t>(g));
          });
          std::sort(found[c].begin() + static_cast<std::ptrdiff_t>(before), found[c].end());
        }
      },
      1);
  Pairs result;
  for (const Pairs& pairs : found) {
    for (const auto& pair : pairs) {
      if (result.size() < max_pairs) result.push_back(pair);
    }
  }
  return result;
}

Validation validate(const TetMesh& mesh, std::size_t material_count, const MeshNames& names) {
  Validation result;
  const bool has_good_tets = check_tet_indices(mesh, material_count, result);
  const bool has_good_facets = check_indices(mesh.surface, material_count, result);
  if (!check_shared_points(mesh, result) || !has_good_tets || !has_good_facets) return result;
  check_orientation(mesh, names, result);
  FaceCheck(mesh, result).run(collect_faces(mesh));
  check_volumes(mesh, material_count, names, result);
  return result;
}

}  // namespace cvmesh
