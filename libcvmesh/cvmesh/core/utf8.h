// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include <string_view>

namespace cvmesh {

/// Whether the bytes are UTF-8 (RFC 3629): no overlong forms, surrogates or numbers beyond
/// U+10FFFF. XML and JSON files may hold nothing else.
[[nodiscard]] bool is_utf8(std::string_view text);

}  // namespace cvmesh
