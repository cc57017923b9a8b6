// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/core/label.h"

#include <filesystem>
#include <map>
#include <string>

namespace cvmesh {

/// The names of labels in a file of another program, which its first entry tells:
/// - ITK-SNAP label descriptions: `2 0 255 0 1 1 1 "cement"` (index, red, green, blue, opacity,
///   visibility, mesh visibility, name in quotes)
/// - 3D Slicer colour tables: `2 cement 0 255 0 255` (index, name without blanks, red, green, blue,
///   opacity)
///
/// Lines that are blank or begin with # are no entries.
/// @throws Error BadParameter naming file and line: entries of another form, an index that is no
///         label value or was there before, text that is no UTF-8, an empty file, no regular file
std::map<Label, std::string> read_label_names(const std::filesystem::path& path);

}  // namespace cvmesh
