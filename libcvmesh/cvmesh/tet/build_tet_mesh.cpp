// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/tet/build_tet_mesh.h"

#include "cvmesh/core/box3.h"
#include "cvmesh/core/disjoint_sets.h"
#include "cvmesh/core/parallel.h"
#include "cvmesh/mesh/sort_along_curve.h"
#include "cvmesh/mesh/tet_faces.h"
#include "cvmesh/tet/improve_tets.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <utility>
#include <vector>

namespace cvmesh {
namespace {

constexpr double kVolumeTolerance = 1e-9;  // relative; sums of doubles are within 1e-12

std::string format_number(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%.4g", value);
  return text;
}

/// One side of a triangle: a tet's face or a facet, to be matched by its sorted corners.
struct FaceRecord {
  std::array<std::int32_t, 3> key;
  std::int32_t owner = -1;  ///< 4 tet + face; facets: -1 - facet, so that they come first

  friend bool operator<(const FaceRecord& a, const FaceRecord& b) {
    return a.key != b.key ? a.key < b.key : a.owner < b.owner;
  }
};

double volume6_of(const TetMesh& mesh, const std::array<std::int32_t, 4>& tet) {
  const auto corner = [&](std::size_t k) { return mesh.points[tet[k]]; };
  return volume6(corner(0), corner(1), corner(2), corner(3));
}

/// Volumes that the surface encloses, per material: the divergence theorem around the centre of
/// the box, which keeps the cancellation small.
std::vector<double> enclosed_volumes(const InterfaceMesh& surface, std::size_t material_count) {
  Box3 box;
  for (const Vec3& p : surface.points)
    box.add(p);
  const Vec3 centre = (box.lo + box.hi) / 2;
  std::vector<double> volumes(material_count, 0.0);
  for (std::size_t f = 0; f < surface.facets.size(); ++f) {
    const auto& v = surface.facets[f];
    const double part =
        volume6(centre, surface.points[v[0]], surface.points[v[1]], surface.points[v[2]]) / 6;
    volumes[surface.patch_of[f].sides.inside] += part;
    volumes[surface.patch_of[f].sides.outside] -= part;
  }
  return volumes;
}

/// Turns what TetGen returned into a checked `TetMesh`.
class Builder {
 public:
  Builder(const InterfaceMesh& surface, std::size_t material_count, const MeshNames& names)
      : surface_(surface), names_(names), volumes_(enclosed_volumes(surface, material_count)) {}

  /// The mesh in `mesh`; what is wrong as the return value, empty when nothing is.
  std::string build(tetgen_protocol::Reply reply, TetMesh& mesh, const StageContext& context) {
    mesh = {};
    mesh.points = std::move(reply.points);
    mesh.tets = std::move(reply.tets);
    mesh.surface = surface_;
    std::string fault = check_points(mesh);
    if (!fault.empty()) return fault;
    orient(mesh);
    fault = assign_materials(mesh);
    if (!fault.empty()) return fault;
    drop_unused_points(mesh);
    // TetGen's order jumps through space; what follows walks over small neighbourhoods.
    sort_along_curve(mesh, mean_edge(mesh));
    fault = repair_flat_tets(mesh, context);
    if (!fault.empty()) return fault;
    return check_volumes(mesh);
  }

  [[nodiscard]] double volume_error() const { return volume_error_; }

  [[nodiscard]] bool leaves_facet_out() const { return leaves_facet_out_; }

 private:
  std::string check_points(const TetMesh& mesh) const {
    for (std::size_t v = 0; v < surface_.points.size(); ++v) {
      const Vec3& p = surface_.points[v];
      if (v < mesh.points.size() && std::memcmp(&mesh.points[v], &p, sizeof p) == 0) continue;
      return "TetGen changed or merged points of the surface, from point " + std::to_string(v) +
             " at " + names_.place(p) + " on";
    }
    return {};
  }

