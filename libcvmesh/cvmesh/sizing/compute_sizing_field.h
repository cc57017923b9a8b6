// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/core/box3.h"
#include "cvmesh/core/context.h"
#include "cvmesh/core/label.h"
#include "cvmesh/medial/medial_axis.h"
#include "cvmesh/mesh/interface_mesh.h"
#include "cvmesh/sizing/limit_gradation.h"
#include "cvmesh/sizing/sizing_field.h"

#include <cstddef>
#include <limits>
#include <map>
#include <optional>
#include <span>
#include <utility>
#include <vector>

namespace cvmesh {

/// Sizes that differ in one place; what is not set is as around it.
struct OwnSizes {
  std::optional<double> epsilon{}, min_edge_mm{}, max_edge_mm{};
  friend bool operator==(const OwnSizes&, const OwnSizes&) = default;
};

/// Sizes that differ inside a box.
struct BoxSizes {
  Box3 box_mm;  ///< grid mm, its faces included
  OwnSizes sizes;
  friend bool operator==(const BoxSizes&, const BoxSizes&) = default;
};

struct SizingOptions {
  double epsilon = 1.0;          ///< edge length over local feature size
  double delta = 0.4;            ///< gradation: largest slope of h
  double min_feature_vox = 0.8;  ///< floor of the local feature size
  std::optional<double> min_edge_mm, max_edge_mm;
  std::map<MaterialId, OwnSizes> per_material;
  std::map<Sides, OwnSizes> per_interface;  ///< instead of what its materials say
  std::vector<BoxSizes> boxes;              ///< instead of both; of two values the later one
  friend bool operator==(const SizingOptions&, const SizingOptions&) = default;
};

/// Surface vertices whose tets, some twelve for each, 32-bit indices still count.
inline constexpr double kMostVertices = 1e8;

struct SizingStats {
  double lfs_min_mm = 0, lfs_median_mm = 0, lfs_max_mm = 0;
  double h_min_mm = 0, h_median_mm = 0, h_max_mm = 0;
  /// Surface vertices that spacing h leads to: (2 / sqrt 3) times the integral of dA / h^2 over the
  /// interfaces, less half the length of each patch's border over h, plus the vertices of curves
  /// (length over h) and corners.
  double expected_vertices = 0;
  std::size_t capped_vertices = 0;  ///< dense vertices of parts too small for epsilon times LFS
  /// Per material: the share of its boundary, by area, where h > 2 pi LFS / 3. A part of that
  /// radius has fewer than three edges around.
  std::vector<double> share_below_three_facets;
};

struct SizingResult {
  SizingField sizing_field;
  SizingStats stats;
};

/// Local feature size of every dense vertex, in mm: its distance to the medial axis of the
/// materials that meet there, independent of epsilon.
///
/// Vertices of junction curves and corners have a size of the curves instead: the smaller of the
/// radius of curvature and half the distance to curves and corners that are not their neighbours.
/// Within a few voxels of a curve, a sheet's feature size is at least that of the curve and at
/// least half the distance to the nearest curve that does not bound the sheet, whichever is
/// smaller. Along the edges of the dense surface the slope is at most 1. Where no medial point
/// limits it, it is the diagonal of the dense surface's box.
/// @param voxel_mm  smallest spacing of the working grid
/// @note  O(vertices log(medial points)); parallel
std::vector<double> local_feature_size(const InterfaceMesh& dense,
                                       const Strata& strata,
                                       const MedialAxis& medial_axis,
                                       double voxel_mm,
                                       const StageContext& context);

/// h(x) = min over y of clamp(epsilon max(LFS(y), floor), min, max) + delta |x - y|, on the dense
/// vertices and on the grid [Persson 2006, Meyer 2007]; and what such fields of one surface share,
/// so that the field of another epsilon costs less.
///
/// Where materials meet, the smallest of their sizes holds; the exterior counts only where
/// `per_material` names it. What `per_interface` says of two materials takes the place of what they
/// say themselves, wherever they meet; where interfaces meet, the smallest size holds. Inside a box
/// its values take the place of all these, a bound that is set moving one that is not where they
/// cross. The max_edge_mm of a box bounds h in all of the box, and that of a material inside the
/// material too (but not on surfaces, which have their own rules); from there h grows by delta. Two
/// caps keep closed parts meshable at any epsilon, min_edge_mm or not: a closed boundary of area A
/// has h <= sqrt(A / (12 sqrt(3) / 2)), room for 12 vertices, and a closed curve has room for 4.
/// The frame of `volume_h_mm` is `frame`, coarsened by a whole number until it has at most 8
/// million nodes.
class SizingProblem {
 public:
  /// @param labels  of the working grid; this, `dense` and `strata` must outlive the problem
  SizingProblem(const InterfaceMesh& dense,
                const Strata& strata,
                std::vector<double> lfs_mm,
                const Grid<MaterialId>& labels);

