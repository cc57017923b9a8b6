// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/report/report.h"

#include <nlohmann/json_fwd.hpp>

#include <cstddef>

namespace cvmesh {

/// `results.distances`: by reference (`to_dense`, `to_labels`, `to_truth`; those that were
/// measured), unit and direction; `interfaces` has the same for each pair of labels. Places are in
/// the coordinates of the output.
nlohmann::ordered_json distances_json(const Report& report);

/// The distances of material m's boundary, by reference.
nlohmann::ordered_json material_distances_json(const Report& report, std::size_t m);

}  // namespace cvmesh
