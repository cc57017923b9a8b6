// SPDX-License-Identifier: AGPL-3.0-or-later
#include "check_command.h"

#include "cvmesh/core/context.h"
#include "cvmesh/core/error.h"
#include "cvmesh/grid/shear.h"
#include "cvmesh/io/label_names.h"
#include "cvmesh/metrics/thinnest_parts.h"
#include "cvmesh/pipeline/forecast.h"
#include "cvmesh/pipeline/label_options.h"
#include "cvmesh/sizing/compute_sizing_field.h"

#include <nlohmann/json.hpp>
#include <spdlog/fmt/fmt.h>

#include <cmath>
#include <filesystem>
#include <iostream>
#include <utility>

namespace cvmesh::app {

namespace {

using Json = nlohmann::ordered_json;

/// Two digits: a forecast is not better than that.
double rounded(double value) {
  if (value <= 0) return 0;
  const int digits = 1 - static_cast<int>(std::floor(std::log10(value)));
  // Divided by a whole power of ten: 0.83 is not to become 0.8300000000000001.
  const double power = std::pow(10, std::abs(digits));
  return digits > 0 ? std::round(value * power) / power : std::round(value / power) * power;
}

struct Checked {
  GridFrame input;
  std::vector<std::string> warnings;
  CleanLabelsResult cleaned;
  std::vector<double> thinnest_mm;  ///< per material
  Forecast forecast;
};

Checked check(const CheckCommand& command, const Parameters& parameters, int threads) {
  Checked result;
  const InputVolume volume = read_label_volume(command.input, &result.warnings, command.read);
  result.input = volume.frame;
  CleanLabelsOptions cleaning = parameters.clean_labels;
  if (!command.label_names_file.empty())
    for (const auto& [label, name] : read_label_names(command.label_names_file))
      cleaning.names.try_emplace(label, name);
  result.cleaned = clean_labels(volume, cleaning, silent_context());
  for (std::string& warning : check_label_options(parameters, result.cleaned.labels))
    result.warnings.push_back(std::move(warning));
  result.thinnest_mm = thinnest_parts_mm(result.cleaned.labels);
  result.forecast = make_forecast(result.cleaned.labels, parameters, threads);
  if (result.forecast.surface_vertices > kMostVertices)
    result.warnings.push_back(fmt::format(
        "cvmesh mesh refuses more than {:.0e} surface vertices; raise epsilon or the bounds of the "
        "edge length, which are in mm",
        kMostVertices));
  return result;
}

Json labels_json(const Checked& checked) {
  const LabelVolume& labels = checked.cleaned.labels;
  const Vec3& s = checked.input.spacing_mm;
  Json rows = Json::array();
  for (const LabelAccount& account : checked.cleaned.stats.accounts) {
    Json row = {{"label", account.label},
                {"name", account.name},
                {"voxels", account.voxels_in},
                {"volume_mm3", static_cast<double>(account.voxels_in) * s.x * s.y * s.z},
                {"components", account.components_in},
                {"voxels_kept", account.voxels_kept}};
    if (const auto m = labels.material_of(account.label))
      row["thinnest_mm"] = checked.thinnest_mm[*m];
    rows.push_back(row);
  }
  return rows;
}

Json check_json(const CheckCommand& command, const Checked& checked, int threads) {
  const Forecast& forecast = checked.forecast;
  const Vec3& s = checked.input.spacing_mm;
  return {{"file", std::filesystem::path(command.input).filename().string()},
          {"dims", checked.input.dims},
          {"spacing_mm", {s.x, s.y, s.z}},
          {"space", space_name(checked.input.space)},
          {"shear", shear_of(checked.input.index_to_world)},
          {"warnings", checked.warnings},
          {"labels", labels_json(checked)},
          {"forecast",
           {{"dense_facets", forecast.dense_facets},
            {"surface_vertices", rounded(forecast.surface_vertices)},
            {"tets", rounded(forecast.tets)},
            {"memory_mb", rounded(forecast.memory_mb)},
            {"seconds", rounded(forecast.seconds)},
            {"threads", threads}}}};
}

std::string as_text(const Json& json) {
  std::string text = fmt::format(
      "{}: {} x {} x {} voxels of {:g} x {:g} x {:g} mm, {}\n", json["file"].get<std::string>(),
      json["dims"][0].get<int>(), json["dims"][1].get<int>(), json["dims"][2].get<int>(),
      json["spacing_mm"][0].get<double>(), json["spacing_mm"][1].get<double>(),
      json["spacing_mm"][2].get<double>(), json["space"].get<std::string>());
  for (const Json& warning : json["warnings"])
    text += "warning: " + warning.get<std::string>() + "\n";
  text += fmt::format("\n  {:>11} {:<24} {:>12} {:>14} {:>11} {:>13}\n", "label", "name", "voxels",
                      "volume, mm3", "components", "thinnest, mm");
  for (const Json& row : json["labels"])
    text += fmt::format(
        "  {:>11} {:<24} {:>12} {:>14.6g} {:>11} {:>13}\n", row["label"].get<Label>(),
        row["name"].get<std::string>(), row["voxels"].get<std::size_t>(),
        row["volume_mm3"].get<double>(), row["components"].get<std::size_t>(),
        row.contains("thinnest_mm") ? fmt::format("{:.3g}", row["thinnest_mm"].get<double>())
                                    : "not meshed");
  const Json& forecast = json["forecast"];
  text += fmt::format(
      "\nexpected: {:.0f} surface vertices, {:.0f} tets, {:.0f} MiB, {} s on {} threads\n",
      forecast["surface_vertices"].get<double>(), forecast["tets"].get<double>(),
      forecast["memory_mb"].get<double>(), forecast["seconds"].get<double>(),
      forecast["threads"].get<int>());
  return text;
}

}  // namespace

int run_check(const CheckCommand& command, const Parameters& parameters, int threads) {
  const Json json = check_json(command, check(command, parameters, threads), threads);
  std::cout << (command.as_json ? json.dump(2, ' ', false, Json::error_handler_t::replace) + "\n"
                                : as_text(json))
            << std::flush;
  require(std::cout.good(), ErrorCode::Output, "write", "standard output cannot be written");
  return 0;
}

}  // namespace cvmesh::app
