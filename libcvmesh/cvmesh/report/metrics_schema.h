// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include <nlohmann/json_fwd.hpp>

namespace cvmesh {

/// The JSON schema (draft 7) of NAME.metrics.json, of NAME.failed.json and of the report that
/// `cvmesh metrics` writes. What every report has, and the shape of every statistic, is exact;
/// `results.stages` is open, since its keys follow the stages.
nlohmann::ordered_json metrics_schema();

}  // namespace cvmesh
