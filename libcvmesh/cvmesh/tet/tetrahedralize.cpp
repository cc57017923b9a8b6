// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/tet/tetrahedralize.h"

#include "cvmesh/core/box3.h"
#include "cvmesh/core/error.h"
#include "cvmesh/core/parallel.h"
#include "cvmesh/mesh/sort_along_curve.h"
#include "cvmesh/mesh/validate.h"
#include "cvmesh/tet/tetgen_backend.h"

#include <spdlog/spdlog.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <numeric>
#include <utility>

namespace cvmesh {
namespace {

constexpr const char* kStage = "tetrahedra";
constexpr double kVolumeTolerance = 1e-9;  // relative; sums of doubles are within 1e-12
constexpr int kMaxSizeNodesPerAxis = 96;   // 96^3 floats: 3.5 MB
constexpr double kMinSteinerCap = 10000;
constexpr double kSteinerPerSurfaceVertex = 20;
// TetGen splits every tet above the volume bound, which leaves a mean volume of about half of it:
// a bound of twice the regular tet's volume makes edges of the target length the rule.
constexpr double kVolumeBoundFactor = 2.0;

std::string format_number(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%.4g", value);
  return text;
}

void check_options(const TetrahedralizeOptions& options) {
  require(options.radius_edge_ratio >= 1.0, ErrorCode::BadParameter, kStage,
          "tet_radius_edge_ratio (" + format_number(options.radius_edge_ratio) +
              ") is below 1; TetGen does not end there, use 1.2 or more");
  require(options.min_dihedral_deg >= 0 && options.min_dihedral_deg <= 30, ErrorCode::BadParameter,
          kStage,
          "tet_min_dihedral_deg (" + format_number(options.min_dihedral_deg) +
              ") is not within 0 to 30; use 10");
  require(options.interior_growth >= 0, ErrorCode::BadParameter, kStage,
          "interior_growth (" + format_number(options.interior_growth) +
              ") is negative; use 0.8, or 0 for no bound");
  require(options.improvement_passes >= 0, ErrorCode::BadParameter, kStage,
          "tet_improvement_passes (" + std::to_string(options.improvement_passes) +
              ") is negative; use 0 to turn the improvement off");
}

/// Names a facet so that the user can find the place: its number, the two materials and a point.
std::string name_facet(const InterfaceMesh& surface, std::int32_t facet) {
  const std::size_t f = static_cast<std::size_t>(facet);
  Vec3 centroid;
  for (const std::int32_t v : surface.facets[f])
    centroid += surface.points[static_cast<std::size_t>(v)] / 3;
  const Sides sides = surface.patch_of[f].sides;
  return "facet " + std::to_string(facet) + " (materials " + std::to_string(sides.inside) +
         " and " + std::to_string(sides.outside) + ", near " + format_number(centroid.x) + ", " +
         format_number(centroid.y) + ", " + format_number(centroid.z) + " mm)";
}

/// Refuses every surface that TetGen would crash on, hang on or silently drop.
void certify(const InterfaceMesh& surface, std::size_t material_count) {
  require(!surface.facets.empty(), ErrorCode::StageFailed, kStage, "the surface has no facets");
  std::vector<bool> is_present(material_count, false);
  for (const PatchKey& patch : surface.patch_of)
    for (const MaterialId m : {patch.sides.inside, patch.sides.outside})
      if (m < material_count) is_present[m] = true;
  for (std::size_t m = 1; m < material_count; ++m)
    require(is_present[m], ErrorCode::StageFailed, kStage,
            "material " + std::to_string(m) +
                " has no facet on the surface, so it would be lost; make it finer (smaller "
                "epsilon)");
  const Validation validation = validate(surface, material_count);
  require(validation.is_valid(), ErrorCode::StageFailed, kStage,
          "the surface is not valid, so it cannot be filled; make it finer (smaller epsilon):\n" +
              validation.summary());
  const auto pairs = find_intersections(surface, 3);
  std::string named;
  for (const auto& [f, g] : pairs)
    named += "\n" + name_facet(surface, f) + " meets " + name_facet(surface, g);
  require(pairs.empty(), ErrorCode::StageFailed, kStage,
          "facets of the surface intersect, so it cannot be filled; make it finer there (smaller "
          "epsilon) or change the seed:" +
              named);
}

/// The sizing field times `growth` on a grid over the surface's box, for the helper program.
tetgen_protocol::SizeGrid sample_sizes(const InterfaceMesh& surface,
                                       const SizingField& sizing_field,
                                       double growth) {
  tetgen_protocol::SizeGrid grid;
  const Grid<float>& source = sizing_field.volume_h_mm;
  if (growth == 0 || source.values.empty()) return grid;
  Box3 box;
  for (const Vec3& p : surface.points)
    box.add(p);
  const Vec3 extent = box.extent();
  const double longest = std::max({extent.x, extent.y, extent.z});
  const Vec3 spacing = source.frame.spacing_mm;
  const double finest = std::min({spacing.x, spacing.y, spacing.z});
  const double cell = std::max(longest / (kMaxSizeNodesPerAxis - 1), finest);
  grid.origin = box.lo;
  for (int k = 0; k < 3; ++k) {
    grid.dims[static_cast<std::size_t>(k)] =
        std::max(2, static_cast<int>(std::ceil(extent[k] / cell)) + 1);
    grid.cell[k] = cell;
  }
  const std::size_t nx = static_cast<std::size_t>(grid.dims[0]);
  const std::size_t ny = static_cast<std::size_t>(grid.dims[1]);
  grid.values.resize(nx * ny * static_cast<std::size_t>(grid.dims[2]));
  const double factor = growth * std::cbrt(kVolumeBoundFactor);
  parallel_for_each_index(0, grid.values.size(), [&](std::size_t n) {
    const Vec3 index{static_cast<double>(n % nx), static_cast<double>(n / nx % ny),
                     static_cast<double>(n / (nx * ny))};
    grid.values[n] = static_cast<float>(factor * sizing_field.at(box.lo + cell * index));
  });
  return grid;
}

/// Bound on added points: far more than a good mesh needs, so that refinement always ends. A cubic
/// millimetre of tets with edge L holds sqrt 2 / L^3 vertices.
long steiner_cap(const InterfaceMesh& surface, const tetgen_protocol::SizeGrid& size) {
  double expected = 0;
  for (const float h : size.values)
    expected += std::sqrt(2.0) * std::pow(size.cell.x / static_cast<double>(h), 3);
  const double cap = std::max(
      kMinSteinerCap,
      kSteinerPerSurfaceVertex * static_cast<double>(surface.points.size()) + 4 * expected);
  return static_cast<long>(std::min(cap, 1e9));
}

struct Rung {
  std::string switches;
  bool follows_size = false;
};

/// From what the options ask for to the bare filling of the surface: p piecewise linear complex,
/// Y no points on it, A numbers the connected parts, J keeps indices, Q quiet, S cap on points,
/// T tolerance (the default 1e-8 of the box merges points that are distinct doubles).
std::vector<Rung> ladder(const TetrahedralizeOptions& options, long cap, bool has_size) {
  const std::string s = "S" + std::to_string(cap);
  const double q = options.radius_edge_ratio, angle = options.min_dihedral_deg;
  const auto quality = [&](double ratio, double degrees) {
    return "pYAq" + format_number(ratio) + "/" + format_number(degrees) + "JQ" + s;
  };
  std::vector<Rung> rungs{{quality(q, angle), has_size},
                          {quality(std::max(q, 1.8), std::min(angle, 5.0)), has_size}};
  if (has_size) rungs.push_back({quality(std::max(q, 2.0), 0), true});
  rungs.push_back({quality(std::max(q, 2.0), 0), false});
  rungs.push_back({"pYAJQ", false});
  rungs.push_back({"pYAJQT1e-13", false});
  return rungs;
}

std::array<std::int32_t, 3> sorted(std::array<std::int32_t, 3> face) {
  std::sort(face.begin(), face.end());
  return face;
}

/// The corners of face k of a positive tet, counter-clockwise seen from outside the tet.
std::array<std::int32_t, 3> face_of(const std::array<std::int32_t, 4>& tet, std::size_t k) {
  static constexpr std::size_t kFaces[4][3] = {{1, 2, 3}, {0, 3, 2}, {0, 1, 3}, {0, 2, 1}};
  return {tet[kFaces[k][0]], tet[kFaces[k][1]], tet[kFaces[k][2]]};
}

bool is_even(const std::array<std::int32_t, 3>& a, const std::array<std::int32_t, 3>& b) {
  return (a[0] == b[0] && a[1] == b[1]) || (a[0] == b[1] && a[1] == b[2]) ||
         (a[0] == b[2] && a[1] == b[0]);
}

/// One side of a triangle: a tet's face or a facet, to be matched by its sorted corners.
struct FaceRecord {
  std::array<std::int32_t, 3> key;
  std::int32_t owner = -1;  ///< 4 tet + face; facets: -1 - facet, so that they come first

