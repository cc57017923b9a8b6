// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/levelset/level_sets.h"
#include "cvmesh/mesh/interface_mesh.h"
#include "cvmesh/particles/particle_set.h"
#include "cvmesh/sizing/sizing_field.h"

#include <array>
#include <cmath>
#include <cstdint>
#include <vector>

namespace cvmesh {

/// Everything the particle stages read.
struct ParticleDomain {
  const InterfaceMesh& dense;
  const Strata& strata;
  const LevelSets& level_sets;
  const SizingField& sizing_field;
};

/// One connected component of a patch: what its particles share.
struct Sheet {
  std::int32_t patch = -1;
  bool is_closed = true;             ///< no curve bounds it
  bool has_loops = false;            ///< that bound nothing: neither a sphere nor a disc
  std::vector<std::int32_t> facets;  ///< of the dense mesh, ascending
  std::size_t vertex_count = 0;
  double lattice_count = 0;  ///< (2 / sqrt 3) * integral of dA / h^2
  double field_count = 0;    ///< the same before h was lowered at short loops
  /// Total geodesic curvature of the boundary over 2 pi: 1 for a flat disc, 0 for a hemisphere.
  double boundary_turns = 0;
};

/// Two unit vectors across a unit normal, right-handed with it.
struct TangentFrame {
  Vec3 u, v;

  explicit TangentFrame(const Vec3& normal)
      : u(normalized(cross(std::abs(normal.x) < 0.6 ? Vec3{1, 0, 0} : Vec3{0, 1, 0}, normal))),
        v(cross(normal, u)) {}

  [[nodiscard]] Vec3 at_angle(double radians) const {
    return std::cos(radians) * u + std::sin(radians) * v;
  }
};

/// Where a point of the surface is, and what is known there.
struct SurfacePoint {
  Vec3 position;  ///< grid mm
  Vec3 normal;    ///< unit, of the dense surface, smoothed inside the sheet
  double h_mm = 0;
  std::int32_t facet = -1;    ///< the carrier
  double curve_distance = 0;  ///< from the curve edges of the carrier; large when it has none
  bool is_projected = false;  ///< on the zero set (or the wall plane), not just on the facet
};

/// The dense surface cut into sheets, with all that is needed to move points on it.
///
/// A point walks over neighbouring facets and never leaves its sheet; then it is projected onto
/// the zero set of f_inside - f_outside [Meyer 2008]. A projection counts only within half a
/// voxel of the facet, because the zero set goes on behind a junction curve and other interfaces
/// of the same two materials may be near. On the border of the image the surface is a plane, and
/// points keep to it exactly.
class Sheets {
 public:
  /// @throws Error Internal when the sizing field does not belong to the dense surface
  explicit Sheets(const ParticleDomain& domain);

  std::vector<Sheet> sheets;           ///< ordered by their smallest facet
  std::vector<double> h_mm;            ///< per dense vertex, with room on every short loop
  std::vector<std::int32_t> sheet_of;  ///< per facet

  [[nodiscard]] const ParticleDomain& domain() const { return domain_; }

  [[nodiscard]] double voxel_mm() const { return voxel_mm_; }

  /// The surface point that is reached from `facet` towards `p`.
  [[nodiscard]] SurfacePoint move(std::int32_t facet, const Vec3& p) const;
  /// The point of `facet` with the given barycentric weights, projected.
  [[nodiscard]] SurfacePoint place(std::int32_t facet, const Vec3& weights) const;
  /// What is known at a point that is on the surface already (not projected again).
  [[nodiscard]] SurfacePoint describe(std::int32_t facet, const Vec3& p) const;

  /// Sheets that touch dense vertex v, or edge (v, w), each with the mean of its facets' normals
  /// there: what a corner or curve particle is to the particles of a sheet.
  struct Touch {
    std::int32_t sheet = -1;
    std::int32_t facet = -1;  ///< of the sheet, there
    Vec3 normal;
  };

  [[nodiscard]] std::vector<Touch> touching(std::int32_t v, std::int32_t w = -1) const;

  /// The corner of a facet that is nearest to `p`.
  [[nodiscard]] std::int32_t nearest_vertex(std::int32_t facet, const Vec3& p) const;
  /// A dense vertex as a place on one of the sheets around it, projected off the curves only.
  [[nodiscard]] SurfacePoint at_vertex(std::int32_t v, std::int32_t sheet) const;

  [[nodiscard]] const Vec3& vertex_normal(std::int32_t v) const { return vertex_normal_[v]; }

  /// The facet of lowest index around a dense vertex.
  [[nodiscard]] std::int32_t first_facet(std::int32_t v) const {
    return stars_.facet[stars_.first[v]];
  }

  [[nodiscard]] double facet_area(std::int32_t f) const;
  [[nodiscard]] double facet_h(std::int32_t f) const;  ///< mean over its vertices

 private:
  struct OnFacet {
    std::int32_t facet = -1;
    Vec3 point;
    double squared_distance = 0;
  };

  void link_facets();
  void find_sheets();
  void measure_sheets();
  void lower_h();
  [[nodiscard]] double count_at_h(const Sheet& sheet) const;
  [[nodiscard]] OnFacet nearest_in(std::int32_t facet, const Vec3& p) const;
  [[nodiscard]] OnFacet walk(std::int32_t facet, const Vec3& p, bool is_short) const;
  [[nodiscard]] bool project(const PatchKey& patch, Vec3& p) const;
  [[nodiscard]] SurfacePoint settle(const OnFacet& start) const;
  void describe_at(const OnFacet& at, SurfacePoint& point) const;

  ParticleDomain domain_;
  double voxel_mm_ = 1;
  VertexStars stars_;
  std::vector<std::array<std::int32_t, 3>> across_;  // neighbour over edge (k, k + 1), or -1
  std::vector<Vec3> facet_normal_, vertex_normal_;
};

/// A corner or curve particle as the particles of one sheet see it.
struct RimParticle {
  std::int32_t particle = -1;  ///< index into the corner and curve particles
  SurfacePoint place;          ///< with facet and normal of this sheet
  bool is_by_size = true;      ///< not one of a bend, beyond what the sizing field asks for
};

/// Corner and curve particles around each sheet, in the order of the particles.
std::vector<std::vector<RimParticle>> find_rims(const Sheets& sheets,
                                                const std::vector<Particle>& corners_and_curves);

/// Particles that the inside of a sheet holds at the spacing of the sizing field. By Euler's
/// formula F = 2 n + rim - 2 chi triangles of area sqrt 3 h^2 / 4 fill the sheet; chi enters
/// through Gauss-Bonnet, so that the count for a closed sheet is (2 / sqrt 3) * integral dA / h^2.
/// @param lattice_count  `Sheet::lattice_count` or `Sheet::field_count`
/// @param rim            around the sheet; those of bends do not count
double natural_count(const Sheet& sheet, double lattice_count, const std::vector<RimParticle>& rim);

/// Solves differences[k] = 0 near `p` by Gauss-Newton steps of least length, as Meyer's projection
/// but of second order: p moves by -J^T (J J^T)^-1 g. `is_fixed` coordinates do not change.
/// @return true when `p` is within 1e-4 voxel of the solution and `max_move_mm` of its start
bool project_onto_zero(const LevelSets& level_sets,
                       const std::vector<Sides>& differences,
                       const std::array<bool, 3>& is_fixed,
                       double max_move_mm,
                       Vec3& p);

}  // namespace cvmesh
