// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/core/error.h"
#include "cvmesh/params/parse_parameters.h"

#include <nlohmann/json.hpp>

#include <cstdint>
#include <cstdlib>
#include <string>

using namespace cvmesh;
using Json = nlohmann::ordered_json;

/// Lines of the input: settings "key=value", until an empty line; the parameter file after it.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string text(reinterpret_cast<const char*>(data), size);
  std::vector<std::string> settings;
  std::size_t begin = 0;
  for (;;) {
    const std::size_t end = text.find('\n', begin);
    if (end == std::string::npos || end == begin) break;
    settings.push_back(text.substr(begin, end - begin));
    begin = end + 1;
  }
  const Json file =
      Json::parse(text.begin() + static_cast<std::ptrdiff_t>(begin), text.end(), nullptr, false);
  try {
    const Parameters parameters =
        parse_parameters(file.is_discarded() ? Json::object() : file, "'fuzz'", settings);
    // What was accepted is written as a file that means the same.
    const Json written = parameters_to_json(parameters);
    if (parameters_to_json(parse_parameters(written, "'written'", {})) != written) std::abort();
  } catch (const Error& error) {
    if (error.code() != ErrorCode::BadParameter || error.message().empty()) std::abort();
  }
  return 0;
}