  friend bool operator<(const FaceRecord& a, const FaceRecord& b) {
    return a.key != b.key ? a.key < b.key : a.owner < b.owner;
  }
};

class Parts {
 public:
  explicit Parts(std::size_t count) : parent_(count) {
    std::iota(parent_.begin(), parent_.end(), 0);
  }

  std::int32_t find(std::int32_t t) {
    while (parent_[static_cast<std::size_t>(t)] != t) {
      std::int32_t& p = parent_[static_cast<std::size_t>(t)];
      p = parent_[static_cast<std::size_t>(p)];
      t = p;
    }
    return t;
  }

  void join(std::int32_t a, std::int32_t b) {
    a = find(a);
    b = find(b);
    parent_[static_cast<std::size_t>(std::max(a, b))] = std::min(a, b);
  }

 private:
  std::vector<std::int32_t> parent_;
};

double volume6_of(const TetMesh& mesh, const std::array<std::int32_t, 4>& tet) {
  const auto corner = [&](std::size_t k) { return mesh.points[static_cast<std::size_t>(tet[k])]; };
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
    const double part = volume6(centre, surface.points[static_cast<std::size_t>(v[0])],
                                surface.points[static_cast<std::size_t>(v[1])],
                                surface.points[static_cast<std::size_t>(v[2])]) /
                        6;
    volumes[surface.patch_of[f].sides.inside] += part;
    volumes[surface.patch_of[f].sides.outside] -= part;
  }
  return volumes;
}

/// Turns what TetGen returned into a checked `TetMesh`.
class Result {
 public:
  Result(const InterfaceMesh& surface, std::size_t material_count)
      : surface_(surface), volumes_(enclosed_volumes(surface, material_count)) {}

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

