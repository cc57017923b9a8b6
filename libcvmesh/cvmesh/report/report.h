// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/grid/grid_frame.h"
#include "cvmesh/interfaces/compact_interfaces.h"
#include "cvmesh/labels/clean_labels.h"
#include "cvmesh/labels/lattice_topology.h"
#include "cvmesh/levelset/build_level_sets.h"
#include "cvmesh/levelset/resample_labels.h"
#include "cvmesh/levelset/tighten.h"
#include "cvmesh/medial/extract_medial_axis.h"
#include "cvmesh/mesh/validate.h"
#include "cvmesh/metrics/label_tets.h"
#include "cvmesh/metrics/mesh_counts.h"
#include "cvmesh/metrics/surface_fidelity.h"
#include "cvmesh/metrics/tet_quality.h"
#include "cvmesh/metrics/volume_error.h"
#include "cvmesh/params/parameters.h"
#include "cvmesh/particles/distribute_particles.h"
#include "cvmesh/report/check_gates.h"
#include "cvmesh/report/particle_counts.h"
#include "cvmesh/sizing/compute_sizing_field.h"
#include "cvmesh/surface/conform_edges.h"
#include "cvmesh/surface/decimate.h"
#include "cvmesh/surface/fit_vertices.h"
#include "cvmesh/surface/flip_edges.h"
#include "cvmesh/surface/insert_particles.h"
#include "cvmesh/surface/remove_needles.h"
#include "cvmesh/tet/delaunay_tets.h"
#include "cvmesh/tet/second_order.h"
#include "cvmesh/tet/split_contacts.h"
#include "cvmesh/tet/tetrahedralize.h"

#include <array>
#include <cstddef>
#include <map>
#include <optional>
#include <string>
#include <vector>

namespace cvmesh {

/// What the run started from.
struct InputSummary {
  std::string file;  ///< name without folders
  std::array<int, 3> dims{0, 0, 0};
  Vec3 spacing_mm;
  Space space = Space::Unknown;         ///< of the file
  Space output_space = Space::Unknown;  ///< of the coordinates that were written
  std::vector<Label> labels;            ///< all values in the file, ascending
  std::string file_sha256{};            ///< of the file as it is stored
  /// Of the labels in it: 32-bit little-endian integers, x fastest. The same for every file format.
  std::string labels_sha256{};
};

/// Size of the dense surfaces.
struct SurfaceSummary {
  std::size_t vertices = 0, facets = 0, patches = 0, curves = 0, corners = 0;
  CompactionStats compaction;
};

/// What was sampled onto the tets.
struct SamplingSummary {
  std::string file;                   ///< name without folders
  double min_mean = 0, max_mean = 0;  ///< of the tets, in units of the image
  std::size_t bins = 0;               ///< elastic materials
};

/// How cvmesh found the scale of the sizes itself.
struct EpsilonSearch {
  std::string target;              ///< the key that asked for it
  double wanted = 0, reached = 0;  ///< in the unit of the key
  /// What stands in for the key epsilon; for a distance, the median over the surface of h over the
  /// local feature size, since h follows the distances there.
  double epsilon = 0;
  int rounds = 0;  ///< times that particles were seeded and distributed
};

/// The stats of every stage that has run; the others are empty.
struct StageResults {
  std::optional<CleanLabelsStats> labels;
  std::optional<ResampleLabelsStats> resampling;
  std::optional<BuildLevelSetsStats> level_sets;
  std::optional<TightenStats> tightening;
  std::optional<SurfaceSummary> dense_surfaces;
  std::optional<MedialAxisStats> medial_axis;
  std::optional<SizingStats> sizing_field;
  std::optional<EpsilonSearch> epsilon_search;
  std::optional<SeedParticlesStats> seed_particles;
  std::optional<DistributeParticlesStats> particles;
  std::optional<InsertParticlesStats> insertion;
  std::optional<DecimateStats> decimation;
  std::optional<ConformEdgesStats> edge_conformity;  ///< only of the sequential schedule
  std::optional<FitVerticesStats> vertex_fit;
  std::optional<FlipEdgesStats> edge_flipping;
  std::optional<RemoveNeedlesStats> needles;
  std::optional<DelaunayTetsStats> delaunay_tets;  ///< only of that baseline
  std::optional<TetrahedralizeStats> tetrahedra;
  std::optional<SecondOrderStats> second_order;
  std::optional<SplitContactsStats> contacts;
  std::optional<SamplingSummary> sampling;
};

/// Topology of one material from voxels to mesh. For a solid, the Euler characteristic of the
/// boundary is twice that of the voxels, and each component has one outer boundary.
struct MaterialTopology {
  LatticeTopology voxels;
  std::optional<BoundaryTopology> dense;  ///< empty where there is no dense surface
  BoundaryTopology mesh;
  std::size_t dense_components = 0, mesh_components = 0;  ///< of the solid
  std::optional<long long> mesh_euler;  ///< V - E + F - T of the tets, where they were counted
};

/// What was verified on the finished mesh; a run that fails one of these ends with an error, a
/// judged mesh is reported as it is.
struct Checks {
  bool surface_is_valid = false;  ///< closed manifold per material, no degenerate facet
  std::size_t surface_intersections = 0;
  bool labels_are_complete = false;    ///< every label and component of the voxels is there
  bool topology_as_lattice14 = false;  ///< Euler characteristics are those of the voxels
  std::optional<bool> tets_are_valid;  ///< empty when only surfaces were asked for
  std::vector<std::string> faults;     ///< of a judged mesh: one sentence each
};

/// A mesh that came from a file instead of from a run.
struct JudgedMesh {
  std::string file;          ///< name without folders
  std::string label_source;  ///< the array or field of the file that has the labels
  std::size_t other_elements = 0, unused_points = 0;
  TetFaults faults;
};

/// Time and memory of one stage, summed over its repetitions.
struct StageTiming {
  std::string stage;
  double seconds = 0;
  double peak_mb = 0;  ///< largest resident memory while the stage ran
};

/// Everything that a run reports. Per-material vectors are indexed by material id; `[0]` is the
/// exterior. Timings stand apart from results: equal runs give equal results.
struct Report {
  std::string version;
  std::map<std::string, std::string> libraries;  ///< name -> version
  std::string run_key;  ///< of everything that decides the files, see `run_key`
  InputSummary input;
  Parameters parameters;

  std::vector<Label> label_of;       ///< material id -> label; [0]: what files call the exterior
  std::vector<std::string> name_of;  ///< material id -> name
  Affine mm_to_out;                  ///< grid mm -> coordinates of the output
  StageResults stages;
  std::optional<ParticleCounts> particle_counts;
  std::optional<MeshCounts> mesh;
  std::optional<MeshQuality> quality;
  std::optional<SurfaceFidelity> distances;
  std::vector<VolumeError> volumes;
  std::vector<MaterialTopology> topology;
  std::optional<Checks> checks;
  std::optional<JudgedMesh> judged;   ///< only of a mesh that was judged
  std::vector<std::string> warnings;  ///< of the log, in order
  std::vector<GateResult> gates;      ///< those of the parameters

  std::vector<StageTiming> timings;  ///< in order of first run
  double total_seconds = 0;
  double peak_mb = 0;
  int threads = 0;
};

}  // namespace cvmesh
