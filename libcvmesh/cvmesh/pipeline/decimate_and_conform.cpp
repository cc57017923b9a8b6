// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/pipeline/decimate_and_conform.h"

#include "cvmesh/core/error.h"
#include "cvmesh/mesh/validate.h"
#include "cvmesh/pipeline/stage_names.h"
#include "cvmesh/surface/conform_edges.h"
#include "cvmesh/surface/decimate_sequential.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <array>
#include <string>
#include <utility>

namespace cvmesh {
namespace {

/// Throws what cannot be made conformal, in the words of the user's labels.
class Refusals {
 public:
  Refusals(const MeshNames& names, std::size_t material_count)
      : names_(names), material_count_(material_count) {}

  void refuse_differences(const ConformEdgesStats& stats) const {
    const EdgeConformity total = stats.total();
    const auto is_bad = [](const ConformPass& pass) { return pass.result.obstacle.has_value(); };
    const auto first = std::find_if(stats.passes.begin(), stats.passes.end(), is_bad);
    if (first == stats.passes.end()) return;
    const auto bad = std::count_if(stats.passes.begin(), stats.passes.end(), is_bad);
    fail(
        fmt::format("{} edges cannot be flipped to those of the master and {} vertices stayed in "
                    "one boundary only, on the interfaces of {} pairs of labels, the first {} at "
                    "{}",
                    total.edges_not_flippable, total.vertices_differing.size(), bad,
                    between(first->sides), names_.place(*first->result.obstacle)));
  }

  /// Every edge has two facets of a material, or none.
  void refuse_shared_edges(const InterfaceMesh& mesh) const {
    struct Side {
      std::int32_t a, b;  // ascending
      MaterialId material;
      std::int32_t facet;
      auto operator<=>(const Side&) const = default;
    };

    std::vector<Side> sides;
    sides.reserve(6 * mesh.facets.size());
    for (std::size_t f = 0; f < mesh.facets.size(); ++f)
      for (int c = 0; c < 3; ++c) {
        const auto [a, b] = std::minmax(mesh.facets[f][c], mesh.facets[f][(c + 1) % 3]);
        for (const MaterialId m : {mesh.patch_of[f].sides.inside, mesh.patch_of[f].sides.outside})
          sides.push_back({a, b, m, static_cast<std::int32_t>(f)});
      }
    std::sort(sides.begin(), sides.end());
    std::size_t bad = 0, first = sides.size();
    for (std::size_t begin = 0, end = 0; begin < sides.size(); begin = end) {
      while (end < sides.size() && sides[end].a == sides[begin].a &&
             sides[end].b == sides[begin].b && sides[end].material == sides[begin].material)
        ++end;
      if (end - begin == 2) continue;
      if (bad++ == 0) first = begin;
    }
    if (bad == 0) return;
    const Side& side = sides[first];
    fail(
        fmt::format("{} edges have other than two facets of a material, because two interfaces "
                    "got the same edge, the first {} at {}",
                    bad, between(mesh.patch_of[side.facet].sides),
                    names_.place(0.5 * (mesh.points[side.a] + mesh.points[side.b]))));
  }

  void refuse_intersections(const InterfaceMesh& mesh) const {
    constexpr std::size_t kMostPairs = 100;
    const auto pairs = find_intersections(mesh, kMostPairs);
    if (pairs.empty()) return;
    const auto [f, g] = pairs.front();
    const auto& t = mesh.facets[f];
    fail(
        fmt::format("{}{} pairs of facets intersect, which come from boundaries that were thinned "
                    "out apart: the first {} and {} at {}",
                    pairs.size() < kMostPairs ? "" : "more than ", pairs.size(),
                    between(mesh.patch_of[f].sides), between(mesh.patch_of[g].sides),
                    names_.place((mesh.points[t[0]] + mesh.points[t[1]] + mesh.points[t[2]]) / 3)));
  }

  void refuse_other_faults(const InterfaceMesh& mesh) const {
    const Validation validation = validate(mesh, material_count_);
    if (!validation.is_valid()) fail("the joined surfaces are not valid: " + validation.summary());
  }

 private:
  [[noreturn]] static void fail(const std::string& what) {
    throw Error(ErrorCode::StageFailed, stage_names::kEdgeConformity,
                what + "; set schedule to \"lock-step\", or lower epsilon");
  }

  [[nodiscard]] std::string between(const Sides& sides) const {
    return fmt::format("between {} and {}", names_.material(sides.outside),
                       names_.material(sides.inside));
  }

  const MeshNames& names_;
  std::size_t material_count_;
};

MaterialSurfaces join(const ConformEdgesResult& conformed, std::size_t material_count) {
  MaterialSurfaces surfaces(conformed.mesh, material_count);
  for (std::size_t f = 0; f < conformed.samples.size(); ++f)
    for (const Vec3& sample : conformed.samples[f])
      surfaces.add_sample(static_cast<std::int32_t>(f), sample);
  return surfaces;
}

}  // namespace

DecimateResult decimate_and_conform(Run& run,
                                    const LabelVolume& labels,
                                    MaterialSurfaces augmented,
                                    const std::vector<bool>& keep,
                                    const DecimateOptions& options) {
  DecimateSequentialResult decimated = run.stage.run(
      stage_names::kDecimation,
      [&] {
        return decimate_sequential(augmented, keep, labels.frame().voxel_mm(), options,
                                   run.context);
      },
      [&](const DecimateSequentialResult& r) {
        return fmt::format("{} removed from {} boundaries, {} could not go from each",
                           r.stats.removed, r.boundaries.size(), r.stats.kept.size());
      });
  run.report.stages.decimation = decimated.stats;
  const std::vector<Vec3> points = augmented.points();
  augmented = {};  // the largest thing in memory

  MaterialSurfaces surfaces = run.stage.run(
      stage_names::kEdgeConformity,
      [&] {
        ConformEdgesResult conformed =
            conform_edges(std::move(decimated.boundaries), points, run.context);
        conformed.stats.boundaries_repeated = decimated.repeated;
        run.report.stages.edge_conformity = conformed.stats;  // a failed run tells them, too
        require_conformal(conformed, names_in_messages(run), labels.material_count());
        return join(conformed, labels.material_count());
      },
      [&](const MaterialSurfaces&) {
        const ConformEdgesStats& stats = *run.report.stages.edge_conformity;
        const EdgeConformity total = stats.total();
        return fmt::format("{} of {} edges differed, {} flips in {} passes", total.edges_differing,
                           total.edges, total.flips, stats.passes.size());
      });
  return {std::move(surfaces), std::move(decimated.stats)};
}

void require_conformal(const ConformEdgesResult& conformed,
                       const MeshNames& names,
                       std::size_t material_count) {
  const Refusals refusals(names, material_count);
  refusals.refuse_differences(conformed.stats);
  refusals.refuse_shared_edges(conformed.mesh);
  refusals.refuse_other_faults(conformed.mesh);
  refusals.refuse_intersections(conformed.mesh);
}

}  // namespace cvmesh
