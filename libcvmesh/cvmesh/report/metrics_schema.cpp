// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/report/metrics_schema.h"

#include "cvmesh/report/report_json.h"

#include <nlohmann/json.hpp>

#include <initializer_list>
#include <string>
#include <utility>

namespace cvmesh {

namespace {

using Json = nlohmann::ordered_json;
using Keys = std::initializer_list<std::pair<const char*, Json>>;

Json typed(const char* type) {
  return {{"type", type}};
}

Json described(Json schema, const char* description) {
  schema["description"] = description;
  return schema;
}

Json at_least_0(const char* type) {
  return {{"type", type}, {"minimum", 0}};
}

Json reference(const char* definition) {
  return {{"$ref", std::string("#/definitions/") + definition}};
}

Json array_of(Json items) {
  return {{"type", "array"}, {"items", std::move(items)}};
}

Json vector_of(Json items, int size) {
  Json array = array_of(std::move(items));
  array["minItems"] = size;
  array["maxItems"] = size;
  return array;
}

/// An object that must have the keys in `required` and may have those in `optional`; others only if
/// it is open.
Json object_of(const Keys& required, const Keys& optional = {}, bool is_open = false) {
  Json properties = Json::object(), names = Json::array();
  for (const auto& [key, schema] : required) {
    properties[key] = schema;
    names.push_back(key);
  }
  for (const auto& [key, schema] : optional)
    properties[key] = schema;
  return {{"type", "object"},
          {"required", names},
          {"properties", properties},
          {"additionalProperties", is_open}};
}

Json distribution() {
  const Json number = typed("number");
  return object_of({{"count", at_least_0("integer")},
                    {"mean", number},
                    {"standard_deviation", at_least_0("number")},
                    {"min", number},
                    {"max", number},
                    {"p1", number},
                    {"p5", number},
                    {"p25", number},
                    {"p50", number},
                    {"p75", number},
                    {"p95", number},
                    {"p99", number}});
}

Json distance_stats() {
  const Json length = at_least_0("number");
  const Json worst = described(
      object_of({{"position", vector_of(typed("number"), 3)}},
                {{"inside_label", typed("integer")}, {"outside_label", typed("integer")}}),
      "where max is, on the surface measured from, in input.output_space; and the labels there");
  return object_of(
      {{"max", described(length, "a distance that worst.position has")},
       {"max_error", described(length, "no point is farther away than max + max_error")},
       {"p95", described(length, "a twentieth of the area is farther away")},
       {"mean", length},
       {"mean_standard_error", length},
       {"rms", length},
       {"samples", described(at_least_0("integer"), "0: one of the surfaces is not there")}},
      {{"worst", worst}});
}

Json two_sided_distance() {
  const Json length = at_least_0("number");
  return object_of({{"mesh_to_reference", reference("distance_stats")},
                    {"reference_to_mesh", reference("distance_stats")},
                    {"hausdorff_lower_bound", length},
                    {"hausdorff_upper_bound", length},
                    {"mean_symmetric", length},
                    {"rms_symmetric", length}});
}

Json tet_quality() {
  const Json count = at_least_0("integer");
  return object_of({{"radius_ratio", reference("distribution")},
                    {"scaled_jacobian", reference("distribution")},
                    {"min_dihedral_deg", reference("distribution")},
                    {"max_dihedral_deg", reference("distribution")},
                    {"dihedral_histogram_10_deg", vector_of(count, 18)},
                    {"below_5_deg", count},
                    {"below_10_deg", count},
                    {"below_20_deg", count},
                    {"above_165_deg", count}});
}

Json quality() {
  return object_of({{"triangles", object_of({{"radius_ratio", reference("distribution")},
                                             {"min_angle_deg", reference("distribution")}})}},
                   {{"tets", reference("tet_quality")}});
}

Json distances() {
  const Json both = reference("surface_distance");
  const Json interface =
      object_of({{"inside_label", typed("integer")}, {"outside_label", typed("integer")}},
                {{"to_dense", both}, {"to_labels", both}, {"to_truth", both}});
  return object_of({{"to_labels", both},
                    {"interfaces", array_of(interface)},
                    {"samples_per_square_voxel", at_least_0("number")},
                    {"max_error_vox", at_least_0("number")}},
                   {{"to_dense", both}, {"to_truth", both}});
}

Json label_entry() {
  const Json count = at_least_0("integer"), both = reference("surface_distance");
  return object_of({{"label", typed("integer")},
                    {"name", typed("string")},
                    {"voxels_in", count},
                    {"voxels_kept", count},
                    {"components_in", count},
                    {"components_kept", count},
                    {"merged_into", {{"type", {"integer", "null"}}}},
                    {"is_dropped", typed("boolean")},
                    {"is_outside_region", typed("boolean")}},
                   {{"volume", object_of({{"voxels_mm3", at_least_0("number")},
                                          {"mesh_mm3", typed("number")},
                                          {"relative_error", typed("number")}})},
                    {"topology", typed("object")},
                    {"share_below_three_facets", at_least_0("number")},
                    {"particles", count},
                    {"tets", count},
                    {"surface_triangles", count},
                    {"distances", object_of({}, {{"to_dense", both}, {"to_labels", both}})},
                    {"quality", reference("quality")}},
                   true);
}

Json checks() {
  const Json yes = typed("boolean");
  return object_of({{"surface_is_valid", yes},
                    {"surface_intersections", at_least_0("integer")},
                    {"labels_are_complete", yes},
                    {"topology_as_lattice14", yes}},
                   {{"tets_are_valid", yes}, {"faults", array_of(typed("string"))}}, true);
}

Json results() {
  return object_of({{"labels", array_of(label_entry())}, {"stages", typed("object")}},
                   {{"exterior_label", typed("integer")},
                    {"particles", typed("object")},
                    {"interfaces", array_of(typed("object"))},
                    {"mesh", typed("object")},
                    {"quality", reference("quality")},
                    {"distances", distances()},
                    {"checks", checks()}},
                   true);
}

Json input() {
  const Json digest = {{"type", "string"}, {"pattern", "^([0-9a-f]{64})?$"}};
  return object_of({{"file", typed("string")},
                    {"dims", vector_of(at_least_0("integer"), 3)},
                    {"spacing_mm", vector_of(typed("number"), 3)},
                    {"space", typed("string")},
                    {"output_space", typed("string")},
                    {"labels", array_of(typed("integer"))},
                    {"file_sha256", described(digest, "of the file as it is stored")},
                    {"labels_sha256", described(digest,
                                                "of the labels as 32-bit little-endian integers, x "
                                                "fastest: the same for every file format")}});
}

Json timings() {
  const Json number = at_least_0("number");
  return object_of(
      {{"threads", at_least_0("integer")},
       {"total_seconds", number},
       {"peak_mb", number},
       {"stages", array_of(object_of(
                      {{"stage", typed("string")}, {"seconds", number}, {"peak_mb", number}}))}});
}

}  // namespace

Json metrics_schema() {
  Json schema = {{"$schema", "http://json-schema.org/draft-07/schema#"},
                 {"title", "Report of cvmesh"}};
  schema.update(
      object_of({{"cvmesh", described(typed("string"), "version of cvmesh")},
                 {"schema_version", {{"const", kReportSchemaVersion}}},
                 {"status", {{"enum", {"success", "failed"}}}},
                 {"libraries", {{"type", "object"}, {"additionalProperties", typed("string")}}},
                 {"input", input()},
                 {"parameters", typed("object")},
                 {"results", results()},
                 {"timings", timings()}},
                {{"judged_mesh", typed("object")},
                 {"stage", typed("string")},
                 {"code", typed("string")},
                 {"exit_code", typed("integer")},
                 {"message", typed("string")}},
                true));
  schema["definitions"] = {
      {"distribution", distribution()},
      {"distance_stats", distance_stats()},
      {"two_sided_distance", two_sided_distance()},
      {"surface_distance", object_of({{"mm", reference("two_sided_distance")},
                                      {"voxels", reference("two_sided_distance")}},
                                     {{"world_mm", reference("two_sided_distance")}})},
      {"tet_quality", tet_quality()},
      {"quality", quality()}};
  return schema;
}

}  // namespace cvmesh
