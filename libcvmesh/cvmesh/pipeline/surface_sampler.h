// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/medial/medial_axis.h"
#include "cvmesh/particles/particle_set.h"
#include "cvmesh/pipeline/find_epsilon.h"
#include "cvmesh/pipeline/run.h"
#include "cvmesh/sizing/compute_sizing_field.h"

#include <optional>
#include <span>
#include <utility>
#include <vector>

namespace cvmesh {

/// Particles and the field that spaced them.
struct Sampling {
  SizingField sizing_field;
  ParticleSet particles;
};

/// The particle stages for one setting of the sizes after the other; the stats of the last one are
/// in the report.
class SurfaceSampler {
 public:
  /// All but the medial axis must outlive the sampler.
  SurfaceSampler(Run& run, const Dense& dense, const LevelSets& level_sets, MedialAxis medial_axis);

  /// @param cap_mm  as of `SizingProblem::field`
  Sampling sample(const SizingOptions& options, std::span<const double> cap_mm = {});

  /// The sampling whose particles come nearest to `target`, in rounds: a search that computes
  /// sizing fields only, then the particles, which tell what to expect in the next
  /// (`PopulationLaw`). One round, where what topology asks for beyond the field exceeds the target
  /// alone.
  Sampling sample_to_target(const SizingOptions& options, std::size_t target);

  /// The epsilon that a field found with `factor` amounts to.
  [[nodiscard]] double epsilon_of(const SizingOptions& options,
                                  double factor,
                                  const SizingField& field) const;

  /// The factor for every epsilon at which the sizing field is expected to give the wanted
  /// vertices: a search on estimates, then on the fields themselves, of which the last is kept.
  CountSearchResult search_expected(const SizingOptions& options, double wanted);

  /// Local feature size of every dense vertex.
  const std::vector<double>& lfs_mm() { return problem().lfs_mm(); }

 private:
  SizingResult size(const SizingOptions& options, std::span<const double> cap_mm);
  const SizingProblem& problem();
  void drop_room_beyond(const SizingOptions& options, double wanted);
  void base_on_deviation(const SizingOptions& options, double wanted);

  Run& run_;
  const Dense& dense_;
  const LevelSets& level_sets_;
  MedialAxis medial_axis_;
  std::optional<SizingProblem> problem_;
  bool is_room_checked_ = false;
  bool is_based_on_deviation_ = false;
  std::optional<std::pair<SizingOptions, SizingResult>> searched_;  ///< the search's last field
};

}  // namespace cvmesh
