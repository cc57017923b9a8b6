// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/params/parameter_table.h"

static_assert(sizeof(std::size_t) == sizeof(std::uint64_t), "the seed is read as a size_t");

namespace cvmesh {

namespace {

/// A field of a struct as the function that finds it.
#define CVMESH_FIELD(member) [](auto& p) -> ParameterField { return &p.member; }

/// Names of the enumerators, in their order.
constexpr std::string_view kSeedings[] = {"front", "dense"};
constexpr std::string_view kTargetSizes[] = {"deviation", "feature_size"};
constexpr std::string_view kOnDegenerate[] = {"keep", "fail"};
constexpr std::string_view kSchedules[] = {"lock-step", "sequential"};
constexpr std::string_view kSurfaceMethods[] = {"decimation", "delaunay"};

/// Integers up to here survive every JSON reader (2^53).
constexpr double kLargestInteger = 9007199254740992.0;
/// No voxel-based length of a sensible run is larger; beyond it a unit was mistaken.
constexpr double kMostVoxels = 1000;
/// Edges between a nanometre and a kilometre.
constexpr double kMostMm = 1e6;

/// The rows of the sizes that an entry of a list may have instead of the global ones.
template <typename Owner>
void add_size_rows(std::string_view epsilon_doc,
                   std::string_view min_doc,
                   std::string_view max_doc,
                   std::vector<ParameterInfo<Owner>>& table) {
  const auto length = [](std::string_view key, std::string_view doc, auto field) {
    return ParameterInfo<Owner>{.key = key,
                                .unit = "mm",
                                .doc = doc,
                                .field = field,
                                .min = 0,
                                .max = kMostMm,
                                .min_is_exclusive = true,
                                .is_optional = true};
  };
  table.push_back({.key = "epsilon",
                   .unit = "edge length / local feature size",
                   .doc = epsilon_doc,
                   .field = CVMESH_FIELD(epsilon),
                   .min = 0,
                   .max = 1000,
                   .min_is_exclusive = true,
                   .is_optional = true});
  table.push_back(length("min_edge_mm", min_doc, CVMESH_FIELD(min_edge_mm)));
  table.push_back(length("max_edge_mm", max_doc, CVMESH_FIELD(max_edge_mm)));
}

}  // namespace

const std::vector<ParameterInfo<Parameters>>& parameter_table() {
  static const std::vector<ParameterInfo<Parameters>> table = {
      {.key = "r",
       .unit = "voxels",
       .doc = "Smallest radius of curvature that the smoothed boundaries keep; one voxel is the "
              "smallest spacing. 0 leaves the boundaries unsmoothed.",
       .field = CVMESH_FIELD(tighten.r_vox),
       .min = 0,
       .max = 20},
      {.key = "epsilon",
       .unit = "edge length / local feature size",
       .doc = "How sparse the mesh is: the surface edges are epsilon times the local feature size. "
              "Larger is coarser and faster. Excludes target_vertices, target_tets, "
              "max_distance_mm and "
              "max_distance_vox, which find it.",
       .field = CVMESH_FIELD(sizing.epsilon),
       .min = 0,
       .max = 1000,
       .min_is_exclusive = true,
       .is_optional = true},
      {.key = "delta",
       .unit = "mm / mm",
       .doc = "Gradation: the largest slope of the edge length along the surface and into the "
              "volume. Smaller is more uniform, with more vertices.",
       .field = CVMESH_FIELD(sizing.delta),
       .min = 0.01,
       .max = 10},
      {.key = "seed",
       .doc = "Seed of all random numbers; equal input, parameters and seed give equal bytes.",
       .field = CVMESH_FIELD(seed),
       .min = 0,
       .max = kLargestInteger},
      {.key = "target_vertices",
       .unit = "surface vertices",
       .doc = "Wanted number of surface vertices; cvmesh finds the edges that give it within "
              "2 %. Excludes epsilon. Costs some repetitions of the particle stages.",
       .field = CVMESH_FIELD(target_vertices),
       .min = 12,
       .max = 1e9,
       .is_optional = true},
      {.key = "target_tets",
       .unit = "tets",
       .doc = "Wanted number of tets; cvmesh finds the edges that give it within 5 %. Costs "
              "repetitions of all stages from the particles on. Not with --surface-only.",
       .field = CVMESH_FIELD(target_tets),
       .min = 12,
       .max = 1e9,
       .is_optional = true},
      {.key = "target_sizes",
       .doc =
           "Where a wanted number of vertices or tets goes: \"deviation\" puts them where they "
           "bring the facets nearest to the surface, \"feature_size\" makes the edges a multiple "
           "of the local feature size, as a given epsilon does.",
       .field = CVMESH_FIELD(target_sizes),
       .choices = kTargetSizes},
      {.key = "max_distance_mm",
       .unit = "mm",
       .doc = "Wanted bound of the distance between the final and the dense surface; cvmesh finds "
              "epsilon and refines where the distance is larger. Costs repetitions of the stages "
              "from the particles to the flips.",
       .field = CVMESH_FIELD(max_distance_mm),
       .min = 0,
       .max = kMostMm,
       .min_is_exclusive = true,
       .is_optional = true},
      {.key = "max_distance_vox",
       .unit = "voxels",
       .doc = "The same in voxels, one being the smallest spacing.",
       .field = CVMESH_FIELD(max_distance_vox),
       .min = 0.05,
       .max = kMostVoxels,
       .is_optional = true},
      {.key = "min_island_voxels",
       .unit = "voxels",
       .doc = "Components of a label that are smaller go to the neighbouring label; 1 keeps all.",
       .field = CVMESH_FIELD(clean_labels.min_island_voxels),
       .min = 1,
       .max = kLargestInteger},
      {.key = "min_hole_voxels",
       .unit = "voxels",
       .doc = "Holes of the background that are smaller and do not touch the border of the volume "
              "go to the neighbouring label; 0 fills none.",
       .field = CVMESH_FIELD(clean_labels.min_hole_voxels),
       .min = 0,
       .max = kLargestInteger},
      {.key = "mesh_background",
       .doc = "Mesh label 0 like any other label.",
       .field = CVMESH_FIELD(clean_labels.mesh_background)},
      {.key = "region_of_interest",
       .unit = "voxels",
       .doc = "First and last voxel of the part to mesh, [i0, j0, k0, i1, j1, k1], both included, "
              "counted from 0; the volume ends there. null for all of it.",
       .field = CVMESH_FIELD(clean_labels.region_of_interest),
       .is_optional = true},
      {.key = "merge_labels",
       .doc =
           "Labels that become another one before islands and holes are looked for, by the label "
           "that stays: {\"2\": [3, 4]}.",
       .field = CVMESH_FIELD(clean_labels.merge_labels)},
      {.key = "drop_labels",
       .doc = "Labels that become background before islands and holes are looked for.",
       .field = CVMESH_FIELD(clean_labels.drop_labels)},
      {.key = "keep_labels",
       .doc = "The only labels to mesh: all others become background, but for those that "
              "merge_labels turns into one of them. Empty: all.",
       .field = CVMESH_FIELD(clean_labels.keep_labels)},
      {.key = "labels",
       .doc = "Names, radii and sizes of single labels, by label value: {\"2\": {\"name\": "
              "\"cortical\", "
              "\"epsilon\": 0.5}}.",
       .field = CVMESH_FIELD(labels)},
      {.key = "interfaces",
       .doc = "Sizes of single interfaces, instead of what their labels say: [{\"labels\": [2, 3], "
              "\"epsilon\": 0.5}]; label 0 is the exterior.",
       .field = CVMESH_FIELD(interfaces)},
      {.key = "boxes",
       .unit = "voxels",
       .doc =
           "Sizes inside boxes of voxels, instead of all others: [{\"box\": [i0, j0, k0, i1, j1, "
           "k1], \"epsilon\": 0.5}], counted as for region_of_interest. Where boxes overlap, the "
           "last one that gives a value rules.",
       .field = CVMESH_FIELD(boxes)},
      {.key = "grid_spacing_mm",
       .unit = "mm",
       .doc =
           "Put the cleaned labels on an isotropic grid by shape-based interpolation and work "
           "there: a spacing no larger than the volume's smallest, or \"auto\" for that one. null "
           "stays on the volume's grid. For thick slices; costs voxels.",
       .field = CVMESH_FIELD(grid_spacing_mm),
       .min = 0,
       .max = kMostMm,
       .min_is_exclusive = true,
       .is_optional = true},
      {.key = "min_edge_mm",
       .unit = "mm",
       .doc = "Lower bound of the surface edge length; null for none.",
       .field = CVMESH_FIELD(sizing.min_edge_mm),
       .min = 0,
       .max = kMostMm,
       .min_is_exclusive = true,
       .is_optional = true},
      {.key = "max_edge_mm",
       .unit = "mm",
       .doc = "Upper bound of the surface edge length; null for none.",
       .field = CVMESH_FIELD(sizing.max_edge_mm),
       .min = 0,
       .max = kMostMm,
       .min_is_exclusive = true,
       .is_optional = true},
      {.key = "min_feature_vox",
       .unit = "voxels",
       .doc = "Floor of the local feature size: what is smaller counts as noise of the image.",
       .field = CVMESH_FIELD(sizing.min_feature_vox),
       .min = 0.05,
       .max = kMostVoxels},
      {.key = "smoothing_sweeps",
       .doc = "Sweeps of the smoothing over the level sets; time is linear in it.",
       .field = CVMESH_FIELD(tighten.smoothing_sweeps),
       .min = 1,
       .max = 10000},
      {.key = "smoothing_margin",
       .unit = "voxels",
       .doc = "Least magnitude of a level set at a voxel centre: keeps every voxel on its side.",
       .field = CVMESH_FIELD(tighten.margin),
       .min = 0.001,
       .max = 0.5},
      {.key = "tighten_iterations",
       .doc = "Upper bound of the curvature flow's iterations, for r of one voxel and more.",
       .field = CVMESH_FIELD(tighten.max_iterations),
       .min = 0,
       .max = 100000},
      {.key = "min_chord_vox",
       .unit = "voxels",
       .doc = "Medial axis: pairs of boundary sites closer than this are noise.",
       .field = CVMESH_FIELD(medial_axis.min_chord_vox),
       .min = 0,
       .max = kMostVoxels},
      {.key = "min_chord_ratio",
       .doc = "Medial axis: linear pruning, chord over the sum of the two site distances.",
       .field = CVMESH_FIELD(medial_axis.min_chord_ratio),
       .min = 0,
       .max = 2},
      {.key = "min_opposed_chord_vox",
       .unit = "voxels",
       .doc = "Medial axis: the shortest chord between opposed walls that counts as a thin part.",
       .field = CVMESH_FIELD(medial_axis.min_opposed_chord_vox),
       .min = 0,
       .max = kMostVoxels},
      {.key = "seeding",
       .doc = "How the particles start: \"front\" spreads them at the distances of the sizing "
              "field by "
              "an advancing front, \"dense\" uniformly and densely, as in the paper (much slower).",
       .field = CVMESH_FIELD(seed_particles.seeding),
       .choices = kSeedings},
      {.key = "min_component_particles",
       .unit = "vertices",
       .doc = "Fewest surface vertices on each closed component of an interface.",
       .field = CVMESH_FIELD(seed_particles.min_component_particles),
       .min = 4,
       .max = 10000},
      {.key = "particle_sweeps",
       .doc = "Upper bound of the particle optimisation's sweeps; time is linear in it.",
       .field = CVMESH_FIELD(distribute_particles.max_sweeps),
       .min = 0,
       .max = 10000},
      {.key = "surface",
       .doc = "\"decimation\" thins the dense surfaces out to the particles and keeps their "
              "topology; \"delaunay\" takes the faces between labels of the particles' Delaunay "
              "tets, labelled at their circumcentres: a baseline whose topology may fail, which is "
              "reported and ends no run.",
       .field = CVMESH_FIELD(surface),
       .choices = kSurfaceMethods},
      {.key = "schedule",
       .doc = "\"lock-step\" thins all material surfaces out together; \"sequential\" each on its "
              "own and flips edges until they are conformal, as the paper does: a baseline that "
              "fails where they do not become so. It takes two to six times the decimation.",
       .field = CVMESH_FIELD(schedule),
       .choices = kSchedules},
      {.key = "deviation_vox",
       .unit = "voxels",
       .doc =
           "Distance between the sparse and the dense surface below which decimation and flips "
           "look at the shape of the triangles only. Vertices of the surface may move as far, at "
           "most 0.5, where it presses tets flat. null: 0.5, or a twelfth of the median edge where "
           "that is more.",
       .field = CVMESH_FIELD(deviation_vox),
       .min = 0,
       .max = kMostVoxels,
       .min_is_exclusive = true,
       .is_optional = true},
      {.key = "fit_vox",
       .unit = "voxels",
       .doc =
           "Farthest that a vertex of the surface leaves its particle to bring the facets around "
           "it nearer to the dense surface: facets with their corners on a curved surface lie "
           "on one side of it. 0 leaves all vertices on the particles.",
       .field = CVMESH_FIELD(fit_vertices.max_shift_vox),
       .min = 0,
       .max = kMostVoxels},
      {.key = "on_degenerate",
       .doc = "A vertex that cannot be removed stays and is reported (\"keep\"), or stops the run "
              "(\"fail\").",
       .field = CVMESH_FIELD(decimate.on_degenerate),
       .choices = kOnDegenerate},
      {.key = "flip_passes",
       .doc = "Upper bound of the passes of edge flips; 0 turns them off.",
       .field = CVMESH_FIELD(flip_edges.max_passes),
       .min = 0,
       .max = 10000},
      {.key = "tet_radius_edge_ratio",
       .doc =
           "TetGen's bound on circumradius over shortest edge of a tet; smaller is better shaped, "
           "with more tets.",
       .field = CVMESH_FIELD(tetrahedralize.radius_edge_ratio),
       .min = 1,
       .max = 100},
      {.key = "tet_min_dihedral_deg",
       .unit = "degrees",
       .doc = "TetGen's bound on the dihedral angles; 0 turns it off.",
       .field = CVMESH_FIELD(tetrahedralize.min_dihedral_deg),
       .min = 0,
       .max = 30},
      {.key = "interior_growth",
       .unit = "edge length / sizing field",
       .doc = "Interior edges over the sizing field; 0 leaves the interior size to TetGen.",
       .field = CVMESH_FIELD(tetrahedralize.interior_growth),
       .min = 0,
       .max = 1000},
      {.key = "tet_improvement_passes",
       .doc = "Upper bound of the passes that improve the interior tets; 0 turns them off.",
       .field = CVMESH_FIELD(tetrahedralize.improvement_passes),
       .min = 0,
       .max = 1000},
      {.key = "element_order",
       .doc = "2 for tets with a node on each edge as well.",
       .field = CVMESH_FIELD(element_order),
       .min = 1,
       .max = 2},
      {.key = "curved_elements",
       .doc = "With element_order 2: nodes on edges of the surface move onto the dense surface, "
              "as far as all Jacobians stay positive.",
       .field = CVMESH_FIELD(curved_elements)},
      {.key = "contact",
       .doc = "Interfaces that are cut open for contact, as pairs of labels by name or value, like "
              "[[\"stem\", \"cement\"], [3, 4]]: each side has nodes of its own.",
       .field = CVMESH_FIELD(contact)},
      {.key = "sample",
       .doc = "With --sample: density and elastic modulus from the image.",
       .field = CVMESH_FIELD(sample)},
      {.key = "gates",
       .doc = "Bounds that the finished mesh is to keep: {\"min_dihedral_deg\": 10}. A mesh that "
              "misses one is written all the same; the report tells, and the exit code is 5.",
       .field = CVMESH_FIELD(gates)},
      {.key = "tetgen_time_limit_s",
       .unit = "s",
       .doc = "Time limit of one TetGen run.",
       .field = CVMESH_FIELD(tetrahedralize.time_limit_s),
       .min = 0,
       .max = 1e7,
       .min_is_exclusive = true},
      {.key = "tetgen_memory_limit_mb",
       .unit = "MiB",
       .doc = "Memory limit of the TetGen process; 0 for none.",
       .field = CVMESH_FIELD(tetrahedralize.memory_limit_mb),
       .min = 0,
       .max = 1e9},
  };
  return table;
}

const std::vector<ParameterInfo<LabelParameters>>& label_parameter_table() {
  static const std::vector<ParameterInfo<LabelParameters>> table = [] {
    std::vector<ParameterInfo<LabelParameters>> rows = {
        {.key = "name",
         .doc = "Name of the label in files and reports.",
         .field = CVMESH_FIELD(name),
         .is_optional = true},
        {.key = "r",
         .unit = "voxels",
         .doc = "As the global key, on the boundary of this label; where labels meet the smaller "
                "radius rules.",
         .field = CVMESH_FIELD(r),
         .min = 0,
         .max = 20,
         .is_optional = true}};
    add_size_rows(
        "As the global key, on the boundary of this label; where labels meet the smaller "
        "size rules.",
        "As the global key, on the boundary of this label.",
        "As the global key, on the boundary of this label.", rows);
    return rows;
  }();
  return table;
}

const std::vector<ParameterInfo<InterfaceParameters>>& interface_parameter_table() {
  static const std::vector<ParameterInfo<InterfaceParameters>> table = [] {
    std::vector<ParameterInfo<InterfaceParameters>> rows = {
        {.key = "labels",
         .doc = "The two labels that meet there, in any order; 0 is the exterior.",
         .field = CVMESH_FIELD(labels),
         .is_required = true}};
    add_size_rows("As the global key, on this interface; at its ends the smaller size rules.",
                  "As the global key, on this interface.", "As the global key, on this interface.",
                  rows);
    return rows;
  }();
  return table;
}

const std::vector<ParameterInfo<BoxParameters>>& box_parameter_table() {
  static const std::vector<ParameterInfo<BoxParameters>> table = [] {
    std::vector<ParameterInfo<BoxParameters>> rows = {
        {.key = "box",
         .unit = "voxels",
         .doc = "First and last voxel of the box, [i0, j0, k0, i1, j1, k1], both included.",
         .field = CVMESH_FIELD(box),
         .is_required = true}};
    add_size_rows("As the global key, on the surfaces in this box.",
                  "As the global key, on the surfaces in this box.",
                  "As the global key, on the surfaces in this box; bounds the tets in it, too.",
                  rows);
    return rows;
  }();
  return table;
}

const std::vector<ParameterInfo<SampleParameters>>& sample_parameter_table() {
  static const std::vector<ParameterInfo<SampleParameters>> table = {
      {.key = "labels",
       .doc = "Labels that get density and modulus; none stands for all.",
       .field = CVMESH_FIELD(labels)},
      {.key = "density_slope",
       .unit = "g/cm3 per unit of the image",
       .doc = "density = density_slope * mean + density_intercept.",
       .field = CVMESH_FIELD(density_slope),
       .is_optional = true},
      {.key = "density_intercept",
       .unit = "g/cm3",
       .doc = "Density where the image is 0.",
       .field = CVMESH_FIELD(density_intercept)},
      {.key = "modulus_factor",
       .unit = "MPa",
       .doc = "modulus = modulus_factor * density ^ modulus_exponent; needs density_slope.",
       .field = CVMESH_FIELD(modulus_factor),
       .min = 0,
       .min_is_exclusive = true,
       .is_optional = true},
      {.key = "modulus_exponent",
       .doc = "Exponent of that law.",
       .field = CVMESH_FIELD(modulus_exponent),
       .min = 0,
       .max = 10},
      {.key = "min_modulus_mpa",
       .unit = "MPa",
       .doc = "Modulus of tets for which the law gives less.",
       .field = CVMESH_FIELD(min_modulus_mpa),
       .min = 0,
       .min_is_exclusive = true},
      {.key = "poisson_ratio",
       .doc = "Of all elastic materials made from the modulus.",
       .field = CVMESH_FIELD(poisson_ratio),
       .min = 0,
       .max = 0.499},
      {.key = "bins",
       .doc = "Elastic materials in the .inp file, equally wide in modulus; 0 for none. Needs "
              "modulus_factor.",
       .field = CVMESH_FIELD(bins),
       .min = 0,
       .max = 9999},
  };
  return table;
}

const std::vector<ParameterInfo<QualityGates>>& gate_table() {
  static const std::vector<ParameterInfo<QualityGates>> table = [] {
    using Row = ParameterInfo<QualityGates>;
    const auto angle = [](std::string_view key, std::string_view doc, auto field) {
      return Row{.key = key,
                 .unit = "degrees",
                 .doc = doc,
                 .field = field,
                 .min = 0,
                 .max = 180,
                 .is_optional = true};
    };
    const auto shape = [](std::string_view key, std::string_view doc, auto field) {
      return Row{.key = key, .doc = doc, .field = field, .min = 0, .max = 1, .is_optional = true};
    };
    const auto distance = [](std::string_view key, std::string_view unit, std::string_view doc,
                             double most, auto field) {
      return Row{.key = key,
                 .unit = unit,
                 .doc = doc,
                 .field = field,
                 .min = 0,
                 .max = most,
                 .min_is_exclusive = true,
                 .is_optional = true};
    };
    static constexpr char kLargest[] =
        "Largest distance between the mesh and the dense surface, in both directions.";
    static constexpr char kMean[] =
        "Mean distance between the mesh and the dense surface, of both directions.";
    return std::vector<Row>{
        angle("min_dihedral_deg", "Smallest dihedral angle of all tets.",
              CVMESH_FIELD(min_dihedral_deg)),
        angle("max_dihedral_deg", "Largest dihedral angle of all tets.",
              CVMESH_FIELD(max_dihedral_deg)),
        shape("min_tet_quality", "Smallest 3r/R of all tets; 1 is regular, 0 flat.",
              CVMESH_FIELD(min_tet_quality)),
        shape("min_scaled_jacobian", "Smallest scaled Jacobian of all tets.",
              CVMESH_FIELD(min_scaled_jacobian)),
        Row{.key = "max_volume_error_percent",
            .unit = "%",
            .doc = "Largest difference between a label's volume in the mesh and in the voxels.",
            .field = CVMESH_FIELD(max_volume_error_percent),
            .min = 0,
            .max = 1e6,
            .is_optional = true},
        distance("max_distance_mm", "mm", kLargest, kMostMm, CVMESH_FIELD(max_distance_mm)),
        distance("max_distance_vox", "voxels", kLargest, kMostVoxels,
                 CVMESH_FIELD(max_distance_vox)),
        distance("max_mean_distance_mm", "mm", kMean, kMostMm, CVMESH_FIELD(max_mean_distance_mm)),
        distance("max_mean_distance_vox", "voxels", kMean, kMostVoxels,
                 CVMESH_FIELD(max_mean_distance_vox)),
        Row{.key = "max_kept_vertices",
            .unit = "vertices",
            .doc = "Vertices of the dense surface that had to stay although they are no particles.",
            .field = CVMESH_FIELD(max_kept_vertices),
            .min = 0,
            .max = kLargestInteger,
            .is_optional = true}};
  }();
  return table;
}

}  // namespace cvmesh
