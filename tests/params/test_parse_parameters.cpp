// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/core/error.h"
#include "cvmesh/io/json_io.h"
#include "cvmesh/params/parameter_table.h"
#include "cvmesh/params/parameters_schema.h"
#include "cvmesh/params/parse_parameters.h"

#include <nlohmann/json.hpp>

#include "support/catch.h"
#include <array>
#include <filesystem>
#include <string>

using namespace cvmesh;
using Json = nlohmann::ordered_json;

namespace {

Parameters parse(const char* text, const std::vector<std::string>& settings = {}) {
  return parse_parameters(Json::parse(text), "p.json", settings);
}

/// The message of the error that parsing gives; empty when there is none.
std::string refusal(const char* text, const std::vector<std::string>& settings = {}) {
  try {
    parse(text, settings);
  } catch (const Error& error) {
    CHECK(error.code() == ErrorCode::BadParameter);
    return error.what();
  }
  return {};
}

}  // namespace

TEST_CASE("parse_parameters: an empty object gives the defaults of the structs", "[params][unit]") {
  const Parameters parameters = parse("{}");
  CHECK(parameters.tighten.r_vox == 0.8);
  CHECK(parameters.sizing.epsilon == 1.0);
  CHECK(parameters.sizing.delta == 0.4);
  CHECK(parameters.seed == 1);
  CHECK(parameters.clean_labels.min_island_voxels == 1);
  CHECK_FALSE(parameters.target_vertices);
  CHECK(parameters.schedule == Schedule::LockStep);
  CHECK(parameters_to_json(parameters) == parameters_to_json(Parameters{}));
}

TEST_CASE("parse_parameters: each key reaches its stage", "[params][unit]") {
  const Parameters p = parse(R"({
    "comment": ["ignored", {"a": 1}], "r": 0.5, "epsilon": 2, "delta": 0.3, "seed": 7,
    "min_island_voxels": 10, "min_hole_voxels": 4, "mesh_background": true,
    "region_of_interest": [1, 2, 3, 40, 50, 6e1],
    "merge_labels": {"2": [4, 3, 4], "-7": [8], "comment": "x"}, "drop_labels": [5, -2, 5],
    "labels": {"2": {"name": "bone", "r": 2, "epsilon": 0.5, "max_edge_mm": 3, "comment": 0},
               "comment": "x"},
    "interfaces": [{"labels": [2, 0], "epsilon": 0.25, "comment": 1},
                   {"labels": [-7, 2], "min_edge_mm": 0.5, "max_edge_mm": 2}],
    "boxes": [{"box": [1, 2, 3, 4, 5, 6], "epsilon": 0.5, "comment": 1},
              {"box": [0, 0, 0, 0, 0, 0], "max_edge_mm": 2}],
    "grid_spacing_mm": "auto", "min_edge_mm": 0.5, "max_edge_mm": null, "seeding": "dense", "target_sizes": "feature_size", "particle_sweeps": 4e1,
    "schedule": "sequential", "deviation_vox": 0.4, "fit_vox": 0.1, "on_degenerate": "fail", "flip_passes": 3, "interior_growth": 0,
    "tetgen_memory_limit_mb": 512})");
  CHECK(p.tighten.r_vox == 0.5);
  CHECK(p.sizing.epsilon == 2);
  CHECK(p.sizing.delta == 0.3);
  CHECK(p.seed == 7);
  CHECK(p.clean_labels.min_island_voxels == 10);
  CHECK(p.clean_labels.min_hole_voxels == 4);
  CHECK(p.clean_labels.mesh_background);
  CHECK(p.clean_labels.region_of_interest == VoxelBox{{1, 2, 3}, {40, 50, 60}});
  CHECK(p.clean_labels.merge_labels == std::map<Label, std::vector<Label>>{{-7, {8}}, {2, {3, 4}}});
  CHECK(p.clean_labels.drop_labels == std::vector<Label>{-2, 5});
  CHECK(p.clean_labels.names.at(2) == "bone");
  CHECK(p.grid_spacing_mm == GridSpacing{.is_auto = true, .mm = 0});
  CHECK(p.labels.at(2).r == 2.0);
  CHECK(p.labels.at(2).epsilon == 0.5);
  CHECK(p.labels.at(2).max_edge_mm == 3.0);
  CHECK_FALSE(p.labels.at(2).min_edge_mm);
  REQUIRE(p.interfaces.size() == 2);
  CHECK(p.interfaces[0].labels == std::array<Label, 2>{2, 0});
  CHECK(p.interfaces[0].epsilon == 0.25);
  CHECK_FALSE(p.interfaces[0].max_edge_mm);
  CHECK(p.interfaces[1].labels == std::array<Label, 2>{-7, 2});
  CHECK(p.interfaces[1].min_edge_mm == 0.5);
  CHECK(p.interfaces[1].max_edge_mm == 2.0);
  REQUIRE(p.boxes.size() == 2);
  CHECK(p.boxes[0].box == VoxelBox{{1, 2, 3}, {4, 5, 6}});
  CHECK(p.boxes[0].epsilon == 0.5);
  CHECK(p.boxes[1].max_edge_mm == 2.0);
  CHECK_FALSE(p.boxes[1].epsilon);
  CHECK(p.sizing.min_edge_mm == 0.5);
  CHECK_FALSE(p.sizing.max_edge_mm);
  CHECK(p.seed_particles.seeding == Seeding::Dense);
  CHECK(p.target_sizes == TargetSizes::FeatureSize);
  CHECK(p.distribute_particles.max_sweeps == 40);
  CHECK(p.schedule == Schedule::Sequential);
  CHECK(p.deviation_vox == 0.4);
  CHECK(p.fit_vertices.max_shift_vox == 0.1);
  CHECK(p.decimate.on_degenerate == OnDegenerate::Fail);
  CHECK(p.flip_edges.max_passes == 3);
  CHECK(p.tetrahedralize.interior_growth == 0);
  CHECK(p.tetrahedralize.memory_limit_mb == 512);
}