  /// TetGen decides signs exactly, so all its tets have one orientation; its own order of corners
  /// is the opposite of ours. A sliver whose volume rounds to the wrong sign follows the others.
  static void orient(TetMesh& mesh) {
    std::size_t positive = 0;
    for (const auto& tet : mesh.tets)
      positive += volume6_of(mesh, tet) > 0 ? 1 : 0;
    if (2 * positive >= mesh.tets.size()) return;
    for (auto& tet : mesh.tets)
      std::swap(tet[2], tet[3]);
  }

  /// Tets that are flat to double precision go by flips where they can.
  std::string repair_flat_tets(TetMesh& mesh, const StageContext& context) const {
    const auto is_flat = [&](const auto& tet) { return !(volume6_of(mesh, tet) > 0); };
    if (std::none_of(mesh.tets.begin(), mesh.tets.end(), is_flat)) return {};
    ImproveTetsOptions repair;
    repair.passes = 3;
    repair.comfort_deg = 1;
    repair.insert_below_deg = 1;
    improve_tets(mesh, repair, context);
    const auto flat = std::find_if(mesh.tets.begin(), mesh.tets.end(), is_flat);
    if (flat == mesh.tets.end()) return {};
    return "TetGen made a flat tet near " + names_.place(mesh.points[(*flat)[0]]);
  }

  /// Floods the parts between facets, and reads their material from the sides of those facets.
  std::string assign_materials(TetMesh& mesh) {
    const std::vector<FaceRecord> faces = match_faces(mesh);
    DisjointSets parts(mesh.tets.size());
    constexpr std::int32_t kUnknown = -1;
    std::vector<std::int32_t> material(mesh.tets.size(), kUnknown);

    struct Side {
      std::int32_t tet, facet;
      MaterialId material;
    };

    std::vector<Side> sides;
    for (std::size_t i = 0; i < faces.size();) {
      std::size_t end = i;
      while (end < faces.size() && faces[end].key == faces[i].key)
        ++end;
      const bool has_facet = faces[i].owner < 0;
      const std::size_t tets = end - i - (has_facet ? 1 : 0);
      if (tets > 2) return "a face belongs to more than two tets";
      if (has_facet) {
        const std::int32_t facet = -1 - faces[i].owner;
        if (tets == 0) {
          leaves_facet_out_ = true;
          return names_.facet(surface_, facet) + " is not a face of the tets";
        }
        for (std::size_t k = i + 1; k < end; ++k)
          sides.push_back({faces[k].owner / 4, facet, side_of(mesh, faces[k].owner, facet)});
      } else if (tets == 2) {
        parts.join(faces[i].owner / 4, faces[i + 1].owner / 4);
      } else {
        return "the tets end at a face that is no facet of the surface (tet " +
               std::to_string(faces[i].owner / 4) + ")";
      }
      i = end;
    }
    for (const Side& side : sides) {
      std::int32_t& known = material[parts.find(side.tet)];
      if (known != kUnknown && known != side.material)
        return "a connected part of the tets touches sides of " +
               names_.material(static_cast<MaterialId>(known)) + " and " +
               names_.material(side.material) + " at " + names_.facet(surface_, side.facet);
      known = side.material;
    }
    return keep_meshed(mesh, parts, material);
  }

  [[nodiscard]] std::vector<FaceRecord> match_faces(const TetMesh& mesh) const {
    const std::size_t facets = surface_.facets.size();
    std::vector<FaceRecord> faces(facets + 4 * mesh.tets.size());
    parallel_for_each_index(0, facets, [&](std::size_t f) {
      faces[f] = {sorted(surface_.facets[f]), -1 - static_cast<std::int32_t>(f)};
    });
    parallel_for_each_index(0, mesh.tets.size(), [&](std::size_t t) {
      for (std::size_t k = 0; k < 4; ++k)
        faces[facets + 4 * t + k] = {sorted(tet_face(mesh.tets[t], k)),
                                     static_cast<std::int32_t>(4 * t + k)};
    });
    parallel_sort(faces.begin(), faces.end());
    return faces;
  }

