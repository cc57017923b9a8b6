// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/surface/decimate_sequential.h"

#include "cvmesh/core/error.h"
#include "cvmesh/core/random.h"
#include "cvmesh/pipeline/stage_names.h"

#include <spdlog/spdlog.h>

#include <algorithm>
#include <limits>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <tuple>
#include <utility>

namespace cvmesh {
namespace {

// Ids of the two materials that one material and all the rest are in its own mesh.
constexpr MaterialId kRest = 0, kItself = 1;

/// Hands on the progress of one material's decimation as a part of the whole stage's.
class PartOfStage final : public ProgressSink {
 public:
  PartOfStage(ProgressSink& whole, double begin, double share)
      : whole_(whole), begin_(begin), share_(share) {}

  void begin(std::string_view) override {}

  void advance(std::string_view stage, double fraction) override {
    whole_.advance(stage, std::min(1.0, begin_ + share_ * fraction));
  }

  void end(std::string_view, double, std::string_view) override {}

 private:
  ProgressSink& whole_;
  double begin_, share_;
};

/// The boundary of one material as a mesh of two, with vertices of its own.
struct OwnMesh {
  InterfaceMesh mesh;
  std::vector<std::int32_t> vertex_of;  // own vertex -> vertex of all surfaces
  std::vector<PatchKey> patches;        // by the `wall` of the own key
};

OwnMesh cut_out(const MaterialSurfaces& surfaces,
                MaterialId material,
                const std::vector<std::int32_t>& facets) {
  OwnMesh own;
  for (const auto f : facets) {
    own.patches.push_back(surfaces.facets()[f].patch);
    for (const auto v : surfaces.facets()[f].vertices)
      own.vertex_of.push_back(v);
  }
  const auto make_set = [](auto& values) {
    std::sort(values.begin(), values.end());
    values.erase(std::unique(values.begin(), values.end()), values.end());
  };
  make_set(own.patches);
  make_set(own.vertex_of);
  const auto place_in = [](const auto& set, const auto& value) {
    return std::lower_bound(set.begin(), set.end(), value) - set.begin();
  };
  // Seen from one material there are two, and the wall of the key tells the patches apart: so
  // junction curves stay curves.
  using Wall = decltype(PatchKey::wall);
  require(own.patches.size() <= std::numeric_limits<Wall>::max(), ErrorCode::StageFailed,
          stage_names::kDecimation,
          "a material with " + std::to_string(own.patches.size()) +
              " interfaces cannot be decimated alone; set schedule to \"lock-step\"");
  for (const auto v : own.vertex_of)
    own.mesh.points.push_back(surfaces.points()[v]);
  for (const auto f : facets) {
    const auto& facet = surfaces.facets()[f];
    std::array<std::int32_t, 3> vertices{};
    for (int c = 0; c < 3; ++c)
      vertices[c] = static_cast<std::int32_t>(place_in(own.vertex_of, facet.vertices[c]));
    if (facet.patch.sides.inside != material) std::swap(vertices[1], vertices[2]);
    own.mesh.facets.push_back(vertices);
    own.mesh.patch_of.push_back(
        {{kItself, kRest}, static_cast<Wall>(place_in(own.patches, facet.patch))});
  }
  return own;
}

OwnBoundary boundary_of(const MaterialSurfaces& thinned, const OwnMesh& own, MaterialId material) {
  OwnBoundary boundary;
  for (std::size_t f = 0; f < thinned.facets().size(); ++f) {
    const auto& facet = thinned.facets()[f];
    if (!facet.is_alive) continue;
    OwnFacet result{own.patches[facet.patch.wall], facet.vertices, {}};
    for (auto& v : result.vertices)
      v = own.vertex_of[v];
    if (result.patch.sides.inside != material) std::swap(result.vertices[1], result.vertices[2]);
    std::rotate(result.vertices.begin(),
                std::min_element(result.vertices.begin(), result.vertices.end()),
                result.vertices.end());
    if (is_master(material, result.patch))
      thinned.for_each_sample(static_cast<std::int32_t>(f),
                              [&](const Vec3& sample) { result.samples.push_back(sample); });
    boundary.push_back(std::move(result));
  }
  std::sort(boundary.begin(), boundary.end(), [](const OwnFacet& a, const OwnFacet& b) {
    return std::tie(a.patch, a.vertices) < std::tie(b.patch, b.vertices);
  });
  return boundary;
}

std::vector<std::vector<std::int32_t>> facets_of_materials(const MaterialSurfaces& surfaces) {
  std::vector<std::vector<std::int32_t>> facets(surfaces.material_count());
  for (std::size_t f = 0; f < surfaces.facets().size(); ++f) {
    const auto& facet = surfaces.facets()[f];
    if (!facet.is_alive) continue;
    for (const MaterialId m : {facet.patch.sides.inside, facet.patch.sides.outside})
      facets[m].push_back(static_cast<std::int32_t>(f));
  }
  return facets;
}

/// Thins out boundary after boundary, and again where a vertex has to stay after all.
class BoundaryThinner {
 public:
  BoundaryThinner(const MaterialSurfaces& surfaces,
                  const std::vector<bool>& keep,
                  double voxel_mm,
                  const DecimateOptions& options,
                  const StageContext& context)
      : surfaces_(surfaces),
        keep_(keep),
        voxel_mm_(voxel_mm),
        options_(options),
        context_(context),
        seeds_(context.seed, "sequential decimation"),
        facets_(facets_of_materials(surfaces)),
        boundaries_(facets_.size()),
        stats_(facets_.size()) {
    for (const auto& own : facets_)
      total_ += static_cast<double>(own.size());
  }

