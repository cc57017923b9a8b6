// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include <string>
#include <string_view>

namespace cvmesh {

/// Appends bytes as base64 (RFC 4648, with padding). Pieces whose lengths are multiples of three
/// may be appended one after the other.
void append_base64(std::string_view bytes, std::string& text);

}  // namespace cvmesh
