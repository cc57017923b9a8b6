// SPDX-License-Identifier: AGPL-3.0-or-later
#include <nlohmann/json.hpp>

#include "support/catch.h"
#include "support/phantoms.h"
#include "support/run_cli.h"
#include "support/test_data.h"
#include "support/volume_file.h"
#include <cstdlib>
#include <fstream>

using namespace cvmesh;
using Catch::Contains;
using Json = nlohmann::json;

namespace {

Json json_of(const std::filesystem::path& path) {
  std::ifstream file(path);
  return Json::parse(file);
}

}  // namespace
