// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/core/error.h"

#include <nlohmann/json_fwd.hpp>

#include <filesystem>
#include <string>

namespace cvmesh {

/// Writes `value` with two spaces of indentation, keys in their order, and a final newline.
///
/// Bytes that are no UTF-8 become U+FFFD, and a number that is not finite becomes null.
/// @throws Error Output when the file cannot be written; an older file stays then
void write_json(const std::filesystem::path& path, const nlohmann::ordered_json& value);

/// The JSON document in a file, keys in the order of the file.
///
/// @param code   of the errors, for files that are no parameters
/// @param stage  of the errors
/// @throws Error of that code when the file cannot be read, is no JSON (told by line and column),
///         or names a key twice in one object
nlohmann::ordered_json read_json(const std::filesystem::path& path,
                                 ErrorCode code = ErrorCode::BadParameter,
                                 const std::string& stage = "parameters");

}  // namespace cvmesh