  /// The material that the facet has on the side where the tet lies. A facet's normal points from
  /// inside to outside, like that of the inside tet's face.
  [[nodiscard]] MaterialId side_of(const TetMesh& mesh,
                                   std::int32_t owner,
                                   std::int32_t facet) const {
    const auto face = tet_face(mesh.tets[owner / 4], static_cast<std::size_t>(owner % 4));
    const Sides sides = surface_.patch_of[facet].sides;
    return is_rotation(face, surface_.facets[facet]) ? sides.inside : sides.outside;
  }

  static double mean_edge(const TetMesh& mesh) {
    double sum = 0;
    for (const auto& tet : mesh.tets)
      sum += distance(mesh.points[tet[0]], mesh.points[tet[1]]);
    return sum / static_cast<double>(mesh.tets.size());
  }

  static std::string keep_meshed(TetMesh& mesh,
                                 DisjointSets& parts,
                                 const std::vector<std::int32_t>& material) {
    std::size_t kept = 0;
    for (std::size_t t = 0; t < mesh.tets.size(); ++t) {
      const std::int32_t m = material[parts.find(static_cast<std::uint32_t>(t))];
      if (m < 0) return "a connected part of the tets touches no facet of the surface";
      if (m == kExterior) continue;
      mesh.tets[kept++] = mesh.tets[t];
      mesh.material_of.push_back(static_cast<MaterialId>(m));
    }
    mesh.tets.resize(kept);
    return {};
  }

  /// Added points that only dropped tets used.
  void drop_unused_points(TetMesh& mesh) const {
    std::vector<std::int32_t> new_index(mesh.points.size(), -1);
    for (const auto& tet : mesh.tets)
      for (const std::int32_t v : tet)
        new_index[v] = 0;
    std::size_t kept = 0;
    for (std::size_t v = 0; v < mesh.points.size(); ++v) {
      if (v >= surface_.points.size() && new_index[v] < 0) continue;
      new_index[v] = static_cast<std::int32_t>(kept);
      mesh.points[kept++] = mesh.points[v];
    }
    mesh.points.resize(kept);
    for (auto& tet : mesh.tets)
      for (std::int32_t& v : tet)
        v = new_index[v];
  }

  std::string check_volumes(const TetMesh& mesh) {
    std::vector<double> filled(volumes_.size(), 0.0);
    for (std::size_t t = 0; t < mesh.tets.size(); ++t) {
      filled[mesh.material_of[t]] += volume6_of(mesh, mesh.tets[t]) / 6;
    }
    volume_error_ = 0;
    for (std::size_t m = 1; m < volumes_.size(); ++m) {
      const double error = std::abs(filled[m] - volumes_[m]) / std::abs(volumes_[m]);
      if (!(error <= kVolumeTolerance))
        return names_.material(static_cast<MaterialId>(m)) + " encloses " +
               format_number(volumes_[m]) + " mm^3, but its tets fill " + format_number(filled[m]) +
               " mm^3";
      volume_error_ = std::max(volume_error_, error);
    }
    return {};
  }

  const InterfaceMesh& surface_;
  const MeshNames& names_;
  std::vector<double> volumes_;
  double volume_error_ = 0;
  bool leaves_facet_out_ = false;
};

}  // namespace

BuildTetMeshResult build_tet_mesh(tetgen_protocol::Reply reply,
                                  const InterfaceMesh& surface,
                                  std::size_t material_count,
                                  const MeshNames& names,
                                  const StageContext& context) {
  Builder builder(surface, material_count, names);
  BuildTetMeshResult result;
  result.fault = builder.build(std::move(reply), result.mesh, context);
  result.volume_error = builder.volume_error();
  result.leaves_facet_out = builder.leaves_facet_out();
  return result;
}

}  // namespace cvmesh
