// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/core/label.h"
#include "cvmesh/params/parameters.h"

#include <optional>
#include <string>
#include <vector>

namespace cvmesh {

struct Report;

/// One quality gate, and what the mesh has.
struct GateResult {
  std::string gate;  ///< its key; `min_...` bounds the value from below, `max_...` from above
  double bound = 0, value = 0;
  bool passed = false;
  std::optional<Label> label{};  ///< where the value was found, for gates of single labels
};

/// All gates of the report's parameters that are set, in the order of `gate_table()`.
/// @pre the report has quality, distances and, where gates need tets, volumes
std::vector<GateResult> check_gates(const Report& report);

/// Gates that only a mesh of tets can keep or miss, of those that are set.
std::vector<std::string> gates_of_tets(const QualityGates& gates);

/// One sentence that names every gate that was missed, its value and its bound; empty if none was.
std::string missed_gates_message(const std::vector<GateResult>& gates);

}  // namespace cvmesh