TEST_CASE("parse_parameters: messages name file, key, value, bound and way out", "[params][unit]") {
  CHECK(refusal(R"({"epsilom": 1})") ==
        "parameters: p.json: unknown key \"epsilom\"; did you mean \"epsilon\"? `cvmesh schema` "
        "lists all keys");
  CHECK(
      refusal(R"({"epsilon": -1})") ==
      "parameters: p.json: epsilon (-1) must be greater than 0; raise it, or leave it out for the "
      "default");
  CHECK(refusal(R"({"epsilon": 0})") != "");
  CHECK(
      refusal(R"({"r": 100})") ==
      "parameters: p.json: r (100) must be at most 20; lower it, or leave it out for the default");
  CHECK(refusal(R"({"r": "0.8"})") == "parameters: p.json: r (\"0.8\") is a string; give a number");
  CHECK(refusal(R"({"max_edge_mm": true})") ==
        "parameters: p.json: max_edge_mm (true) is a boolean; give a number, or null for \"not "
        "set\"");
  CHECK(refusal(R"({"r": null})") == "parameters: p.json: r (null) is null; give a number");
  CHECK(refusal(R"({"seed": 1.5})") ==
        "parameters: p.json: seed (1.5) must be a whole number; round it");
  CHECK(refusal(R"({"min_island_voxels": 0})") ==
        "parameters: p.json: min_island_voxels (0) must be at least 1; raise it, or leave it out "
        "for the default");
  CHECK(refusal(R"({"mesh_background": 1})") ==
        "parameters: p.json: mesh_background (1) is a number; give true or false");
  CHECK(refusal(R"({"seeding": "random"})") ==
        "parameters: p.json: seeding (\"random\") is not one of its values; give \"front\" or "
        "\"dense\"");
  CHECK(refusal(R"({"schedule": "parallel"})") ==
        "parameters: p.json: schedule (\"parallel\") is not one of its values; give \"lock-step\" "
        "or \"sequential\"");
  CHECK(refusal(R"({"curved_elements": true})").find("set element_order to 2") !=
        std::string::npos);
  CHECK(refusal(R"({"drop_labels": 3})") ==
        "parameters: p.json: drop_labels (3) is a number; give an array of label values, like [1, "
        "2]");
  CHECK(refusal(R"({"drop_labels": [3e10]})").find("must be at most") != std::string::npos);
  CHECK(refusal(R"({"min_hole_voxels": -1})").find("must be at least 0") != std::string::npos);
  CHECK(refusal(R"({"region_of_interest": [0, 0, 0, 9]})") ==
        "parameters: p.json: region_of_interest ([0,0,0,9]) has 4 numbers rather than 6; give the "
        "first and the last voxel, like [0, 0, 0, 63, 63, 31]");
  CHECK(refusal(R"({"region_of_interest": 5})") ==
        "parameters: p.json: region_of_interest (5) is a number; give the first and the last "
        "voxel, like [0, 0, 0, 63, 63, 31], or null for \"not set\"");
  CHECK(refusal(R"({"region_of_interest": [0, 0, -1, 9, 9, 9]})") ==
        "parameters: p.json: region_of_interest (-1) must be at least 0; raise it, or leave it out "
        "for the default");
  CHECK(refusal(R"({"region_of_interest": [0, 0, 0, 9, 9, 3e9]})").find("must be at most") !=
        std::string::npos);
  CHECK(refusal(R"({"region_of_interest": [0, 0, 0, 9, 9, 1.5]})").find("whole number") !=
        std::string::npos);
  CHECK(refusal(R"({"merge_labels": [2, 3]})") ==
        "parameters: p.json: merge_labels ([2,3]) is an array; give an object keyed by label "
        "value");
  CHECK(refusal(R"({"merge_labels": {"2": 3}})") ==
        "parameters: p.json: merge_labels.2 (3) is a number; give an array of label values, like "
        "[1, 2]");
  CHECK(refusal(R"({"merge_labels": {"bone": [3]}})").find("merge_labels key \"bone\" is not") !=
        std::string::npos);
  CHECK(refusal(R"({"labels": {"bone": {}}})") ==
        "parameters: p.json: labels key \"bone\" is not a label value; use the whole number that "
        "the label has in the volume, like \"2\"");
  CHECK(refusal(R"({"labels": {"2": 0.5}})") ==
        "parameters: p.json: labels.2 (0.5) is a number; give an object like {\"epsilon\": 0.5}");
  CHECK(refusal(R"({"labels": {"2": {"epsilo": 1}}})") ==
        "parameters: p.json: unknown key \"labels.2.epsilo\"; did you mean \"labels.2.epsilon\"? "
        "`cvmesh schema` lists all keys");
  CHECK(refusal(R"({"labels": {"2": {"epsilon": -1}}})").find("labels.2.epsilon (-1)") !=
        std::string::npos);
  CHECK(refusal(R"({"interfaces": {"1": {}}})") ==
        "parameters: p.json: interfaces ({\"1\":{}}) is an object; give an array of objects like "
        "{\"labels\": [1, 2], \"epsilon\": 0.5}");
  CHECK(refusal(R"({"interfaces": [[1, 2]]})") ==
        "parameters: p.json: interfaces[0] ([1,2]) is an array; give an object like {\"labels\": "
        "[1, 2], \"epsilon\": 0.5}");
  CHECK(refusal(R"({"interfaces": [{"labels": [1, 2]}, {"epsilon": 1}]})") ==
        "parameters: p.json: interfaces[1] ({\"epsilon\":1}) has no key \"labels\"; write it like "
        "{\"labels\": [1, 2], \"epsilon\": 0.5}");
  CHECK(refusal(R"({"interfaces": [{"labels": [1, 2], "epsilo": 1}]})") ==
        "parameters: p.json: unknown key \"interfaces[0].epsilo\"; did you mean "
        "\"interfaces[0].epsilon\"? `cvmesh schema` lists all keys");
  CHECK(refusal(R"({"interfaces": [{"labels": [1, 2, 3]}]})") ==
        "parameters: p.json: interfaces[0].labels ([1,2,3]) has 3 labels rather than 2; give the "
        "two labels that meet, like [1, 2]");
  CHECK(refusal(R"({"interfaces": [{"labels": 1}]})") ==
        "parameters: p.json: interfaces[0].labels (1) is a number; give the two labels that meet, "
        "like [1, 2]");
  CHECK(refusal(R"({"interfaces": [{"labels": [1, 2], "epsilon": 0}]})") ==
        "parameters: p.json: interfaces[0].epsilon (0) must be greater than 0; raise it, or leave "
        "it out for the default");
  CHECK(refusal(R"({"boxes": [{"box": [1, 2, 3, 4, 5]}]})") ==
        "parameters: p.json: boxes[0].box ([1,2,3,4,5]) has 5 numbers rather than 6; give the "
        "first and the last voxel, like [0, 0, 0, 63, 63, 31]");
  CHECK(refusal(R"({"boxes": [{"box": [1, 2, 3, 4, 1, 6]}]})") ==
        "parameters: p.json: boxes[0].box begins at j = 2 and ends at j = 1; give the first "
        "voxel, then the last");
  CHECK(refusal(R"({"boxes": [{"max_edge_mm": 2}]})").find("has no key \"box\"") !=
        std::string::npos);
  CHECK(refusal(R"({"boxes": [{"box": null}]})").find("boxes[0].box (null) is null") !=
        std::string::npos);
  CHECK(refusal(R"({"boxes": [{"box": [1, 2, 3, 4, 5, 6], "min_edge_mm": 2, "max_edge_mm": 1}]})")
            .find("boxes[0].min_edge_mm (2) exceeds boxes[0].max_edge_mm (1)") !=
        std::string::npos);
  CHECK(refusal(R"([1])") ==
        "parameters: p.json: holds an array; a parameter file is one JSON object, like "
        "{\"epsilon\": 2}");
}