  void thin_out(MaterialId material) {
    const OwnMesh own = cut_out(surfaces_, material, facets_[material]);
    std::vector<bool> keep_own;
    for (const auto v : own.vertex_of)
      keep_own.push_back(keep_[static_cast<std::size_t>(v)]);

    StageContext own_context = context_;
    own_context.seed = seeds_.bits(material);
    std::optional<PartOfStage> progress;
    const double size = static_cast<double>(facets_[material].size());
    if (context_.progress != nullptr)
      own_context.progress = &progress.emplace(*context_.progress, done_ / total_, size / total_);
    DecimateResult decimated =
        decimate(MaterialSurfaces(own.mesh, 2), keep_own, voxel_mm_, options_, own_context);
    done_ = std::min(total_, done_ + size);
    boundaries_[material] = boundary_of(decimated.surfaces, own, material);
    stats_[material] = std::move(decimated.stats);
    for (KeptVertex kept : stats_[material].kept) {
      kept.vertex = own.vertex_of[kept.vertex];
      kept_.try_emplace(kept.vertex, kept);
    }
  }

  /// The boundaries that lost a vertex that another one still has; from now on it is kept.
  std::vector<MaterialId> keep_in_all() {
    std::vector<std::vector<bool>> is_left(boundaries_.size());
    for (std::size_t m = 0; m < boundaries_.size(); ++m)
      is_left[m] = vertices_left(m);
    std::vector<bool> is_to_repeat(boundaries_.size(), false);
    for (const auto& [v, kept] : kept_) {
      bool is_somewhere = false;
      for (const auto& copy : surfaces_.copies(v))
        is_somewhere |= is_left[copy.material][static_cast<std::size_t>(v)];
      if (!is_somewhere) continue;
      keep_[static_cast<std::size_t>(v)] = true;
      for (const auto& copy : surfaces_.copies(v))
        if (!is_left[copy.material][static_cast<std::size_t>(v)])
          is_to_repeat[copy.material] = true;
    }
    std::vector<MaterialId> materials;
    for (std::size_t m = 0; m < is_to_repeat.size(); ++m)
      if (is_to_repeat[m]) materials.push_back(static_cast<MaterialId>(m));
    return materials;
  }

  /// All that is known at the end; nothing can be done with the thinner afterwards.
  DecimateSequentialResult take_result() {
    DecimateSequentialResult result;
    std::vector<bool> is_left(surfaces_.points().size(), false);
    for (std::size_t m = 0; m < boundaries_.size(); ++m) {
      const std::vector<bool> own = vertices_left(m);
      for (std::size_t v = 0; v < own.size(); ++v)
        if (own[v]) is_left[v] = true;
      result.stats.deviation_vox = stats_[m].deviation_vox;
      result.stats.deferrals += stats_[m].deferrals;
      result.stats.passes = std::max(result.stats.passes, stats_[m].passes);
      for (const auto& [reason, count] : stats_[m].refusals)
        result.stats.refusals[reason] += count;
    }
    for (const auto& [v, kept] : kept_)
      if (is_left[static_cast<std::size_t>(v)]) result.stats.kept.push_back(kept);
    result.stats.removed = surfaces_.vertex_count() - static_cast<std::size_t>(std::count(
                                                          is_left.begin(), is_left.end(), true));
    result.boundaries = std::move(boundaries_);
    return result;
  }

 private:
  [[nodiscard]] std::vector<bool> vertices_left(std::size_t material) const {
    std::vector<bool> is_left(surfaces_.points().size(), false);
    for (const OwnFacet& facet : boundaries_[material])
      for (const auto v : facet.vertices)
        is_left[static_cast<std::size_t>(v)] = true;
    return is_left;
  }

  const MaterialSurfaces& surfaces_;
  std::vector<bool> keep_;
  double voxel_mm_;
  const DecimateOptions& options_;
  const StageContext& context_;
  CounterRandom seeds_;
  std::vector<std::vector<std::int32_t>> facets_;  // per material
  std::vector<OwnBoundary> boundaries_;
  std::vector<DecimateStats> stats_;
  std::map<std::int32_t, KeptVertex> kept_;  // all that could not go when they were tried
  double total_ = 0, done_ = 0;              // facets, for the progress
};

}  // namespace

DecimateSequentialResult decimate_sequential(const MaterialSurfaces& surfaces,
                                             const std::vector<bool>& keep,
                                             double voxel_mm,
                                             const DecimateOptions& options,
                                             const StageContext& context) {
  BoundaryThinner thinner(surfaces, keep, voxel_mm, options, context);
  for (std::size_t m = 0; m < surfaces.material_count(); ++m)
    thinner.thin_out(static_cast<MaterialId>(m));
  // A boundary that keeps one vertex more may get stuck elsewhere, so one round may not do.
  constexpr int kMostRounds = 4;
  std::size_t repeated = 0;
  for (int round = 0; round < kMostRounds; ++round)
    for (const MaterialId m : thinner.keep_in_all()) {
      context.log->debug("decimation: boundary {} again, for a vertex that stays in another", m);
      thinner.thin_out(m);
      ++repeated;
    }
  DecimateSequentialResult result = thinner.take_result();
  result.repeated = repeated;
  return result;
}

}  // namespace cvmesh
