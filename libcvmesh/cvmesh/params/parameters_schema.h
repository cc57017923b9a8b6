// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include <nlohmann/json_fwd.hpp>

namespace cvmesh {

/// The JSON schema (draft 2020-12) of the parameter file: keys, types, bounds, defaults and
/// meanings, from `parameter_table()`.
nlohmann::ordered_json parameters_schema();

}  // namespace cvmesh