TEST_CASE("parse_parameters: an interface is named once, by two labels", "[params][unit]") {
  CHECK(refusal(R"({"interfaces": [{"labels": [2, 2]}]})") ==
        "parameters: p.json: interfaces[0].labels ([2, 2]) names one label twice; give the two "
        "labels that meet");
  CHECK(
      refusal(R"({"interfaces": [{"labels": [3, 2]}, {"labels": [4, 2]}, {"labels": [2, 3]}]})") ==
      "parameters: p.json: interfaces[2].labels ([2, 3]) names the labels of interfaces[0] "
      "again; make one entry of the two");
}

TEST_CASE("parse_parameters: an empty lower bound stays below its upper bound", "[params][unit]") {
  CHECK(refusal(R"({"min_edge_mm": 2.5, "max_edge_mm": 2})") ==
        "parameters: p.json: min_edge_mm (2.5) exceeds max_edge_mm (2); lower min_edge_mm");
  // A label inherits what it does not set.
  CHECK(refusal(R"({"max_edge_mm": 2, "labels": {"1": {"min_edge_mm": 3}}})") ==
        "parameters: p.json: labels.1.min_edge_mm (3) exceeds labels.1.max_edge_mm (2); lower "
        "labels.1.min_edge_mm");
  CHECK(refusal(R"({"labels": {"1": {"max_edge_mm": 2}},
                    "interfaces": [{"labels": [0, 1], "min_edge_mm": 3}]})") ==
        "parameters: p.json: interfaces[0].min_edge_mm (3) exceeds interfaces[0].max_edge_mm (2); "
        "lower interfaces[0].min_edge_mm");
  // The exterior has no size of its own that could be in the way.
  CHECK_NOTHROW(parse(R"({"max_edge_mm": 2, "labels": {"1": {"max_edge_mm": 9}},
                          "interfaces": [{"labels": [0, 1], "min_edge_mm": 3}]})"));
}