  /// @param cap_mm  what h is at most at each dense vertex, whatever the options say: h grows from
  ///                there by delta. Infinity where there is no cap; empty for none at all.
  /// @throws Error BadParameter for epsilon, delta or bounds out of range, and for sizes that ask
  ///         for more than `kMostVertices`
  [[nodiscard]] SizingResult field(const SizingOptions& options,
                                   const StageContext& context,
                                   std::span<const double> cap_mm = {}) const;

  /// About the `expected_vertices` of the field (within 3 % where measured), several times as
  /// fast.
  [[nodiscard]] double estimate_vertices(const SizingOptions& options) const;

  [[nodiscard]] const std::vector<double>& lfs_mm() const { return lfs_mm_; }

  /// From now on epsilon multiplies these lengths, one per dense vertex, instead of the local
  /// feature size and its floor.
  void set_base(std::vector<double> base_mm) { base_mm_ = std::move(base_mm); }

  /// From now on the two caps that leave room on small closed parts do not count: their h is that
  /// of any other part, and so is that of short loops.
  void drop_room() {
    leaves_room_ = false;
    room_mm_.assign(room_mm_.size(), std::numeric_limits<double>::infinity());
  }

 private:
  // A third of the area of one patch's facets around a vertex.
  struct PatchShare {
    std::int32_t patch;
    double area_mm2;
  };

  void find_shares(const VertexStars& stars);
  void cap_by_area(const VertexStars& stars);
  void cap_on_closed_curves();
  [[nodiscard]] std::vector<double> wanted_size(const SizingOptions& options) const;
  std::size_t apply_room(std::vector<double>& h) const;
  void limit_in_materials(const SizingOptions& options, Grid<float>& volume) const;
  [[nodiscard]] Grid<float> volume_of(const std::vector<double>& h,
                                      const SizingOptions& options,
                                      std::size_t max_nodes) const;
  void limit_by_volume(const SizingField& field, std::vector<double>& h) const;
  template <typename PerArea>
  [[nodiscard]] std::vector<double> integrals(const PerArea& per_area) const;
  [[nodiscard]] double expected_vertices(const std::vector<double>& h) const;
  [[nodiscard]] std::vector<double> share_below_three_facets(const std::vector<double>& h) const;

  const InterfaceMesh& dense_;
  const Strata& strata_;
  const Grid<MaterialId>& labels_;
  std::vector<double> lfs_mm_;
  std::vector<double> base_mm_;  // what epsilon multiplies; empty: the local feature size
  SizingStats common_;           // what of the stats does not depend on the options
  VertexNeighbours neighbours_;
  std::vector<std::int32_t> first_share_;
  std::vector<PatchShare> shares_;  // of vertex v: first_share_[v] to first_share_[v + 1]
  std::vector<double> room_mm_;     // at each vertex the largest h that keeps its part meshable
  bool leaves_room_ = true;
};

/// The field of one set of options, see `SizingProblem`.
/// @throws Error BadParameter for epsilon, delta or bounds out of range
SizingResult compute_sizing_field(const InterfaceMesh& dense,
                                  const Strata& strata,
                                  std::vector<double> lfs_mm,
                                  const Grid<MaterialId>& labels,
                                  const SizingOptions& options,
                                  const StageContext& context,
                                  std::span<const double> cap_mm = {});

}  // namespace cvmesh
