// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/report/check_gates.h"

#include "cvmesh/core/assert.h"
#include "cvmesh/params/parameter_table.h"
#include "cvmesh/report/report.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cmath>
#include <string_view>
#include <variant>

namespace cvmesh {

namespace {

struct Measured {
  double value = 0;
  std::optional<Label> label{};
};

/// The label whose volume is farthest from that of its voxels.
Measured largest_volume_error_percent(const Report& report) {
  Measured largest;
  for (std::size_t m = 1; m < report.volumes.size(); ++m) {
    const double percent = 100 * std::abs(report.volumes[m].relative_error);
    if (!largest.label || percent > largest.value) largest = {percent, report.label_of[m]};
  }
  return largest;
}

/// What a gate bounds.
struct Gate {
  std::string_view key;
  bool needs_tets;
  Measured (*measure)(const Report&);
};

/// The distances that gates bound.
const SurfaceDistance& to_dense(const Report& report) {
  return report.distances->to_dense->overall;
}

constexpr Gate kGates[] = {
    {"min_dihedral_deg", true,
     [](const Report& r) -> Measured { return {r.quality->tets.min_dihedral_deg.min}; }},
    {"max_dihedral_deg", true,
     [](const Report& r) -> Measured { return {r.quality->tets.max_dihedral_deg.max}; }},
    {"min_tet_quality", true,
     [](const Report& r) -> Measured { return {r.quality->tets.radius_ratio.min}; }},
    {"min_scaled_jacobian", true,
     [](const Report& r) -> Measured { return {r.quality->tets.scaled_jacobian.min}; }},
    {"max_volume_error_percent", true, &largest_volume_error_percent},
    {"max_distance_mm", false,
     [](const Report& r) -> Measured { return {to_dense(r).true_mm().hausdorff_upper_bound()}; }},
    {"max_distance_vox", false,
     [](const Report& r) -> Measured { return {to_dense(r).voxels.hausdorff_upper_bound()}; }},
    {"max_mean_distance_mm", false,
     [](const Report& r) -> Measured { return {to_dense(r).true_mm().mean_symmetric()}; }},
    {"max_mean_distance_vox", false,
     [](const Report& r) -> Measured { return {to_dense(r).voxels.mean_symmetric()}; }},
    {"max_kept_vertices", false, [](const Report& r) -> Measured {
       const auto& decimation = r.stages.decimation;
       return {decimation ? static_cast<double>(decimation->kept.size()) : 0};
     }}};

const Gate& gate_of(std::string_view key) {
  const auto* const gate = std::find_if(std::begin(kGates), std::end(kGates),
                                        [&](const Gate& g) { return g.key == key; });
  CVMESH_ASSERT(gate != std::end(kGates));  // every row of `gate_table` has one
  return *gate;
}

/// The bound that is set behind a row of `gate_table`, or nothing.
std::optional<double> bound_of(const ParameterInfo<QualityGates>& info, QualityGates gates) {
  const ParameterField field = info.field(gates);
  if (auto* const* real = std::get_if<std::optional<double>*>(&field)) return **real;
  const auto& count = **std::get_if<std::optional<std::size_t>*>(&field);
  return count ? std::optional(static_cast<double>(*count)) : std::nullopt;
}

bool is_lower_bound(std::string_view key) {
  return key.substr(0, 4) == "min_";
}

}  // namespace

std::vector<GateResult> check_gates(const Report& report) {
  std::vector<GateResult> results;
  for (const ParameterInfo<QualityGates>& info : gate_table()) {
    const std::optional<double> bound = bound_of(info, report.parameters.gates);
    if (!bound) continue;
    const Measured measured = gate_of(info.key).measure(report);
    results.push_back(
        {.gate = std::string(info.key),
         .bound = *bound,
         .value = measured.value,
         .passed = is_lower_bound(info.key) ? measured.value >= *bound : measured.value <= *bound,
         .label = measured.label});
  }
  return results;
}

std::vector<std::string> gates_of_tets(const QualityGates& gates) {
  std::vector<std::string> keys;
  for (const ParameterInfo<QualityGates>& info : gate_table())
    if (bound_of(info, gates) && gate_of(info.key).needs_tets) keys.emplace_back(info.key);
  return keys;
}

std::string missed_gates_message(const std::vector<GateResult>& gates) {
  std::string list;
  std::size_t missed = 0;
  for (const GateResult& gate : gates) {
    if (gate.passed) continue;
    ++missed;
    list +=
        fmt::format("{}{} is {:.4g}{}, {} {:g}", list.empty() ? "" : "; ", gate.gate, gate.value,
                    gate.label ? fmt::format(" (label {})", *gate.label) : std::string(),
                    is_lower_bound(gate.gate) ? "below" : "above", gate.bound);
  }
  if (missed == 0) return {};
  return fmt::format(
      "{} of {} gates missed: {}; the mesh was written; a smaller epsilon brings the "
      "surface closer and shapes thin parts better",
      missed, gates.size(), list);
}

}  // namespace cvmesh
