// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/report/report_tolerances.h"

#include "cvmesh/core/error.h"

#include <nlohmann/json.hpp>
#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cmath>
#include <utility>

namespace cvmesh {

namespace {

using Json = nlohmann::ordered_json;

constexpr char kCommentKey[] = "comment";
constexpr std::string_view kAnyKeys = "**";

constexpr Tolerance kExact{};
constexpr Tolerance kIgnored{.abs = 0, .rel = 0, .is_ignored = true};

/// The bounds below, unless a comment tells otherwise: the largest difference between six seeds, on
/// three phantoms of 400 to 600 surface vertices, and a quarter more.
constexpr Tolerance within(double abs, double rel) {
  return {.abs = abs, .rel = rel, .is_ignored = false};
}

/// The first key of a path, and what follows its dot.
std::pair<std::string_view, std::string_view> split_key(std::string_view path) {
  const std::size_t dot = path.find('.');
  if (dot == std::string_view::npos) return {path, {}};
  return {path.substr(0, dot), path.substr(dot + 1)};
}

/// Whether a pattern with stars matches one key; looks back to the last star only, which is enough.
bool matches_key(std::string_view pattern, std::string_view key) {
  std::size_t p = 0, k = 0, star = std::string_view::npos, after_star = 0;
  while (k < key.size()) {
    if (p < pattern.size() && pattern[p] == '*') {
      star = p++;
      after_star = k;
    } else if (p < pattern.size() && pattern[p] == key[k]) {
      ++p;
      ++k;
    } else if (star != std::string_view::npos) {
      p = star + 1;
      k = ++after_star;
    } else {
      return false;
    }
  }
  return pattern.find_first_not_of('*', p) == std::string_view::npos;
}

[[noreturn]] void refuse(const std::string& source, const std::string& message) {
  throw Error(ErrorCode::BadParameter, "tolerances", source + ": " + message);
}

double read_bound(const Json& value, const std::string& path, const std::string& source) {
  if (!value.is_number() || value.get<double>() < 0)
    refuse(source, fmt::format("{} ({}) must be a number of at least 0", path, value.dump()));
  return value.get<double>();
}

Tolerance read_tolerance(const Json& entry, const std::string& pattern, const std::string& source) {
  if (!entry.is_object())
    refuse(source,
           fmt::format("\"{}\" ({}) must be an object like {{\"abs\": 0.01, \"rel\": 0.05}}",
                       pattern, entry.dump()));
  Tolerance tolerance;
  for (const auto& [key, value] : entry.items()) {
    const std::string path = fmt::format("\"{}\".{}", pattern, key);
    if (key == "abs") {
      tolerance.abs = read_bound(value, path, source);
    } else if (key == "rel") {
      tolerance.rel = read_bound(value, path, source);
    } else if (key == "ignore") {
      if (!value.is_boolean())
        refuse(source, fmt::format("{} ({}) must be true or false", path, value.dump()));
      tolerance.is_ignored = value.get<bool>();
    } else if (key != kCommentKey) {
      refuse(source,
             fmt::format("unknown key {}; the keys of a tolerance are abs, rel and ignore", path));
    }
  }
  if (tolerance.is_ignored && (entry.contains("abs") || entry.contains("rel")))
    refuse(source, fmt::format("\"{}\" has bounds and is ignored; give one of the two", pattern));
  return tolerance;
}

/// Nothing matches such a pattern: a mistake that would go unseen.
void check_pattern(const std::string& pattern, const std::string& source) {
  if (pattern.empty() || pattern.front() == '.' || pattern.back() == '.' ||
      pattern.find("..") != std::string::npos)
    refuse(source, fmt::format("the pattern \"{}\" has an empty key; write it like "
                               "\"results.labels.*.tets\"",
                               pattern));
}

}  // namespace

const ToleranceRules& default_tolerances() {
  static const ToleranceRules rules = {
      {"**", kExact},
      // How the mesh came about.
      {"results.stages.**", kIgnored},
      {"results.stages.labels.**", kExact},
      {"results.stages.decimation.kept_count", within(3, 0.25)},
      {"results.stages.epsilon_search.target", kExact},
      {"results.stages.epsilon_search.wanted", kExact},
      {"results.stages.epsilon_search.reached", within(0, 0.05)},
      {"results.stages.epsilon_search.epsilon", within(0, 0.05)},
      // Counts.
      {"results.mesh.*", within(15, 0.06)},
      {"results.particles.*", within(10, 0.05)},
      {"results.interfaces.*.particles", within(10, 0.05)},
      {"results.labels.*.particles", within(10, 0.05)},
      {"results.labels.*.surface_triangles", within(20, 0.05)},
      {"results.labels.*.tets", within(40, 0.08)},
      {"results.labels.*.share_below_three_facets", within(0.02, 0)},
      // Volumes: those of the voxels are input.
      {"**.volume.voxels_mm3", within(0, 1e-9)},
      {"**.volume.mesh_mm3", within(0, 0.02)},
      {"**.volume.relative_error", within(0.02, 0)},
      // Shapes: the middle of a distribution, its tails, its extremes.
      {"**.quality.**.radius_ratio.*", within(0.05, 0)},
      {"**.quality.**.radius_ratio.p5", within(0.12, 0)},
      {"**.quality.**.radius_ratio.p1", within(0.3, 0)},
      {"**.quality.**.radius_ratio.min", within(0.3, 0)},
      {"**.quality.**.radius_ratio.count", within(40, 0.08)},
      {"**.quality.**.scaled_jacobian.*", within(0.05, 0)},
      {"**.quality.**.scaled_jacobian.p5", within(0.12, 0)},
      {"**.quality.**.scaled_jacobian.p1", within(0.15, 0)},
      {"**.quality.**.scaled_jacobian.min", within(0.2, 0)},
      {"**.quality.**.scaled_jacobian.count", within(40, 0.08)},
      {"**.quality.**.*_deg.*", within(5, 0)},
      {"**.quality.**.*_deg.p1", within(8, 0)},
      {"**.quality.**.*_deg.p5", within(8, 0)},
      {"**.quality.**.*_deg.p99", within(8, 0)},
      {"**.quality.**.*_deg.min", within(15, 0)},
      {"**.quality.**.*_deg.max", within(15, 0)},
      {"**.quality.**.*_deg.count", within(40, 0.08)},
      {"**.quality.**.dihedral_histogram_10_deg.*", within(200, 0.3)},
      {"**.quality.**.below_*_deg", within(10, 0.25)},
      {"**.quality.**.above_*_deg", within(10, 0.25)},
      // Distances, in voxels.
      {"**.distances.**", within(0.02, 0.12)},
      {"**.distances.**.p95", within(0.05, 0.15)},
      // Single interfaces may be of a few dozen facets: two seeds of a small wedge differ by a
      // third.
      {"results.distances.interfaces.**", within(0.04, 0.4)},
      {"results.distances.interfaces.**.p95", within(0.1, 0.4)},
      {"**.distances.**.max", within(0.65, 0.25)},
      {"**.distances.**.hausdorff*", within(0.65, 0.25)},
      {"**.distances.**.samples", kIgnored},
      // Where the largest distance is, and how exactly it and the mean are known.
      {"**.distances.**.worst.**", kIgnored},
      {"**.distances.**.max_error", kIgnored},
      {"**.distances.**.mean_standard_error", kIgnored},
      {"**.distances.**.mm.**", kIgnored},
      {"**.distances.**.world_mm.**", kIgnored},
      {"**.samples_per_square_voxel", kExact},
      // Only compared on request.
      {"timings.**.seconds", within(1, 0.5)},
      {"timings.total_seconds", within(1, 0.5)},
      {"timings.**.peak_mb", within(64, 0.25)},
      {"timings.threads", kIgnored},
  };
  return rules;
}

bool matches_path(std::string_view pattern, std::string_view path) {
  if (pattern.empty()) return path.empty();
  const auto [head, tail] = split_key(pattern);
  if (head == kAnyKeys) {
    // No key, or one key more.
    if (matches_path(tail, path)) return true;
    return !path.empty() && matches_path(pattern, split_key(path).second);
  }
  if (path.empty()) return false;
  const auto [key, rest] = split_key(path);
  return matches_key(head, key) && matches_path(tail, rest);
}

Tolerance tolerance_of(const ToleranceRules& rules, std::string_view path) {
  const auto rule = std::find_if(rules.rbegin(), rules.rend(), [&](const ToleranceRule& r) {
    return matches_path(r.pattern, path);
  });
  return rule == rules.rend() ? kExact : rule->tolerance;
}

ToleranceRules parse_tolerances(const Json& file, const std::string& source) {
  if (!file.is_object())
    refuse(source,
           "holds no JSON object; a tolerances file is one, like {\"results.mesh.tets\": "
           "{\"rel\": 0.05}}");
  ToleranceRules rules;
  for (const auto& [pattern, entry] : file.items()) {
    if (pattern == kCommentKey) continue;
    check_pattern(pattern, source);
    rules.push_back({pattern, read_tolerance(entry, pattern, source)});
  }
  return rules;
}

Json tolerances_to_json(const ToleranceRules& rules) {
  Json file = Json::object();
  for (const ToleranceRule& rule : rules)
    file[rule.pattern] = rule.tolerance.is_ignored
                             ? Json{{"ignore", true}}
                             : Json{{"abs", rule.tolerance.abs}, {"rel", rule.tolerance.rel}};
  return file;
}

}  // namespace cvmesh
