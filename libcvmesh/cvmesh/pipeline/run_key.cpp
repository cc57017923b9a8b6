// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/pipeline/run_key.h"

#include "cvmesh/core/error.h"
#include "cvmesh/core/sha256.h"
#include "cvmesh/core/version.h"
#include "cvmesh/io/volume_reader.h"
#include "cvmesh/params/parse_parameters.h"
#include "cvmesh/pipeline/output_folder.h"
#include "cvmesh/pipeline/stage_names.h"
#include "cvmesh/report/report_json.h"

#include <nlohmann/json.hpp>

#include <fstream>
#include <vector>

namespace cvmesh {
namespace {

constexpr std::size_t kBuffer = std::size_t{1} << 20;

/// Of all bytes that hold a volume.
std::string sha256_of_volume(const std::filesystem::path& volume) {
  Sha256 hash;
  std::vector<char> buffer(kBuffer);
  for (const std::filesystem::path& path : volume_files(volume)) {
    std::ifstream file(path, std::ios::binary);
    do {
      file.read(buffer.data(), static_cast<std::streamsize>(buffer.size()));
      hash.add({buffer.data(), static_cast<std::size_t>(file.gcount())});
    } while (file.good());
    require(file.eof(), ErrorCode::BadInput, stage_names::kRead,
            "'" + path.string() + "' cannot be read; check the path");
  }
  return hash.hex();
}

}  // namespace

std::string run_key(const RunRequest& request) {
  nlohmann::ordered_json asked = {
      {"version", kVersion},
      {"input", sha256_of_volume(request.input)},
      {"sample", request.sample.empty() ? "" : sha256_of_volume(request.sample)},
      {"parameters", parameters_to_json(request.parameters)},
      {"space", request.space ? space_name(*request.space) : ""},
      {"options", {request.keep_stages, request.surface_only}}};
  for (const auto& [label, name] : request.label_names)
    asked["label_names"].push_back({label, name});
  for (const MeshFormat format : request.formats)
    asked["formats"].push_back(static_cast<int>(format));
  Sha256 hash;
  // Names may be any bytes.
  hash.add(asked.dump(-1, ' ', true, nlohmann::ordered_json::error_handler_t::replace));
  return hash.hex();
}

bool is_finished(const RunRequest& request) {
  std::ifstream file(request.out_dir / (input_stem(request.input) + ".metrics.json"));
  if (!file) return false;
  const auto report = nlohmann::json::parse(file, nullptr, false);
  return report.is_object() && report.value(kRunKey, "") == run_key(request);
}

}  // namespace cvmesh
