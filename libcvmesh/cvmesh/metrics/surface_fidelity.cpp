// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/metrics/surface_fidelity.h"

#include "cvmesh/core/error.h"
#include "cvmesh/core/parallel.h"
#include "cvmesh/grid/shear.h"
#include "cvmesh/metrics/directed_distance.h"
#include "cvmesh/metrics/measured_surfaces.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <functional>
#include <utility>
#include <vector>

namespace cvmesh {
namespace {

constexpr char kStage[] = "metrics";
// Spacings that differ by less than the rounding of a header's floats count as equal.
constexpr double kSameSpacing = 1e-6;
// A surface of more square voxels than this has nothing to do with the volume: the boundary of the
// largest volumes that fit into memory has 1e8.
constexpr double kMostSquareVoxels = 1e9;
// Nor has one that is farther away than this; the search tree computes in floats.
constexpr double kMostVoxels = 1e9;

struct BothDirections {
  DirectedDistances forward, back;
};

// The orders of the search trees' shapes, once they are known.
struct TreeOrders {
  std::vector<std::uint32_t> mesh, reference;
};

template <typename Surface>
ShapeTree<Surface> tree_of(const Surface& surface, std::vector<std::uint32_t>& order) {
  if (!order.empty()) return ShapeTree<Surface>(surface, std::move(order));
  ShapeTree<Surface> tree(surface);
  order = tree.order();
  return tree;
}

template <typename Mesh, typename Reference>
BothDirections measure_both(const Mesh& mesh,
                            const Reference& reference,
                            std::size_t materials,
                            const DirectionOptions& options,
                            TreeOrders& orders) {
  BothDirections result;
  result.forward =
      Direction(mesh, reference, tree_of(reference, orders.reference), materials, options)
          .measure();
  result.back =
      Direction(reference, mesh, tree_of(mesh, orders.mesh), materials, options).measure();
  return result;
}

template <typename TwoSided>
void store(const BothDirections& both, TwoSided SurfaceDistance::*space, SurfaceDistances& result) {
  const auto two_sided = [](const DistanceStats& forward, const DistanceStats& back) {
    return TwoSidedDistance{forward, back};
  };
  result.overall.*space = two_sided(both.forward.overall, both.back.overall);
  for (std::size_t m = 0; m < result.of_material.size(); ++m)
    result.of_material[m].*space = two_sided(both.forward.of_material[m], both.back.of_material[m]);
  for (const auto& [pair, stats] : both.forward.of_pair)
    result.of_pair[pair].*space = two_sided(stats, both.back.of_pair.at(pair));
}

DistanceStats rescaled(DistanceStats stats, double factor) {
  for (double DistanceStats::*member :
       {&DistanceStats::max, &DistanceStats::max_error, &DistanceStats::p95, &DistanceStats::mean,
        &DistanceStats::mean_standard_error, &DistanceStats::rms})
    stats.*member *= factor;
  return stats;
}

void mm_from_voxels(SurfaceDistance& distance, double spacing_mm) {
  distance.mm = {rescaled(distance.voxels.mesh_to_reference, spacing_mm),
                 rescaled(distance.voxels.reference_to_mesh, spacing_mm)};
}

bool is_isotropic(const Vec3& spacing) {
  return std::abs(spacing.y - spacing.x) <= kSameSpacing * spacing.x &&
         std::abs(spacing.z - spacing.x) <= kSameSpacing * spacing.x;
}

void check_options(const SurfaceFidelityOptions& options) {
  require(options.samples_per_square_voxel > 0 && options.samples_per_square_voxel <= 1e4,
          ErrorCode::BadParameter, kStage,
          "samples_per_square_voxel (" + std::to_string(options.samples_per_square_voxel) +
              ") must be above 0 and at most 10000");
  require(options.max_error_vox >= 1e-4, ErrorCode::BadParameter, kStage,
          "max_error_vox (" + std::to_string(options.max_error_vox) + ") must be at least 0.0001");
}

bool has_area(const InterfaceMesh& surface) {
  return std::any_of(surface.facets.begin(), surface.facets.end(), [&](const auto& f) {
    return norm(area_vector2(surface.points[f[0]], surface.points[f[1]], surface.points[f[2]])) > 0;
  });
}

// Facets are cut into pieces along their sides, so that long thin ones count by their length.
void check_extent(const InterfaceMesh& surface, const Vec3& spacing) {
  const double extent = deterministic_reduce(
      0, surface.facets.size(), 0.0,
      [&](std::size_t f) {
        const auto& [i, j, k] = surface.facets[f];
        const Vec3 a = divided_by(surface.points[i], spacing),
                   b = divided_by(surface.points[j], spacing),
                   c = divided_by(surface.points[k], spacing);
        return norm(area_vector2(a, b, c)) / 2 + distance(a, b) + distance(b, c);
      },
      std::plus<>());
  require(extent <= kMostSquareVoxels, ErrorCode::BadInput, kStage,
          "the surface extends over " + std::to_string(extent) +
              " square voxels, too many to be measured (1e9); is it in the volume's coordinates?");
  for (const Vec3& p : surface.points) {
    const double away = norm(divided_by(p, spacing));
    require(away <= kMostVoxels, ErrorCode::BadInput, kStage,
            "the surface has a point " + std::to_string(away) +
                " voxels from the volume, too far to be measured (1e9); is it in the volume's "
                "coordinates?");
  }
}

// Measures in index space and, where the voxels are not cubes, once more in mm.
// `make_reference(scale)` gives the reference surface in a space.
template <typename MakeReference>
SurfaceDistances measure(const InterfaceMesh& surface,
                         const GridFrame& frame,
                         std::size_t materials,
                         const SurfaceFidelityOptions& options,
                         const MakeReference& make_reference) {
  check_options(options);
  const Vec3& spacing = frame.spacing_mm;
  check_extent(surface, spacing);
  SurfaceDistances result;
  result.of_material.resize(materials);
  TreeOrders orders;
  const auto run = [&](const Vec3& unit_mm, double voxel,
                       TwoSidedDistance SurfaceDistance::*space) {
    const Vec3 scale = divided_by({1, 1, 1}, unit_mm);
    const DirectionOptions direction{.samples_per_square_voxel = options.samples_per_square_voxel,
                                     .max_error = options.max_error_vox * voxel,
                                     .unit_mm = unit_mm,
                                     .spacing_mm = spacing};
    store(measure_both(FacetSurface(surface, scale), make_reference(scale), materials, direction,
                       orders),
          space, result);
  };
  run(spacing, 1, &SurfaceDistance::voxels);
  if (!is_isotropic(spacing)) {
    run({1, 1, 1}, frame.voxel_mm(), &SurfaceDistance::mm);
    return result;
  }
  mm_from_voxels(result.overall, spacing.x);
  for (SurfaceDistance& distance : result.of_material)
    mm_from_voxels(distance, spacing.x);
  for (auto& [pair, distance] : result.of_pair)
    mm_from_voxels(distance, spacing.x);
  return result;
}

InterfaceMesh mapped(InterfaceMesh surface, const Affine& map) {
  for (Vec3& p : surface.points)
    p = map(p);
  return surface;
}

void map_places(DirectedDistances& distances, const Affine& map) {
  const auto map_place = [&](DistanceStats& stats) { stats.worst_mm = map(stats.worst_mm); };
  map_place(distances.overall);
  std::for_each(distances.of_material.begin(), distances.of_material.end(), map_place);
  for (auto& [pair, stats] : distances.of_pair)
    map_place(stats);
}

// Measures in world mm, where lengths are others than in grid mm: in a sheared volume. Voxels are
// no cubes there; pieces and samples are as dense as for cubes of the smallest spacing.
template <typename Reference>
void measure_in_world(const InterfaceMesh& surface,
                      const Reference& reference,
                      const GridFrame& frame,
                      const SurfaceFidelityOptions& options,
                      SurfaceDistances& result) {
  const double voxel = frame.voxel_mm();
  const DirectionOptions direction{.samples_per_square_voxel = options.samples_per_square_voxel,
                                   .max_error = options.max_error_vox * voxel,
                                   .unit_mm = {1, 1, 1},
                                   .spacing_mm = {voxel, voxel, voxel}};
  const Affine to_world = mm_to_world_vector(frame);
  const InterfaceMesh in_world = mapped(surface, to_world);
  TreeOrders orders;
  BothDirections both = measure_both(FacetSurface(in_world, {1, 1, 1}), reference,
                                     result.of_material.size(), direction, orders);
  const Affine to_grid = inverse(to_world);
  map_places(both.forward, to_grid);
  map_places(both.back, to_grid);
  store(both, &SurfaceDistance::world_mm, result);
}

}  // namespace

double TwoSidedDistance::hausdorff_lower_bound() const {
  return std::max(mesh_to_reference.max, reference_to_mesh.max);
}

double TwoSidedDistance::hausdorff_upper_bound() const {
  return std::max(mesh_to_reference.max + mesh_to_reference.max_error,
                  reference_to_mesh.max + reference_to_mesh.max_error);
}

double TwoSidedDistance::mean_symmetric() const {
  return (mesh_to_reference.mean + reference_to_mesh.mean) / 2;
}

double TwoSidedDistance::rms_symmetric() const {
  return std::sqrt((mesh_to_reference.rms * mesh_to_reference.rms +
                    reference_to_mesh.rms * reference_to_mesh.rms) /
                   2);
}

SurfaceDistances measure_distances(const InterfaceMesh& surface,
                                   const InterfaceMesh& reference,
                                   const GridFrame& frame,
                                   std::size_t material_count,
                                   const SurfaceFidelityOptions& options) {
  check_extent(reference, frame.spacing_mm);
  SurfaceDistances result =
      measure(surface, frame, material_count, options,
              [&](const Vec3& scale) { return FacetSurface(reference, scale); });
  if (is_sheared(frame)) {
    const InterfaceMesh in_world = mapped(reference, mm_to_world_vector(frame));
    measure_in_world(surface, FacetSurface(in_world, {1, 1, 1}), frame, options, result);
  }
  return result;
}

SurfaceDistances measure_distances(const InterfaceMesh& surface,
                                   const Grid<MaterialId>& ids,
                                   std::size_t material_count,
                                   const SurfaceFidelityOptions& options) {
  const std::vector<VoxelFace> faces = find_voxel_faces(ids);
  const Vec3& spacing = ids.frame.spacing_mm;
  SurfaceDistances result =
      measure(surface, ids.frame, material_count, options,
              [&](const Vec3& scale) { return VoxelFaceSurface(faces, spacing, scale); });
  if (is_sheared(ids.frame))
    measure_in_world(surface, MappedFaceSurface(faces, spacing, mm_to_world_vector(ids.frame)),
                     ids.frame, options, result);
  return result;
}

SurfaceFidelity measure_surface_fidelity(const InterfaceMesh& surface,
                                         const InterfaceMesh* dense,
                                         const InterfaceMesh* truth,
                                         const LabelVolume& labels,
                                         const SurfaceFidelityOptions& options,
                                         const StageContext& context) {
  SurfaceFidelity result;
  result.options = options;
  if (dense != nullptr)
    result.to_dense =
        measure_distances(surface, *dense, labels.frame(), labels.material_count(), options);
  report_progress(context, kStage, 0.75);  // the other metrics were the first half
  result.to_labels = measure_distances(surface, labels.ids, labels.material_count(), options);
  if (truth != nullptr) {
    require(has_area(*truth), ErrorCode::BadInput, kStage,
            "the true surface has no area: each of its facets is a line or a point");
    result.to_truth =
        measure_distances(surface, *truth, labels.frame(), labels.material_count(), options);
    result.to_truth->of_material.clear();  // the truth does not say whose boundary it is
  }
  report_progress(context, kStage, 1);
  return result;
}

}  // namespace cvmesh
