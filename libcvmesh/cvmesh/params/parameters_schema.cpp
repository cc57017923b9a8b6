// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/params/parameters_schema.h"

#include "cvmesh/params/parameter_table.h"
#include "cvmesh/params/parse_parameters.h"

#include <nlohmann/json.hpp>

#include <array>
#include <cmath>
#include <limits>
#include <type_traits>

namespace cvmesh {

namespace {

using Json = nlohmann::ordered_json;

const char* type_name(const ParameterField& field) {
  return std::visit(
      [](auto* value) {
        using Value = std::remove_pointer_t<decltype(value)>;
        if constexpr (std::is_same_v<Value, bool>)
          return "boolean";
        else if constexpr (std::is_same_v<Value, int> || std::is_same_v<Value, std::size_t> ||
                           std::is_same_v<Value, std::optional<std::size_t>>)
          return "integer";
        else if constexpr (std::is_same_v<Value, double> ||
                           std::is_same_v<Value, std::optional<double>> ||
                           std::is_same_v<Value, std::optional<GridSpacing>>)
          return "number";
        else if constexpr (std::is_enum_v<Value> ||
                           std::is_same_v<Value, std::optional<std::string>>)
          return "string";
        else if constexpr (std::is_same_v<Value, std::vector<Label>> ||
                           std::is_same_v<Value, std::array<Label, 2>> ||
                           std::is_same_v<Value, VoxelBox> ||
                           std::is_same_v<Value, std::optional<VoxelBox>> ||
                           std::is_same_v<Value, std::vector<InterfaceParameters>> ||
                           std::is_same_v<Value, std::vector<BoxParameters>> ||
                           std::is_same_v<Value, std::vector<std::array<LabelReference, 2>>>)
          return "array";
        else
          return "object";
      },
      field);
}

/// Bounds as whole numbers where they are whole: 1e9 rather than 1000000000.0.
Json bound(double value) {
  return value == std::floor(value) && std::abs(value) < 1e16 ? Json(std::llround(value))
                                                              : Json(value);
}

template <typename Owner>
Json property(const ParameterInfo<Owner>& info) {
  Owner defaults;
  const std::string type = type_name(info.field(defaults));
  Json schema;
  schema["description"] = info.doc;
  if (!info.unit.empty()) schema["unit"] = info.unit;
  schema["type"] = info.is_optional ? Json{type, "null"} : Json(type);
  if (std::isfinite(info.min))
    schema[info.min_is_exclusive ? "exclusiveMinimum" : "minimum"] = bound(info.min);
  if (std::isfinite(info.max)) schema["maximum"] = bound(info.max);
  if (!info.choices.empty()) schema["enum"] = info.choices;
  if (type == "string" && info.choices.empty()) schema["minLength"] = 1;
  return schema;
}

/// An object whose keys `table` lists.
template <typename Owner>
Json entry_schema(const std::vector<ParameterInfo<Owner>>& table) {
  Json properties, required = Json::array();
  for (const ParameterInfo<Owner>& info : table) {
    properties[std::string(info.key)] = property(info);
    if (info.is_required) required.push_back(info.key);
  }
  properties["comment"] = {{"description", "Ignored."}};
  Json schema = {{"type", "object"}, {"properties", properties}, {"additionalProperties", false}};
  if (!required.empty()) schema["required"] = required;
  return schema;
}

Json label_value() {
  return {{"type", "integer"},
          {"minimum", std::numeric_limits<Label>::min()},
          {"maximum", std::numeric_limits<Label>::max()}};
}

/// Lets an array be the first and the last voxel of a box.
void fit_box(Json& schema) {
  schema["items"] = {
      {"type", "integer"}, {"minimum", 0}, {"maximum", std::numeric_limits<int>::max()}};
  schema["minItems"] = schema["maxItems"] = 6;
}

/// Lets an object have label values as keys, each with a value that fits `entry`.
void key_by_label(Json& schema, const Json& entry) {
  schema["patternProperties"] = {{"^-?[0-9]+$", entry}};
  schema["properties"] = {{"comment", {{"description", "Ignored."}}}};
  schema["additionalProperties"] = false;
}

}  // namespace

Json parameters_schema() {
  const Json defaults = parameters_to_json(Parameters{});
  Json properties;
  for (const ParameterInfo<Parameters>& info : parameter_table()) {
    const std::string key(info.key);
    properties[key] = property(info);
    properties[key]["default"] = defaults[key];
  }
  fit_box(properties["region_of_interest"]);
  properties["grid_spacing_mm"]["type"] = {"number", "string", "null"};
  properties["grid_spacing_mm"]["pattern"] = "^auto$";
  key_by_label(properties["merge_labels"],
               {{"type", "array"}, {"items", label_value()}, {"minItems", 1}});
  properties["drop_labels"]["items"] = label_value();
  properties["keep_labels"]["items"] = label_value();
  key_by_label(properties["labels"], entry_schema(label_parameter_table()));
  Json interface = entry_schema(interface_parameter_table());
  Json& pair = interface["properties"]["labels"];
  pair["items"] = label_value();
  pair["minItems"] = pair["maxItems"] = 2;
  pair["uniqueItems"] = true;
  properties["interfaces"]["items"] = interface;
  Json box = entry_schema(box_parameter_table());
  fit_box(box["properties"]["box"]);
  properties["boxes"]["items"] = box;
  properties["contact"]["items"] = {{"type", "array"},
                                    {"items", {{"type", {"integer", "string"}}}},
                                    {"minItems", 2},
                                    {"maxItems", 2},
                                    {"uniqueItems", true}};
  Json sample = entry_schema(sample_parameter_table());
  sample["properties"]["labels"]["items"] = label_value();
  properties["sample"].update(sample);
  properties["gates"].update(entry_schema(gate_table()));
  properties["comment"] = {{"description", "Ignored; for notes of any type."}};

  // How sparse the mesh is, in one way only.
  const std::array<const char*, 5> scales = {"epsilon", "target_vertices", "target_tets",
                                             "max_distance_mm", "max_distance_vox"};
  Json pairs = Json::array();
  for (std::size_t a = 0; a < scales.size(); ++a)
    for (std::size_t b = a + 1; b < scales.size(); ++b)
      pairs.push_back(
          {{"required", {scales[a], scales[b]}},
           {"properties", {{scales[a], {{"type", "number"}}}, {scales[b], {{"type", "number"}}}}}});
  return {{"$schema", "https://json-schema.org/draft/2020-12/schema"},
          {"$id", "urn:cvmesh:parameters"},
          {"title", "Parameters of cvmesh"},
          {"type", "object"},
          {"properties", properties},
          {"additionalProperties", false},
          {"not", {{"anyOf", pairs}}}};
}

}  // namespace cvmesh
