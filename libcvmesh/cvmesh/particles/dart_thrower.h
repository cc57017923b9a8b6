// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/core/random.h"
#include "cvmesh/particles/sheets.h"

#include <cstddef>
#include <cstdint>
#include <limits>
#include <vector>

namespace cvmesh {

/// Places random points on one sheet, none within a disc around another (dart throwing): for sheets
/// that hold only a few, and for the paper's uniform and dense start.
class DartThrower {
 public:
  /// @param rim  places on the boundary of the sheet, which count as taken
  DartThrower(const Sheets& sheets,
              const Sheet& sheet,
              std::vector<SurfacePoint> rim,
              double clearance_mm,
              const CounterRandom& random);

  /// Exactly `wanted` places at distances of h times `h_scale`, if the sheet has room for them.
  std::vector<SurfacePoint> by_size(std::size_t wanted, double h_scale);
  /// Uniform places about a voxel apart (closer where h is smaller), at least `least`.
  std::vector<SurfacePoint> dense(std::size_t least, double h_scale);

 private:
  [[nodiscard]] std::size_t count() const { return placed_.size() - rim_size_; }

  [[nodiscard]] std::vector<SurfacePoint> inner() const {
    return {placed_.begin() + static_cast<std::ptrdiff_t>(rim_size_), placed_.end()};
  }

  [[nodiscard]] double size_at(const SurfacePoint& p) const {
    return std::min(max_h_, h_scale_ * p.h_mm);
  }

  void scatter(double expected);
  void add_candidate(std::int32_t f, double r1, double r2);
  void throw_darts(double radius, std::size_t wanted);
  [[nodiscard]] SurfacePoint settled(const SurfacePoint& candidate) const;
  bool add_farthest();

  const Sheets& sheets_;
  const Sheet& sheet_;
  double clearance_, h_scale_ = 1, max_h_ = std::numeric_limits<double>::infinity();
  CounterRandom random_;
  std::vector<SurfacePoint> placed_, candidates_;  // placed_: the rim first
  std::vector<Vec3> positions_;                    // of the candidates
  std::size_t rim_size_ = 0;
};

}  // namespace cvmesh