TEST_CASE("parse_parameters: epsilon and target_vertices exclude each other", "[params][unit]") {
  CHECK(refusal(R"({"epsilon": 2, "target_vertices": 500})") ==
        "parameters: p.json: epsilon (2) and target_vertices (500) exclude each other; set one of "
        "them to null");
  CHECK(refusal(R"({"target_tets": 9000, "max_distance_vox": 0.5})") ==
        "parameters: p.json: target_tets (9000) and max_distance_vox (0.5) exclude each other; set "
        "one of them to null");
  CHECK(parse(R"({"max_distance_mm": 0.5})").max_distance_mm == 0.5);
  CHECK_FALSE(parse(R"({"max_distance_mm": 0.5})", {"target_tets=900"}).max_distance_mm);
  CHECK(parse(R"({"epsilon": null, "target_vertices": 500})").target_vertices == 500U);
  CHECK(parse(R"({"epsilon": 2, "target_vertices": null})").sizing.epsilon == 2);
}

TEST_CASE("parse_parameters: settings that are no UTF-8 are refused, not fatal", "[params][unit]") {
  for (const char* setting : {"boxes=[{\"box\":[0,0,0,1,1,1],\"epsilon\xff\":1}]", "epsilon=\xff",
                              "\xff=1", "labels.\xff.epsilon=1", "seeding=\xff\xfe"}) {
    CAPTURE(setting);
    CHECK(refusal("{}", {setting}).find("parameters: --set: ") != std::string::npos);
  }
}

