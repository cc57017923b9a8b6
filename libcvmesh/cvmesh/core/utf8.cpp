// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/core/utf8.h"

#include <cstddef>
#include <cstdint>

namespace cvmesh {
namespace {

/// What a first byte says of its character: bytes that follow, and the least number that needs
/// them.
struct Lead {
  std::size_t following = 0;
  std::uint32_t bits = 0, least = 0;
};

/// False for a byte that begins no character.
bool read_lead(unsigned char byte, Lead& lead) {
  if (byte < 0x80)
    lead = {0, byte, 0};
  else if (byte >> 5 == 0x06)
    lead = {1, byte & 0x1FU, 0x80};
  else if (byte >> 4 == 0x0E)
    lead = {2, byte & 0x0FU, 0x800};
  else if (byte >> 3 == 0x1E)
    lead = {3, byte & 0x07U, 0x10000};
  else
    return false;
  return true;
}

}  // namespace

bool is_utf8(std::string_view text) {
  for (std::size_t i = 0; i < text.size();) {
    Lead lead;
    if (!read_lead(static_cast<unsigned char>(text[i++]), lead)) return false;
    if (lead.following > text.size() - i) return false;
    std::uint32_t number = lead.bits;
    for (std::size_t end = i + lead.following; i < end; ++i) {
      const auto byte = static_cast<unsigned char>(text[i]);
      if (byte >> 6 != 0x02) return false;
      number = number << 6 | (byte & 0x3FU);
    }
    const bool is_surrogate = number >= 0xD800 && number <= 0xDFFF;
    if (number < lead.least || is_surrogate || number > 0x10FFFF) return false;
  }
  return true;
}

}  // namespace cvmesh
