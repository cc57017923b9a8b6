// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/tet/open_tets.h"
#include "cvmesh/tet/tet_score.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <vector>

namespace cvmesh {

/// Of some tets together.
struct TetQuality {
  double worst = std::numeric_limits<double>::infinity();  ///< smallest sine
  double sum = 0;                                          ///< of radius ratios
  std::size_t count = 0;

  void add(const TetScore& score) {
    worst = std::min(worst, score.min_sine);
    sum += score.radius_ratio;
    ++count;
  }

  [[nodiscard]] double mean() const { return sum / static_cast<double>(count); }
};

inline TetQuality quality_of(const OpenTets& tets, const std::vector<std::int32_t>& some) {
  TetQuality quality;
  for (const std::int32_t t : some)
    quality.add(tets.score(t));
  return quality;
}

/// What tets are improved for: the worst angle first; where it is comfortable, the mean radius
/// ratio.
class TetGoal {
 public:
  /// Below this sine the sign of a volume is not certain in double precision.
  static constexpr double kLeastSine = 1e-9;
  /// A change must raise the worst sine, or the mean radius ratio, by this much: rounding cannot
  /// make two states pass into each other for ever, and no time goes into gains that nobody sees.
  static constexpr double kLeastGain = 1e-3;

  explicit TetGoal(double comfortable_sine) : comfort_(comfortable_sine) {}

  [[nodiscard]] double comfort() const { return comfort_; }

  [[nodiscard]] double capped(double sine) const { return std::min(sine, comfort_); }

  [[nodiscard]] bool is_better(const TetQuality& now, const TetQuality& before) const {
    const double worst = capped(now.worst), old = capped(before.worst);
    if (worst <= kLeastSine) return false;
    if (worst > old + kLeastGain) return true;
    return worst >= old && now.mean() > before.mean() + kLeastGain;
  }

 private:
  double comfort_;
};

}  // namespace cvmesh
