// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/core/context.h"
#include "cvmesh/io/volume_reader.h"
#include "cvmesh/labels/clean_labels.h"
#include "cvmesh/pipeline/forecast.h"
#include "cvmesh/pipeline/pipeline.h"

#include "support/catch.h"
#include "support/phantoms.h"
#include "support/test_data.h"
#include "support/volume_file.h"
#include <algorithm>

using namespace cvmesh;

namespace {

Forecast forecast_of(const InputVolume& volume, const Parameters& parameters, int threads = 2) {
  return make_forecast(clean_labels(volume, parameters.clean_labels, silent_context()).labels,
                       parameters, threads);
}

/// What a run takes, without the tets, which change none of the figures looked at.
Report meshed(const std::filesystem::path& volume, const Parameters& parameters) {
  const test_data::TemporaryFolder folder;
  RunRequest request;
  request.input = volume;
  request.out_dir = folder.path();
  request.parameters = parameters;
  request.surface_only = true;
  return run_pipeline(request, silent_context()).report;
}

Parameters with_epsilon(double epsilon) {
  Parameters parameters;
  parameters.sizing.epsilon = epsilon;
  return parameters;
}

/// Larger over smaller.
double ratio(double a, double b) {
  return std::max(a / b, b / a);
}

}  // namespace

TEST_CASE("make_forecast: facets exactly, vertices within a factor of two",
          "[pipeline][property]") {
  const test_data::TemporaryFolder folder;
  for (const auto& [name, volume] : phantoms::all_small()) {
    write_volume_file(folder / "a.nii", volume);
    for (const double epsilon : {0.7, 1.0, 4.0}) {
      CAPTURE(name, epsilon);
      const Parameters parameters = with_epsilon(epsilon);
      const Forecast forecast = forecast_of(volume, parameters);
      const Report report = meshed(folder / "a.nii", parameters);
      CHECK(forecast.dense_facets == report.stages.dense_surfaces->facets);
      CAPTURE(forecast.surface_vertices, report.mesh->surface_vertices);
      CHECK(ratio(forecast.surface_vertices, static_cast<double>(report.mesh->surface_vertices)) <
            2);
    }
  }
}

TEST_CASE("bound_forecast: no forecast exceeds it", "[pipeline][property]") {
  for (const auto& [name, volume] : phantoms::all_small()) {
    const LabelVolume labels = clean_labels(volume, {}, silent_context()).labels;
    for (const double epsilon : {0.1, 1.0, 4.0}) {
      CAPTURE(name, epsilon);
      const Forecast bound = bound_forecast(labels, with_epsilon(epsilon), 2).value();
      const Forecast forecast = make_forecast(labels, with_epsilon(epsilon), 2);
      CHECK(forecast.dense_facets <= bound.dense_facets);
      CHECK(forecast.memory_mb <= bound.memory_mb);
      CHECK(forecast.seconds <= bound.seconds);
    }
  }
  Parameters resampled;
  resampled.grid_spacing_mm = GridSpacing{.is_auto = true};
  const LabelVolume labels =
      clean_labels(phantoms::nested_balls(6, 12), {}, silent_context()).labels;
  CHECK_FALSE(bound_forecast(labels, resampled, 2));
}

TEST_CASE("make_forecast: real volumes within a factor of two", "[pipeline][property]") {
  for (const char* name : {"cleaver_spheres.nii.gz", "rat_head.nii.gz"}) {
    const auto path = test_data::file(name);
    if (!path) {
      WARN("skipped: " << name << " is missing");
      continue;
    }
    for (const double epsilon : {1.0, 4.0}) {
      CAPTURE(name, epsilon);
      const Parameters parameters = with_epsilon(epsilon);
      const Forecast forecast = forecast_of(read_label_volume(*path), parameters);
      const Report report = meshed(*path, parameters);
      CHECK(ratio(forecast.surface_vertices, static_cast<double>(report.mesh->surface_vertices)) <
            2);
    }
  }
}

TEST_CASE("make_forecast: follows sizes, boxes, targets, threads and the working grid",
          "[pipeline][unit]") {
  const InputVolume volume = phantoms::nested_balls(6, 12);
  Parameters parameters;
  const Forecast plain = forecast_of(volume, parameters);

  parameters.sizing.max_edge_mm = 1;
  const double area = 4 * 3.14159 * (6 * 6 + 12 * 12);
  CHECK(ratio(forecast_of(volume, parameters).surface_vertices, 1.1547 * area) < 1.2);
  parameters = {};
  parameters.labels[1].epsilon = 0.25;  // the inner ball
  const double finer_core = forecast_of(volume, parameters).surface_vertices;
  CHECK(finer_core > 1.5 * plain.surface_vertices);
  parameters = {};
  parameters.boxes.push_back({.box = {{0, 0, 0}, {14, 34, 34}}, .max_edge_mm = 1});
  const double finer_box = forecast_of(volume, parameters).surface_vertices;
  CHECK(finer_box > 1.5 * plain.surface_vertices);
  CHECK(finer_box < 1.1547 * area);

  parameters = {};
  parameters.target_vertices = 5000;
  const Forecast target = forecast_of(volume, parameters);
  CHECK(target.surface_vertices == 5000);
  CHECK(target.seconds > plain.seconds);
  CHECK(forecast_of(volume, {}, 4).seconds < plain.seconds);

  InputVolume slices = phantoms::nested_balls(6, 12, {0.5, 0.5, 2});
  parameters = {};
  parameters.grid_spacing_mm = GridSpacing{.mm = 0.5};
  const std::size_t coarse = forecast_of(slices, parameters).dense_facets;
  parameters.grid_spacing_mm = GridSpacing{.mm = 0.25};
  CHECK(forecast_of(slices, parameters).dense_facets > 3 * coarse);
}
