// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/sizing/size_rules.h"

#include "cvmesh/core/error.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <string>

namespace cvmesh {
namespace {

constexpr char kStage[] = "sizing field";
constexpr double kInfinity = std::numeric_limits<double>::infinity();

std::string number(double value) {
  std::string text = std::to_string(value);
  text.erase(text.find_last_not_of('0') + 1);
  if (text.back() == '.') text.pop_back();
  return text;
}

void check(bool is_good, const std::string& message) {
  require(is_good, ErrorCode::BadParameter, kStage, message);
}

}  // namespace

SizeRules::SizeRules(const Strata& strata, const SizingOptions& options) : boxes_(options.boxes) {
  check(std::isfinite(options.delta) && options.delta >= 0,
        "delta (" + number(options.delta) + ") must not be negative; usual values are 0.2 to 1");
  check(std::isfinite(options.min_feature_vox) && options.min_feature_vox > 0,
        "min_feature_vox (" + number(options.min_feature_vox) + ") must be greater than 0");
  const Bounds common = checked(
      {options.epsilon, options.min_edge_mm.value_or(0), options.max_edge_mm.value_or(kInfinity)},
      "");
  std::map<MaterialId, Bounds> of_material;
  for (const auto& [m, own] : options.per_material)
    of_material[m] = checked(overridden(common, own), "material " + std::to_string(m) + ": ");

  // In a box the common bounds give way: its own must not cross.
  for (std::size_t n = 0; n < boxes_.size(); ++n)
    checked(overridden({1, 0, kInfinity}, boxes_[n].sizes), "box " + std::to_string(n) + ": ");

  for (const auto& patch : strata.patches) {
    std::vector<Bounds>& bounds = bounds_of_.emplace_back();
    for (const MaterialId m : {patch.sides.inside, patch.sides.outside}) {
      const auto found = of_material.find(m);
      // The exterior has a say only where it is named.
      if (found != of_material.end())
        bounds.push_back(found->second);
      else if (m != kExterior)
        bounds.push_back(common);
    }
    const auto interface = options.per_interface.find(patch.sides);
    if (interface == options.per_interface.end()) continue;
    for (Bounds& b : bounds)
      b = checked(overridden(b, interface->second),
                  "interface of materials " + std::to_string(patch.sides.outside) + " and " +
                      std::to_string(patch.sides.inside) + ": ");
  }
}

double SizeRules::wanted_mm(std::int32_t patch, const Vec3& p, double feature_mm) const {
  double smallest = kInfinity;
  for (Bounds b : bounds_of_[static_cast<std::size_t>(patch)]) {
    for (const BoxSizes& box : boxes_)
      if (box.box_mm.contains(p)) b = overridden_in_box(b, box.sizes);
    smallest = std::min(smallest, std::clamp(b.epsilon * feature_mm, b.min_edge_mm, b.max_edge_mm));
  }
  return smallest;
}

SizeRules::Bounds SizeRules::overridden(Bounds bounds, const OwnSizes& own) {
  bounds.epsilon = own.epsilon.value_or(bounds.epsilon);
  bounds.min_edge_mm = own.min_edge_mm.value_or(bounds.min_edge_mm);
  bounds.max_edge_mm = own.max_edge_mm.value_or(bounds.max_edge_mm);
  return bounds;
}

// A bound of the box takes one from outside along where they cross: a box meets many labels.
SizeRules::Bounds SizeRules::overridden_in_box(Bounds bounds, const OwnSizes& own) {
  bounds = overridden(bounds, own);
  if (own.max_edge_mm)
    bounds.min_edge_mm = std::min(bounds.min_edge_mm, bounds.max_edge_mm);
  else
    bounds.max_edge_mm = std::max(bounds.max_edge_mm, bounds.min_edge_mm);
  return bounds;
}

const SizeRules::Bounds& SizeRules::checked(const Bounds& b, const std::string& where) {
  check(std::isfinite(b.epsilon) && b.epsilon > 0,
        where + "epsilon (" + number(b.epsilon) +
            ") must be greater than 0; usual values are 0.5 to 5");
  check(b.min_edge_mm >= 0,
        where + "min_edge_mm (" + number(b.min_edge_mm) + ") must not be negative");
  check(b.max_edge_mm > 0,
        where + "max_edge_mm (" + number(b.max_edge_mm) + ") must be greater than 0");
  check(b.min_edge_mm <= b.max_edge_mm, where + "min_edge_mm (" + number(b.min_edge_mm) +
                                            ") exceeds max_edge_mm (" + number(b.max_edge_mm) +
                                            "); lower min_edge_mm");
  return b;
}

}  // namespace cvmesh
