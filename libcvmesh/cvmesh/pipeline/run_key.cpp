// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/pipeline/run_key.h"

#include "cvmesh/core/error.h"
#include "cvmesh/core/version.h"
#include "cvmesh/io/sha256.h"
#include "cvmesh/io/volume_reader.h"
#include "cvmesh/params/parse_parameters.h"
#include "cvmesh/pipeline/output_folder.h"
#include "cvmesh/pipeline/stage_names.h"
#include "cvmesh/pipeline/write_results.h"
#include "cvmesh/report/report_json.h"

#include <nlohmann/json.hpp>

#include <filesystem>
#include <fstream>
#include <limits>
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

GateResult gate_from_json(const nlohmann::json& row) {
  const auto number = [&](const char* key) {
    const auto found = row.find(key);
    return found != row.end() && found->is_number() ? found->get<double>()
                                                    : std::numeric_limits<double>::quiet_NaN();
  };
  GateResult gate{.gate = row.value("gate", ""),
                  .bound = number("bound"),
                  .value = number("value"),
                  .passed = row.value("passed", false)};
  if (row.contains("label")) gate.label = row.at("label").get<Label>();
  return gate;
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

std::optional<std::vector<GateResult>> gates_if_finished(const RunRequest& request) {
  const std::string stem = (request.out_dir / input_stem(request.input)).string();
  std::ifstream file(stem + ".metrics.json");
  if (!file) return std::nullopt;
  const auto report = nlohmann::json::parse(file, nullptr, false);
  std::vector<GateResult> gates;
  try {
    if (!report.is_object() || report.value(kRunKey, "") != run_key(request)) return std::nullopt;
    for (const auto& row : report.at("results").value("gates", nlohmann::json::array()))
      gates.push_back(gate_from_json(row));
  } catch (const nlohmann::json::exception&) {
    return std::nullopt;  // a report that somebody has written in is none
  }
  std::vector<std::string> suffixes = mesh_suffixes(request);
  if (request.html_report) suffixes.emplace_back(".report.html");
  for (const std::string& suffix : suffixes)
    if (!std::filesystem::exists(stem + suffix)) return std::nullopt;
  return gates;
}

}  // namespace cvmesh
