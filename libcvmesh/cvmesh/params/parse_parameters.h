// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/params/parameters.h"

#include <nlohmann/json_fwd.hpp>

#include <string>
#include <vector>

namespace cvmesh {

/// The parameters that a JSON document and single settings ask for, over the defaults.
///
/// Every value is used or refused, none is clamped. The key "comment" is allowed anywhere and
/// ignored; `null` means "not set" for optional keys. `epsilon`, `target_vertices`, `target_tets`,
/// `max_distance_mm` and `max_distance_vox` exclude each other inside the file and among the
/// settings; a setting of one of them replaces what the file says.
///
/// @param file      the parameter file's object; an empty object for the defaults
/// @param source    name of the file in messages
/// @param settings  "key=value", "labels.<label>.key=value" or "gates.key=value", the later the
///                  stronger; a value
///                  that is no JSON is taken as a string
/// @throws Error BadParameter naming source, key, value, bound and way out
Parameters parse_parameters(const nlohmann::ordered_json& file,
                            const std::string& source,
                            const std::vector<std::string>& settings = {});

/// All effective parameters as a JSON object, every key in table order. A valid parameter file
/// again: parsing it gives the same parameters.
nlohmann::ordered_json parameters_to_json(const Parameters& parameters);

}  // namespace cvmesh
