// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/params/parameter_table.h"
#include "cvmesh/report/check_gates.h"
#include "cvmesh/report/report.h"
#include "cvmesh/report/report_json.h"

#include <nlohmann/json.hpp>

#include "support/catch.h"
#include <string>

using namespace cvmesh;

namespace {

Report measured_report() {
  Report report;
  report.label_of = {0, 4, 9};
  report.name_of = {"exterior", "a", "b"};
  report.volumes = {{}, {.relative_error = -0.04}, {.relative_error = 0.02}};
  report.quality.emplace();
  report.quality->tets.min_dihedral_deg.min = 8;
  report.quality->tets.max_dihedral_deg.max = 150;
  report.quality->tets.radius_ratio.min = 0.2;
  report.quality->tets.scaled_jacobian.min = 0.1;
  report.distances.emplace();
  return report;
}

}  // namespace

TEST_CASE("check_gates: none is checked unless it is set", "[report][unit]") {
  CHECK(check_gates(measured_report()).empty());
  CHECK(missed_gates_message({}).empty());
  CHECK_FALSE(report_json(measured_report())["results"].contains("gates"));
}

TEST_CASE("check_gates: every key of the table has a measure, and its bound itself passes",
          "[report][unit]") {
  Report report = measured_report();
  for (const auto& info : gate_table()) {
    INFO(info.key);
    report.parameters.gates = {};
    const ParameterField field = info.field(report.parameters.gates);
    if (auto* const* real = std::get_if<std::optional<double>*>(&field))
      **real = 1;
    else
      **std::get_if<std::optional<std::size_t>*>(&field) = 1;
    const auto first = check_gates(report);
    REQUIRE(first.size() == 1);
    CHECK(first[0].gate == info.key);
    if (auto* const* real = std::get_if<std::optional<double>*>(&field)) {
      **real = first[0].value;
      CHECK(check_gates(report)[0].passed);
    }
  }
}

TEST_CASE("check_gates: min bounds from below, max from above; volumes name the worst label",
          "[report][unit]") {
  Report report = measured_report();
  report.parameters.gates = {.min_dihedral_deg = 10,
                             .max_dihedral_deg = 160,
                             .min_tet_quality = {},
                             .min_scaled_jacobian = {},
                             .max_volume_error_percent = 3,
                             .max_distance_mm = {},
                             .max_distance_vox = {},
                             .max_mean_distance_mm = {},
                             .max_mean_distance_vox = {},
                             .max_kept_vertices = 0};
  const auto gates = check_gates(report);
  REQUIRE(gates.size() == 4);
  CHECK_FALSE(gates[0].passed);
  CHECK(gates[1].passed);
  CHECK_FALSE(gates[2].passed);
  CHECK(gates[2].value == Approx(4));
  CHECK(gates[2].label == 4);
  CHECK(gates[3].passed);

  const std::string message = missed_gates_message(gates);
  INFO(message);
  CHECK(message.find("2 of 4 gates missed: min_dihedral_deg is 8, below 10; "
                     "max_volume_error_percent is 4 (label 4), above 3;") == 0);
  report.gates = gates;
  const auto json = report_json(report)["results"]["gates"];
  CHECK(json[0]["gate"] == "min_dihedral_deg");
  CHECK(json[0]["bound"] == 10.0);
  CHECK(json[0]["passed"] == false);
  CHECK(json[2]["label"] == 4);
}

TEST_CASE("gates_of_tets: shapes and volumes need tets, distances do not", "[report][unit]") {
  QualityGates gates;
  gates.max_distance_vox = 1;
  gates.max_kept_vertices = 0;
  CHECK(gates_of_tets(gates).empty());
  gates.min_tet_quality = 0.1;
  gates.max_volume_error_percent = 1;
  CHECK(gates_of_tets(gates) ==
        std::vector<std::string>{"min_tet_quality", "max_volume_error_percent"});
}