TEST_CASE("parse_parameters: settings override the file", "[params][unit]") {
  CHECK(parse(R"({"epsilon": 2})", {"epsilon=3", "epsilon=4"}).sizing.epsilon == 4);
  CHECK(parse("{}", {"seeding=dense"}).seed_particles.seeding == Seeding::Dense);
  CHECK(parse("{}", {"drop_labels=[1,2]"}).clean_labels.drop_labels.size() == 2);
  CHECK_FALSE(parse(R"({"region_of_interest": [0, 0, 0, 9, 9, 9]})", {"region_of_interest=null"})
                  .clean_labels.region_of_interest);
  // The command line asks for the other way of sizing: the file's gives way.
  CHECK(parse(R"({"epsilon": 2})", {"target_vertices=500"}).target_vertices == 500U);
  CHECK_FALSE(parse(R"({"target_vertices": 500})", {"epsilon=2"}).target_vertices);
  CHECK(refusal("{}", {"epsilon=2", "target_vertices=500"}).find("--set: epsilon (2) and") !=
        std::string::npos);

  const Parameters p = parse(R"({"labels": {"2": {"name": "bone", "epsilon": 1}}})",
                             {"labels.2.epsilon=0.5", "labels.3.name=muscle"});
  CHECK(p.labels.at(2).name == "bone");
  CHECK(p.labels.at(2).epsilon == 0.5);
  CHECK(p.labels.at(3).name == "muscle");

  // Gates, too, are set one by one; null takes one away.
  const Parameters gated = parse(R"({"gates": {"min_dihedral_deg": 5, "max_distance_mm": 1}})",
                                 {"gates.min_tet_quality=0.1", "gates.max_distance_mm=null"});
  CHECK(gated.gates.min_dihedral_deg == 5.0);
  CHECK(gated.gates.min_tet_quality == 0.1);
  CHECK_FALSE(gated.gates.max_distance_mm);
  CHECK(
      refusal("{}", {"gates.min_angle=5"}).find("unknown key \"gates.min_angle\"; did you mean") !=
      std::string::npos);

  CHECK(refusal("{}", {"epsilon"}) ==
        "parameters: --set: \"epsilon\" is not of the form key=value");
  CHECK(refusal("{}", {"labels.2.name=kn\xF6"
                       "chern"})
            .find("is no UTF-8") != std::string::npos);
  for (const auto& [whole, part] : {std::pair{"labels=[3]", "labels.2.epsilon=1"},
                                    {"labels={\"2\":5}", "labels.2.epsilon=1"},
                                    {"gates=7", "gates.min_dihedral_deg=5"}})
    CHECK(refusal("{}", {whole, part}) != "");
  CHECK(refusal("{}", {"labels=[3]", "labels.2.epsilon=1"})
            .find("\"labels.2.epsilon\" cannot be set in [3]") != std::string::npos);
  CHECK(refusal("{}", {"label.2.epsilon=1"}).find("names no key") != std::string::npos);
  CHECK(refusal("{}", {"epsilon=-1"}).find("--set: epsilon (-1)") != std::string::npos);
}

TEST_CASE("parse_parameters: gates have bounds of their own, in their units", "[params][unit]") {
  const Parameters p = parse(R"({"gates": {"max_dihedral_deg": 160, "max_volume_error_percent": 2,
      "max_kept_vertices": 0, "comment": "x"}})");
  CHECK(p.gates.max_dihedral_deg == 160.0);
  CHECK(p.gates.max_volume_error_percent == 2.0);
  CHECK(p.gates.max_kept_vertices == 0U);
  CHECK_FALSE(p.gates.min_dihedral_deg);
  CHECK(refusal(R"({"gates": {"min_dihedral_deg": 200}})")
            .find("gates.min_dihedral_deg (200) must be at most 180") != std::string::npos);
  CHECK(refusal(R"({"gates": {"max_kept_vertices": 0.5}})").find("must be a whole number") !=
        std::string::npos);
  CHECK(refusal(R"({"gates": [1]})").find("give an object like {\"min_dihedral_deg\": 10}") !=
        std::string::npos);
}

TEST_CASE("parse_parameters: the Delaunay surface goes without what needs the dense one",
          "[params][unit]") {
  CHECK(parse(R"({"surface": "delaunay", "target_vertices": 500})").surface ==
        SurfaceMethod::Delaunay);
  for (const char* other : {R"("max_distance_vox": 1)", R"("max_distance_mm": 1)",
                            R"("element_order": 2)", R"("schedule": "sequential")"}) {
    const std::string message =
        refusal((std::string(R"({"surface": "delaunay", )") + other + "}").c_str());
    INFO(message);
    CHECK(message.find("surface (\"delaunay\") does not go with ") != std::string::npos);
  }
}

