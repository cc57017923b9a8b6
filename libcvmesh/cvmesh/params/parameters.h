// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/core/label.h"
#include "cvmesh/labels/clean_labels.h"
#include "cvmesh/labels/voxel_box.h"
#include "cvmesh/levelset/tighten.h"
#include "cvmesh/medial/extract_medial_axis.h"
#include "cvmesh/particles/distribute_particles.h"
#include "cvmesh/sizing/compute_sizing_field.h"
#include "cvmesh/surface/decimate.h"
#include "cvmesh/surface/decimate_sequential.h"
#include "cvmesh/surface/fit_vertices.h"
#include "cvmesh/surface/flip_edges.h"
#include "cvmesh/tet/tetrahedralize.h"

#include <array>
#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <variant>
#include <vector>

namespace cvmesh {

/// Spacing of an isotropic working grid: a length, or ("auto") the smallest of the volume.
struct GridSpacing {
  bool is_auto = false;
  double mm = 0;  ///< where it is not `is_auto`
  friend bool operator==(const GridSpacing&, const GridSpacing&) = default;
};

/// What a parameter file may say about one label, under "labels": {"<value>": {...}}.
struct LabelParameters {
  std::optional<std::string> name;
  std::optional<double> r, epsilon, min_edge_mm, max_edge_mm;
};

/// What a parameter file may say about the interface of two labels, in an entry of "interfaces".
struct InterfaceParameters {
  std::array<Label, 2> labels{0, 0};  ///< in any order; 0 may stand for the exterior
  std::optional<double> epsilon{}, min_edge_mm{}, max_edge_mm{};
};

/// What a parameter file may say about a box of the input volume, in an entry of "boxes".
struct BoxParameters {
  VoxelBox box;
  std::optional<double> epsilon{}, min_edge_mm{}, max_edge_mm{};
};

/// One of the user's labels, by value or by name.
using LabelReference = std::variant<Label, std::string>;

/// What a parameter file may say about a second image, in "sample": a linear density and a
/// power-law modulus for the tets of some labels.
struct SampleParameters {
  std::vector<Label> labels;             ///< empty: all
  std::optional<double> density_slope;   ///< g/cm3 per unit of the image; empty: no density
  double density_intercept = 0;          ///< g/cm3
  std::optional<double> modulus_factor;  ///< MPa at 1 g/cm3; empty: no modulus
  double modulus_exponent = 1;
  double min_modulus_mpa = 1;  ///< of what is lighter, such as fat, and of densities below 0
  double poisson_ratio = 0.3;
  int bins = 0;  ///< elastic materials for solvers, equally wide in modulus; 0: none
};

/// What decides where a wanted number of vertices or tets goes.
enum class TargetSizes {
  Deviation,    ///< where it brings the facets nearest to the surface, see `size_by_deviation`
  FeatureSize,  ///< in proportion to the local feature size, as with a given epsilon
};

/// How the material surfaces come from the particles.
enum class SurfaceMethod {
  Decimation,  ///< the dense surfaces, thinned out to the particles: their topology
  Delaunay,    ///< faces between the labels of the particles' Delaunay tets: a baseline
};

/// Bounds that a finished mesh is to keep; one that misses any is written all the same.
struct QualityGates {
  std::optional<double> min_dihedral_deg, max_dihedral_deg;  ///< of all tets
  std::optional<double> min_tet_quality;                     ///< 3r/R
  std::optional<double> min_scaled_jacobian;
  std::optional<double> max_volume_error_percent;                     ///< of every label
  std::optional<double> max_distance_mm, max_distance_vox;            ///< to the dense surface
  std::optional<double> max_mean_distance_mm, max_mean_distance_vox;  ///< to the dense surface
  std::optional<std::size_t> max_kept_vertices;
};

/// Everything that decides a mesh besides the label volume: the options of all stages, whose
/// defaults are the defaults of the parameter file. The JSON keys are listed in
/// `parameter_table()`; labels are the user's values here, material ids only inside a run.
struct Parameters {
  std::uint64_t seed = 1;
  /// Surface vertices wanted; cvmesh then finds the epsilon, and `sizing.epsilon` is not used.
  std::optional<std::size_t> target_vertices;
  /// Tets wanted, in the same way.
  std::optional<std::size_t> target_tets;
  TargetSizes target_sizes = TargetSizes::Deviation;  ///< of these two
  /// The largest distance between the sparse and the dense surface, in the same way; one voxel is
  /// the smallest spacing of the working grid. At most one of the two.
  std::optional<double> max_distance_mm, max_distance_vox;
  std::map<Label, LabelParameters> labels;
  std::vector<InterfaceParameters> interfaces;  ///< each pair of labels once
  std::vector<BoxParameters> boxes;             ///< of two values for one place the later one rules
  std::vector<std::array<LabelReference, 2>> contact;  ///< interfaces that are cut open
  SampleParameters sample;
  /// Working grid of all stages between labels and metrics; empty for that of the volume.
  std::optional<GridSpacing> grid_spacing_mm;

  Schedule schedule = Schedule::LockStep;
  SurfaceMethod surface = SurfaceMethod::Decimation;

  CleanLabelsOptions clean_labels;
  TightenOptions tighten;
  MedialAxisOptions medial_axis;
  SizingOptions sizing;
  SeedParticlesOptions seed_particles;
  DistributeParticlesOptions distribute_particles;
  /// Tolerance of decimation and flips, in voxels; empty: what the particles' edges ask for. It
  /// rules over the `deviation_vox` of their own options.
  std::optional<double> deviation_vox;
  DecimateOptions decimate;
  FitVerticesOptions fit_vertices;
  FlipEdgesOptions flip_edges;
  TetrahedralizeOptions tetrahedralize;
  int element_order = 1;         ///< 2: with nodes on the edges
  bool curved_elements = false;  ///< those on the surface move onto the dense surface
  QualityGates gates;
};

}  // namespace cvmesh
