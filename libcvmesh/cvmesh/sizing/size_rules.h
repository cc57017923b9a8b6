// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/mesh/interface_mesh.h"
#include "cvmesh/sizing/compute_sizing_field.h"

#include <cstdint>
#include <vector>

namespace cvmesh {

/// What the options want of h before any gradation: clamp(epsilon feature, min, max) with the
/// values that rule on a patch. Those of an interface stand before those of its materials, of which
/// the smaller size holds, and those before the common ones.
class SizeRules {
 public:
  /// @throws Error BadParameter for epsilon, delta or bounds out of range
  SizeRules(const Strata& strata, const SizingOptions& options);

  /// The size wanted at point p of a patch (index into `Strata::patches`).
  [[nodiscard]] double wanted_mm(std::int32_t patch, const Vec3& p, double feature_mm) const;

 private:
  struct Bounds {
    double epsilon, min_edge_mm, max_edge_mm;
  };

  static Bounds overridden(Bounds bounds, const OwnSizes& own);
  static Bounds overridden_in_box(Bounds bounds, const OwnSizes& own);
  static const Bounds& checked(const Bounds& bounds, const std::string& where);

  std::vector<std::vector<Bounds>> bounds_of_;  // of a patch, one for each side that counts
  std::vector<BoxSizes> boxes_;
};

}  // namespace cvmesh