 private:
  std::string check_points(const TetMesh& mesh) const {
    for (std::size_t v = 0; v < surface_.points.size(); ++v) {
      const Vec3& p = surface_.points[v];
      if (v < mesh.points.size() && std::memcmp(&mesh.points[v], &p, sizeof p) == 0) continue;
      return "TetGen changed or merged points of the surface, from point " + std::to_string(v) +
             " at " + format_number(p.x) + ", " + format_number(p.y) + ", " + format_number(p.z) +
             " mm on";
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
  static std::string repair_flat_tets(TetMesh& mesh, const StageContext& context) {
    const auto is_flat = [&](const auto& tet) { return !(volume6_of(mesh, tet) > 0); };
    if (std::none_of(mesh.tets.begin(), mesh.tets.end(), is_flat)) return {};
    ImproveTetsOptions repair;
    repair.passes = 3;
    repair.comfort_deg = 1;
    repair.insert_below_deg = 1;
    improve_tets(mesh, repair, context);
    const auto flat = std::find_if(mesh.tets.begin(), mesh.tets.end(), is_flat);
    if (flat == mesh.tets.end()) return {};
    const Vec3 p = mesh.points[static_cast<std::size_t>((*flat)[0])];
    return "TetGen made a flat tet near " + format_number(p.x) + ", " + format_number(p.y) + ", " +
           format_number(p.z) + " mm";
  }

  /// Floods the parts between facets, and reads their material from the sides of those facets.
  std::string assign_materials(TetMesh& mesh) const {
    const std::vector<FaceRecord> faces = match_faces(mesh);
    Parts parts(mesh.tets.size());
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
        if (tets == 0) return name_facet(surface_, facet) + " is not a face of the tets";
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
      std::int32_t& known = material[static_cast<std::size_t>(parts.find(side.tet))];
      if (known != kUnknown && known != side.material)
        return "a connected part of the tets touches sides of material " + std::to_string(known) +
               " and " + std::to_string(side.material) + " at " + name_facet(surface_, side.facet);
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
        faces[facets + 4 * t + k] = {sorted(face_of(mesh.tets[t], k)),
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
    const auto face = face_of(mesh.tets[static_cast<std::size_t>(owner / 4)],
                              static_cast<std::size_t>(owner % 4));
    const Sides sides = surface_.patch_of[static_cast<std::size_t>(facet)].sides;
    return is_even(face, surface_.facets[static_cast<std::size_t>(facet)]) ? sides.inside
                                                                           : sides.outside;
  }

  static double mean_edge(const TetMesh& mesh) {
    double sum = 0;
    for (const auto& tet : mesh.tets)
      sum += distance(mesh.points[static_cast<std::size_t>(tet[0])],
                      mesh.points[static_cast<std::size_t>(tet[1])]);
    return sum / static_cast<double>(mesh.tets.size());
  }

  static std::string keep_meshed(TetMesh& mesh,
                                 Parts& parts,
                                 const std::vector<std::int32_t>& material) {
    std::size_t kept = 0;
    for (std::size_t t = 0; t < mesh.tets.size(); ++t) {
      const std::int32_t m =
          material[static_cast<std::size_t>(parts.find(static_cast<std::int32_t>(t)))];
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
        new_index[static_cast<std::size_t>(v)] = 0;
    std::size_t kept = 0;
    for (std::size_t v = 0; v < mesh.points.size(); ++v) {
      if (v >= surface_.points.size() && new_index[v] < 0) continue;
      new_index[v] = static_cast<std::int32_t>(kept);
      mesh.points[kept++] = mesh.points[v];
    }
    mesh.points.resize(kept);
    for (auto& tet : mesh.tets)
      for (std::int32_t& v : tet)
        v = new_index[static_cast<std::size_t>(v)];
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
        return "material " + std::to_string(m) + " encloses " + format_number(volumes_[m]) +
               " mm^3, but its tets fill " + format_number(filled[m]) + " mm^3";
      volume_error_ = std::max(volume_error_, error);
    }
    return {};
  }

  const InterfaceMesh& surface_;
  std::vector<double> volumes_;
  double volume_error_ = 0;
};

/// Climbs down the ladder to the first result that passes every check.
TetMesh fill(const InterfaceMesh& surface,
             std::size_t material_count,
             const SizingField& sizing_field,
             const TetrahedralizeOptions& options,
             TetrahedralizeStats& stats,
             const StageContext& context) {
  tetgen_protocol::Request request;
  request.points = surface.points;
  request.facets = surface.facets;
  const tetgen_protocol::SizeGrid size =
      sample_sizes(surface, sizing_field, options.interior_growth);
  const long cap = steiner_cap(surface, size);
  const TetgenLimits limits{options.time_limit_s, options.memory_limit_mb};
  Result result(surface, material_count);
  ErrorCode code = ErrorCode::StageFailed;
  for (const Rung& rung : ladder(options, cap, !size.values.empty())) {
    request.switches = rung.switches;
    request.size = rung.follows_size ? size : tetgen_protocol::SizeGrid{};
    const std::string name =
        rung.switches + (rung.follows_size || size.values.empty() ? "" : " without sizes");
    ++stats.attempts;
    TetgenRun run = run_tetgen(request, limits, context);
    context.log->debug("{}: {} took {:.2f} s and {:.0f} MB", kStage, name, run.seconds,
                       run.peak_mb);
    std::string fault = std::move(run.description);
    code = run.outcome == TetgenOutcome::TimedOut || run.outcome == TetgenOutcome::OutOfMemory
               ? ErrorCode::Limit
               : ErrorCode::StageFailed;
    TetMesh mesh;
    if (run.outcome == TetgenOutcome::Meshed)
      fault = result.build(std::move(run.reply), mesh, context);
    if (fault.empty()) {
      stats.switches = name;
      stats.steiner_points = mesh.points.size() - surface.points.size();
      stats.volume_error = result.volume_error();
      if (stats.steiner_points >= static_cast<std::size_t>(cap))
        context.log->warn(
            "{}: TetGen reached its bound of {} added points, so part of the interior is coarser "
            "than asked for; raise interior_growth or tet_radius_edge_ratio",
            kStage, cap);
      return mesh;
    }
    stats.failed_attempts.push_back(name + ": " + fault);
    context.log->warn("{}: TetGen with {} failed: {}", kStage, name, fault);
  }
  std::string all;
  for (const std::string& failed : stats.failed_attempts)
    all += "\n" + failed;
  throw Error(code, kStage,
              "none of " + std::to_string(stats.attempts) +
                  " sets of TetGen switches filled the surface:" + all);
}

}  // namespace

TetrahedralizeResult tetrahedralize(const InterfaceMesh& surface,
                                    std::size_t material_count,
                                    const SizingField& sizing_field,
                                    const TetrahedralizeOptions& options,
                                    const StageContext& context) {
  check_options(options);
  report_progress(context, kStage, 0);
  certify(surface, material_count);
  report_progress(context, kStage, 0.1);
  TetrahedralizeResult result;
  result.tets = fill(surface, material_count, sizing_field, options, result.stats, context);
  report_progress(context, kStage, 0.7);
  if (options.improvement_passes > 0) {
    ImproveTetsOptions improvement;
    improvement.passes = options.improvement_passes;
    improvement.max_surface_shift_mm = options.max_surface_shift_mm;
    improvement.max_vertex_shift_mm = options.max_vertex_shift_mm;
    improvement.min_split_edge_mm = options.min_split_edge_mm;
    improvement.max_splits_per_vertex = options.max_splits_per_vertex;
    result.stats.improvement = improve_tets(result.tets, improvement, context);
    result.stats.steiner_points = result.tets.points.size() - result.tets.surface.points.size();
  }
  report_progress(context, kStage, 1);
  return result;
}

}  // namespace cvmesh