TEST_CASE("parameters_to_json: gives a file that parses to the same parameters", "[params][unit]") {
  const Parameters p = parse(R"({"target_vertices": 500, "labels": {"-3": {"name": "a"}},
    "region_of_interest": [1, 2, 3, 4, 5, 6], "merge_labels": {"2": [4, 3]},
    "interfaces": [{"labels": [3, -3], "epsilon": 2}],
    "boxes": [{"box": [1, 2, 3, 4, 5, 6], "min_edge_mm": 2}],
    "gates": {"min_tet_quality": 0.25}})");
  const Json json = parameters_to_json(p);
  CHECK(json["epsilon"].is_null());
  CHECK(json["region_of_interest"] == Json({1, 2, 3, 4, 5, 6}));
  CHECK(json["merge_labels"] == Json({{"2", {3, 4}}}));
  CHECK(json["interfaces"][0]["labels"] == Json({3, -3}));
  CHECK(json["interfaces"][0]["epsilon"] == 2.0);
  CHECK(json["interfaces"][0]["max_edge_mm"].is_null());
  CHECK(json["boxes"][0]["box"] == Json({1, 2, 3, 4, 5, 6}));
  CHECK(json["boxes"][0]["min_edge_mm"] == 2.0);
  CHECK(json["gates"]["min_tet_quality"] == 0.25);
  CHECK(json["gates"]["max_distance_mm"].is_null());
  CHECK(parameters_to_json(parse_parameters(json, "again")) == json);
}

TEST_CASE("configs: default.json holds every key with its default", "[params][unit]") {
  Json file = read_json(std::filesystem::path(CVMESH_SOURCE_DIR) / "configs" / "default.json");
  file.erase("comment");
  CHECK(file == parameters_to_json(Parameters{}));
}

TEST_CASE("configs: every file parses and names every key", "[params][unit]") {
  const std::filesystem::path folder = std::filesystem::path(CVMESH_SOURCE_DIR) / "configs";
  int files = 0;
  for (const auto& entry : std::filesystem::directory_iterator(folder)) {
    INFO(entry.path());
    const Json file = read_json(entry.path());
    CHECK_NOTHROW(parse_parameters(file, entry.path().filename().string()));
    for (const auto& info : parameter_table())
      CHECK(file.contains(std::string(info.key)));
    ++files;
  }
  CHECK(files >= 5);
}

TEST_CASE("parameters_schema: describes each key of the table with its default", "[params][unit]") {
  const Json schema = parameters_schema();
  CHECK(schema["$schema"] == "https://json-schema.org/draft/2020-12/schema");
  CHECK(schema["additionalProperties"] == false);
  const Json defaults = parameters_to_json(Parameters{});
  for (const auto& info : parameter_table()) {
    INFO(info.key);
    const Json& property = schema["properties"][std::string(info.key)];
    CHECK(property["description"].get<std::string>().size() > 10);
    CHECK(property["default"] == defaults[std::string(info.key)]);
    const bool allows_null = property["type"].is_array();
    CHECK(allows_null == info.is_optional);
  }
  CHECK(schema["properties"].size() == parameter_table().size() + 1);  // and "comment"
  CHECK(schema["properties"]["epsilon"]["exclusiveMinimum"] == 0);
  CHECK(schema["properties"]["seeding"]["enum"] == Json({"front", "dense"}));
  CHECK(schema["properties"]["schedule"]["enum"] == Json({"lock-step", "sequential"}));
  const Json& gates = schema["properties"]["gates"];
  CHECK(gates["type"] == "object");
  CHECK(gates["additionalProperties"] == false);
  CHECK(gates["properties"]["max_distance_vox"]["type"] == Json({"number", "null"}));
  CHECK(gates["properties"].size() == gate_table().size() + 1);  // and "comment"
  for (const auto& info : gate_table()) {
    INFO(info.key);
    CHECK(gates["properties"][std::string(info.key)]["description"].get<std::string>().back() ==
          '.');
  }
  CHECK_NOTHROW(schema.dump());  // all texts are UTF-8
  const Json& region = schema["properties"]["region_of_interest"];
  CHECK(region["type"] == Json({"array", "null"}));
  CHECK(region["minItems"] == 6);
  CHECK(region["maxItems"] == 6);
  CHECK(region["items"]["minimum"] == 0);
  const Json& merges = schema["properties"]["merge_labels"];
  CHECK(merges["additionalProperties"] == false);
  CHECK(merges["patternProperties"]["^-?[0-9]+$"]["items"]["type"] == "integer");
  const Json& interface = schema["properties"]["interfaces"]["items"];
  CHECK(interface["required"] == Json::array({"labels"}));
  CHECK(interface["additionalProperties"] == false);
  CHECK(interface["properties"]["labels"]["minItems"] == 2);
  CHECK(interface["properties"]["labels"]["items"]["type"] == "integer");
  CHECK(interface["properties"]["epsilon"]["exclusiveMinimum"] == 0);
  const Json& box = schema["properties"]["boxes"]["items"];
  CHECK(box["required"] == Json::array({"box"}));
  CHECK(box["properties"]["box"]["minItems"] == 6);
  CHECK(box["properties"]["max_edge_mm"]["type"] == Json({"number", "null"}));
}

