// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/pipeline/run_key.h"

#include "cvmesh/core/error.h"
#include "cvmesh/core/version.h"
#include "cvmesh/io/sha256.h"
#include "cvmesh/io/volume_reader.h"
#include "cvmesh/params/parse_parameters.h"
#include "cvmesh/pipeline/output_folder.h"
#include "cvmesh/pipeline/stage_names.h"
#include "cvmesh/report/report_json.h"

#include <nlohmann/json.hpp>

#include <fstream>
#include <span>
#include <string>

namespace cvmesh {
namespace {

/// Digests of all files that hold a volume.
std::string digests_of_volume(const std::filesystem::path& volume) {
  std::string digests;
  for (const std::filesystem::path& file : volume_files(volume))
    digests += sha256_of_file(file);
  return digests;
}

}  // namespace

std::string run_key(const RunRequest& request) {
  nlohmann::ordered_json asked = {
      {"version", kVersion},
      {"input", digests_of_volume(request.input)},
      {"sample", request.sample.empty() ? "" : digests_of_volume(request.sample)},
      {"parameters", parameters_to_json(request.parameters)},
      {"space", request.space ? space_name(*request.space) : ""},
      {"volume", request.read.volume.value_or(0)},
      {"options", {request.keep_stages, request.surface_only, request.html_report}}};
  for (const auto& [label, name] : request.label_names)
    asked["label_names"].push_back({label, name});
  for (const MeshFormat format : request.formats)
    asked["formats"].push_back(static_cast<int>(format));
  // Names may be any bytes.
  const std::string text =
      asked.dump(-1, ' ', true, nlohmann::ordered_json::error_handler_t::replace);
  return sha256_of_values(std::span<const char>(text));
}

bool is_finished(const RunRequest& request) {
  std::ifstream file(request.out_dir / (input_stem(request.input) + ".metrics.json"));
  if (!file) return false;
  const auto report = nlohmann::json::parse(file, nullptr, false);
  return report.is_object() && report.value(kRunKey, "") == run_key(request);
}

}  // namespace cvmesh
