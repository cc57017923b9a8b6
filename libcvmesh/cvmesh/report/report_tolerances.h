// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include <nlohmann/json_fwd.hpp>

#include <string>
#include <string_view>
#include <vector>

namespace cvmesh {

/// How far a number of a report may move: by `abs`, or by `rel` times what it was, whichever is
/// more. Zero and zero ask for equality; texts and booleans are compared for equality always.
struct Tolerance {
  double abs = 0, rel = 0;
  bool is_ignored = false;  ///< neither the value nor its presence counts
};

/// The tolerance of all paths that a pattern matches. A path is the keys from the root of the
/// report joined by dots, as in `results.labels.2.volume.mesh_mm3`; in a pattern, `*` stands for
/// any part of one key and a key `**` for any number of keys, none included.
struct ToleranceRule {
  std::string pattern;
  Tolerance tolerance;
};

/// Of all rules that match a path, the last one counts; without one, values must be equal.
using ToleranceRules = std::vector<ToleranceRule>;

/// What a comparison of two versions, compilers or seeds should let pass, and nothing more.
///
/// Exact: what the volume alone decides (accounting of labels, components, Euler characteristics)
/// and what was checked. Statistics: a last bit that differs in an early stage leads to another
/// draw of the particles, so counts, means and percentiles get the scatter between seeds, and
/// extremes (one facet, one tet) several times as much. The same figure in other units is not
/// judged twice: of distances, voxels count and mm do not. How a mesh came about (`results.stages`)
/// is not judged, but for the labels, the vertices kept and the epsilon found.
const ToleranceRules& default_tolerances();

/// The rules of a tolerances file, in its order:
/// {"results.mesh.tets": {"abs": 10, "rel": 0.02}, "results.stages.**": {"ignore": true}}.
///
/// The key "comment" is ignored. `abs` and `rel` default to 0.
/// @throws Error BadParameter naming source, pattern, value and way out
ToleranceRules parse_tolerances(const nlohmann::ordered_json& file, const std::string& source);

/// A tolerances file with these rules; parsing it gives them again.
nlohmann::ordered_json tolerances_to_json(const ToleranceRules& rules);

/// Whether `pattern` matches all of `path`.
bool matches_path(std::string_view pattern, std::string_view path);

/// The tolerance that `rules` give a path.
Tolerance tolerance_of(const ToleranceRules& rules, std::string_view path);

}  // namespace cvmesh