TEST_CASE("parse_parameters: grid_spacing_mm is a length, \"auto\" or nothing", "[params][unit]") {
  CHECK_FALSE(parse(R"({"grid_spacing_mm": null})").grid_spacing_mm);
  CHECK(parse(R"({"grid_spacing_mm": 0.7})").grid_spacing_mm ==
        GridSpacing{.is_auto = false, .mm = 0.7});
  CHECK(
      refusal(R"({"grid_spacing_mm": "fine"})") ==
      "parameters: p.json: grid_spacing_mm (\"fine\") is a string; give a number, or \"auto\", or "
      "null for \"not set\"");
  CHECK(refusal(R"({"grid_spacing_mm": 0})").find("must be greater than 0") != std::string::npos);
  for (const char* text : {R"({"grid_spacing_mm": "auto"})", R"({"grid_spacing_mm": 0.7})"}) {
    const Parameters p = parse(text);
    CHECK(parse(parameters_to_json(p).dump().c_str()).grid_spacing_mm == p.grid_spacing_mm);
  }
}

TEST_CASE("parse_parameters: contact names labels by value or name", "[params][unit]") {
  const Parameters p = parse(R"({"contact": [["stem", "cement"], [3, -4], [1, "1"]]})");
  REQUIRE(p.contact.size() == 3);
  CHECK(std::get<std::string>(p.contact[0][1]) == "cement");
  CHECK(std::get<Label>(p.contact[1][1]) == -4);
  CHECK(parse(parameters_to_json(p).dump().c_str()).contact == p.contact);
  for (const char* text : {R"({"contact": ["stem", "cement"]})", R"({"contact": [[1, 2, 3]]})",
                           R"({"contact": {"1": 2}})", R"({"contact": [[1, 1.5]]})"})
    CHECK(refusal(text).find("contact") != std::string::npos);
  CHECK(refusal(R"({"contact": [[2, 2]]})").find("names one label twice") != std::string::npos);
}

TEST_CASE("parse_parameters: the laws of a sample need each other", "[params][unit]") {
  const Parameters p = parse(R"({"sample": {"labels": [5, 4], "density_slope": -0.5,
    "density_intercept": 1.5, "modulus_factor": 6850, "modulus_exponent": 1.49, "bins": 9}})");
  CHECK(p.sample.labels == std::vector<Label>{4, 5});
  CHECK(p.sample.density_slope == -0.5);
  CHECK(p.sample.modulus_exponent == 1.49);
  CHECK(p.sample.poisson_ratio == 0.3);
  CHECK(parameters_to_json(parse(parameters_to_json(p).dump().c_str())) == parameters_to_json(p));
  CHECK(refusal(R"({"sample": {"modulus_factor": 1}})").find("needs a density") !=
        std::string::npos);
  CHECK(refusal(R"({"sample": {"density_slope": 1, "bins": 2}})").find("needs a modulus") !=
        std::string::npos);
  CHECK(refusal(R"({"sample": {"slope": 1}})").find("sample.slope") != std::string::npos);
  CHECK(refusal(R"({"sample": {"poisson_ratio": 0.5}})").find("at most 0.499") !=
        std::string::npos);
}
