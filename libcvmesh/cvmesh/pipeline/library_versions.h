// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include <map>
#include <string>

namespace cvmesh {

/// The versions of the libraries that results depend on, by their names in small letters.
std::map<std::string, std::string> library_versions();

}  // namespace cvmesh
