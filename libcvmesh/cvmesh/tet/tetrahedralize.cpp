// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/tet/tetrahedralize.h"

#include "cvmesh/core/box3.h"
#include "cvmesh/core/error.h"
#include "cvmesh/core/parallel.h"
#include "cvmesh/mesh/validate.h"
#include "cvmesh/tet/build_tet_mesh.h"
#include "cvmesh/tet/tetgen_backend.h"

#include <spdlog/spdlog.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <utility>

namespace cvmesh {
namespace {

constexpr const char* kStage = "tetrahedra";
constexpr int kMaxSizeNodesPerAxis = 96;  // 96^3 floats: 3.5 MB
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
              ") is negative; use 0.75, or 0 for no bound");
  require(options.improvement_passes >= 0, ErrorCode::BadParameter, kStage,
          "tet_improvement_passes (" + std::to_string(options.improvement_passes) +
              ") is negative; use 0 to turn the improvement off");
}

/// Refuses every surface that TetGen would crash on, hang on or silently drop.
void certify(const InterfaceMesh& surface, std::size_t material_count, const MeshNames& names) {
  require(!surface.facets.empty(), ErrorCode::StageFailed, kStage, "the surface has no facets");
  std::vector<bool> is_present(material_count, false);
  for (const PatchKey& patch : surface.patch_of)
    for (const MaterialId m : {patch.sides.inside, patch.sides.outside})
      if (m < material_count) is_present[m] = true;
  for (std::size_t m = 1; m < material_count; ++m)
    require(is_present[m], ErrorCode::StageFailed, kStage,
            names.material(static_cast<MaterialId>(m)) +
                " has no facet on the surface, so it would be lost; make it finer (smaller "
                "epsilon)");
  const Validation validation = validate(surface, material_count, names);
  require(validation.is_valid(), ErrorCode::StageFailed, kStage,
          "the surface is not valid, so it cannot be filled; make it finer (smaller epsilon):\n" +
              validation.summary());
  const auto pairs = find_intersections(surface, 3);
  std::string named;
  for (const auto& [f, g] : pairs)
    named += "\n" + names.facet(surface, f) + " meets " + names.facet(surface, g);
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

/// How TetGen places a point where an edge of the surface is no edge of its Delaunay tets, to be
/// moved off the surface afterwards: what follows -Y (not in TetGen's manual; `addsteiner_algo` in
/// its header). Which way fails is chance.
constexpr std::array<const char*, 3> kRecoveries{"", "/2", "/0"};

/// What is asked of the tets, from all that the options name to the bare filling of the surface.
struct Rung {
  std::string quality;  ///< switches
  bool follows_size = false;
  std::string tolerance{};  ///< a switch
};

std::vector<Rung> ladder(const TetrahedralizeOptions& options, bool has_size) {
  const double q = options.radius_edge_ratio, angle = options.min_dihedral_deg;
  const auto quality = [&](double ratio, double degrees) {
    return "q" + format_number(ratio) + "/" + format_number(degrees);
  };
  std::vector<Rung> rungs{{quality(q, angle), has_size},
                          {quality(std::max(q, 1.8), std::min(angle, 5.0)), has_size}};
  if (has_size) rungs.push_back({quality(std::max(q, 2.0), 0), true});
  rungs.push_back({quality(std::max(q, 2.0), 0)});
  rungs.push_back({});
  rungs.push_back({{}, false, "T1e-13"});
  return rungs;
}

/// p piecewise linear complex, Y no points on it, A numbers the connected parts, J keeps indices, Q
/// quiet, S cap on points, T tolerance (the default 1e-8 of the box merges points that are distinct
/// doubles).
std::string switches_of(const Rung& rung, const std::string& recovery, long cap) {
  const std::string most = rung.quality.empty() ? "" : "S" + std::to_string(cap);
  return "pY" + recovery + "A" + rung.quality + "JQ" + most + rung.tolerance;
}

/// Fills one surface: climbs down the ladder to the first result that passes every check.
class Filler {
 public:
  Filler(const InterfaceMesh& surface,
         std::size_t material_count,
         const SizingField& sizing_field,
         const TetrahedralizeOptions& options,
         TetrahedralizeStats& stats,
         const StageContext& context)
      : surface_(surface),
        material_count_(material_count),
        options_(options),
        size_(sample_sizes(surface, sizing_field, options.interior_growth)),
        cap_(steiner_cap(surface, size_)),
        stats_(stats),
        context_(context) {
    request_.points = surface.points;
    request_.facets = surface.facets;
  }

  TetMesh fill() {
    std::array<bool, kRecoveries.size()> leaves_out{};
    for (const Rung& rung : ladder(options_, !size_.values.empty()))
      for (std::size_t r = 0; r < kRecoveries.size(); ++r) {
        // Edges are recovered before anything is asked of the tets, with the same result.
        if (leaves_out[r] && rung.tolerance.empty()) continue;
        BuildTetMeshResult built = attempt(rung, switches_of(rung, kRecoveries[r], cap_));
        if (built.fault.empty()) return std::move(built.mesh);
        leaves_out[r] = built.leaves_facet_out;
        if (code_ == ErrorCode::Limit) break;  // what is asked for takes too much
      }
    std::string all;
    for (const std::string& failed : stats_.failed_attempts)
      all += "\n" + failed;
    throw Error(code_, kStage,
                "none of " + std::to_string(stats_.attempts) +
                    " sets of TetGen switches filled the surface:" + all);
  }

 private:
  BuildTetMeshResult attempt(const Rung& rung, const std::string& switches) {
    request_.switches = switches;
    request_.size = rung.follows_size ? size_ : tetgen_protocol::SizeGrid{};
    const std::string name =
        switches + (rung.follows_size || size_.values.empty() ? "" : " without sizes");
    ++stats_.attempts;
    TetgenRun run =
        run_tetgen(request_, {options_.time_limit_s, options_.memory_limit_mb}, context_);
    context_.log->debug("{}: {} took {:.2f} s and {:.0f} MB", kStage, name, run.seconds,
                        run.peak_mb);
    code_ = run.outcome == TetgenOutcome::TimedOut || run.outcome == TetgenOutcome::OutOfMemory
                ? ErrorCode::Limit
                : ErrorCode::StageFailed;
    BuildTetMeshResult built;
    if (run.outcome == TetgenOutcome::Meshed)
      built =
          build_tet_mesh(std::move(run.reply), surface_, material_count_, options_.names, context_);
    else
      built.fault = std::move(run.description);
    if (!built.fault.empty()) {
      stats_.failed_attempts.push_back(name + ": " + built.fault);
      context_.log->warn("{}: TetGen with {} failed: {}", kStage, name, built.fault);
      return built;
    }
    stats_.switches = name;
    stats_.steiner_points = built.mesh.points.size() - surface_.points.size();
    stats_.volume_error = built.volume_error;
    if (stats_.steiner_points >= static_cast<std::size_t>(cap_))
      context_.log->warn(
          "{}: TetGen reached its bound of {} added points, so part of the interior is coarser "
          "than asked for; raise interior_growth or tet_radius_edge_ratio",
          kStage, cap_);
    return built;
  }

  const InterfaceMesh& surface_;
  std::size_t material_count_;
  const TetrahedralizeOptions& options_;
  tetgen_protocol::SizeGrid size_;
  long cap_;
  TetrahedralizeStats& stats_;
  const StageContext& context_;
  tetgen_protocol::Request request_;
  ErrorCode code_ = ErrorCode::StageFailed;  // of the last attempt
};

}  // namespace

TetrahedralizeResult tetrahedralize(const InterfaceMesh& surface,
                                    std::size_t material_count,
                                    const SizingField& sizing_field,
                                    const TetrahedralizeOptions& options,
                                    const StageContext& context) {
  check_options(options);
  report_progress(context, kStage, 0);
  certify(surface, material_count, options.names);
  report_progress(context, kStage, 0.1);
  TetrahedralizeResult result;
  result.tets =
      Filler(surface, material_count, sizing_field, options, result.stats, context).fill();
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
