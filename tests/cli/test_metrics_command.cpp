// SPDX-License-Identifier: AGPL-3.0-or-later
#include <nlohmann/json.hpp>

#include "metrics/simple_meshes.h"
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

void write_text(const std::filesystem::path& path, const std::string& text) {
  std::ofstream(path) << text;
}

// Two balls of two labels, meshed; the report of that run and the one of its files.
class MeshedBalls {
 public:
  MeshedBalls() {
    write_volume_file(folder_ / "balls.nii", phantoms::touching_balls(7, {1, 0.8, 1.3}));
    const auto outcome =
        run_cli::cvmesh({"mesh", labels(), "--out", folder_.path().string(), "-q"});
    REQUIRE(outcome.exit_code == 0);
  }

  [[nodiscard]] std::string labels() const { return (folder_ / "balls.nii").string(); }

  [[nodiscard]] std::string path(const std::string& name) const {
    return (folder_ / name).string();
  }

  [[nodiscard]] Json run_report() const { return json_of(folder_ / "balls.metrics.json"); }

  [[nodiscard]] Json judged(const std::string& mesh,
                            const std::vector<std::string>& more = {}) const {
    std::vector<std::string> words = {"metrics", path(mesh), labels(), "--out",
                                      path("judged.json")};
    words.insert(words.end(), more.begin(), more.end());
    const auto outcome = run_cli::cvmesh(words);
    INFO(outcome.err);
    REQUIRE(outcome.exit_code == 0);
    CHECK_THAT(outcome.out, Contains("mesh to labels") && Contains("topology as the voxels"));
    return json_of(folder_ / "judged.json");
  }

 private:
  test_data::TemporaryFolder folder_;
};

// The number at a path of both documents, within a relative tolerance of file coordinates.
void check_near(const Json& a, const Json& b, const std::string& pointer) {
  INFO(pointer);
  const Json::json_pointer at(pointer);
  CHECK(a.at(at).get<double>() == Approx(b.at(at).get<double>()).epsilon(1e-9).margin(1e-9));
}

}  // namespace

TEST_CASE("cvmesh metrics: says of a run's files what the run says", "[cli]") {
  const MeshedBalls balls;
  const Json run = balls.run_report();
  for (const char* name : {"balls.vtu", "balls.mesh"}) {
    CAPTURE(name);
    const Json judged = balls.judged(name);
    CHECK(judged["results"]["mesh"] == run["results"]["mesh"]);
    CHECK(judged["input"] == run["input"]);
    for (const char* key : {"surface_is_valid", "surface_intersections", "labels_are_complete",
                            "topology_as_lattice14", "tets_are_valid"})
      CHECK(judged["results"]["checks"][key] == run["results"]["checks"][key]);
    for (const char* pointer :
         {"/results/quality/tets/radius_ratio/mean", "/results/quality/tets/min_dihedral_deg/min",
          "/results/quality/triangles/radius_ratio/mean", "/results/labels/0/volume/mesh_mm3",
          "/results/labels/1/volume/relative_error",
          "/results/labels/0/quality/tets/radius_ratio/min"})
      check_near(judged, run, pointer);
    // Facets come in another order, and so do the samples: only maxima are the same, within twice
    // the stated error, and means within their standard errors.
    const Json &a = judged["results"]["distances"]["to_labels"]["voxels"]["mesh_to_reference"],
               &b = run["results"]["distances"]["to_labels"]["voxels"]["mesh_to_reference"];
    CHECK(std::abs(a["max"].get<double>() - b["max"].get<double>()) <= 0.05);
    CHECK(std::abs(a["mean"].get<double>() - b["mean"].get<double>()) <=
          5 * b["mean_standard_error"].get<double>());
    CHECK(judged["results"]["distances"]["interfaces"].size() ==
          run["results"]["distances"]["interfaces"].size());
    CHECK_FALSE(judged["results"]["distances"].contains("to_dense"));
  }
}

TEST_CASE("cvmesh metrics: the worst spot lies where it is said to be", "[cli]") {
  const MeshedBalls balls;
  const Json run = balls.run_report();
  const Json worst =
      run["results"]["distances"]["to_labels"]["voxels"]["reference_to_mesh"]["worst"];
  // On the staircase: at least one of its index coordinates is halfway between two voxels. The
  // phantom's frame has its middle at the world's origin and axes along the world's.
  const Json dims = run["input"]["dims"], spacing = run["input"]["spacing_mm"];
  bool is_on_face = false;
  for (int axis = 0; axis < 3; ++axis) {
    const double index = worst["position"][axis].get<double>() / spacing[axis].get<double>() +
                         (dims[axis].get<double>() - 1) / 2;
    is_on_face = is_on_face || std::abs(index - std::floor(index) - 0.5) < 1e-6;
  }
  CHECK(is_on_face);
  CHECK(worst["inside_label"] != worst["outside_label"]);
}

TEST_CASE("cvmesh metrics: the true surface is measured in the mesh's coordinates", "[cli]") {
  const MeshedBalls balls;
  // One triangle far outside: known distances show the space.
  write_text(balls.path("truth.off"), "OFF\n3 1 0\n100 0 0\n101 0 0\n100 1 0\n3 0 1 2\n");
  const Json judged = balls.judged("balls.vtu", {"--truth", balls.path("truth.off")});
  const Json& truth = judged["results"]["distances"]["to_truth"]["mm"];
  // From the ball's far side at x = -R to the triangle, the balls being centred on the origin.
  const double left = truth["mesh_to_reference"]["worst"]["position"][0].get<double>();
  CHECK(left < 0);
  CHECK(truth["mesh_to_reference"]["max"].get<double>() == Approx(100 - left).epsilon(0.01));
  CHECK_FALSE(truth["reference_to_mesh"]["worst"].contains("inside_label"));
}

namespace {

/// A ball in the world, of a volume whose third axis leans towards the first.
InputVolume ball_in_leaning_volume(double radius_mm) {
  GridFrame frame = phantoms::centred_frame({35, 21, 25});
  Affine& map = frame.index_to_world;
  map.rows = {Vec3{1, 0, 0.6}, Vec3{0, 1, 0}, Vec3{0, 0, 0.8}};
  map.offset = -1.0 * map.linear({17, 10, 12});
  InputVolume volume(frame);
  for (int k = 0; k < frame.dims[2]; ++k)
    for (int j = 0; j < frame.dims[1]; ++j)
      for (int i = 0; i < frame.dims[0]; ++i)
        volume(i, j, k) = norm(map({double(i), double(j), double(k)})) < radius_mm ? 1 : 0;
  return volume;
}

/// A sphere around the origin as an .off file.
void write_sphere(const std::filesystem::path& path, double radius) {
  const InterfaceMesh sphere = simple_meshes::sphere({0, 0, 0}, radius, 4);
  std::ofstream file(path);
  file << "OFF\n" << sphere.points.size() << ' ' << sphere.facets.size() << " 0\n";
  for (const Vec3& p : sphere.points)
    file << p.x << ' ' << p.y << ' ' << p.z << '\n';
  for (const auto& facet : sphere.facets)
    file << "3 " << facet[0] << ' ' << facet[1] << ' ' << facet[2] << '\n';
}

}  // namespace

TEST_CASE("cvmesh: distances of a sheared volume are those of the world", "[cli]") {
  constexpr double kRadius = 7, kGap = 2;
  const test_data::TemporaryFolder folder;
  write_volume_file(folder / "ball.nii", ball_in_leaning_volume(kRadius));
  write_sphere(folder / "truth.off", kRadius + kGap);
  const std::string out = folder.path().string(), labels = (folder / "ball.nii").string();
  const auto meshed = run_cli::cvmesh({"mesh", labels, "--out", out, "--allow-shear", "--report"});
  REQUIRE(meshed.exit_code == 0);
  CHECK_THAT(meshed.err, Contains("mm in the world)"));
  const Json run = json_of(folder / "ball.metrics.json");
  const auto judged = run_cli::cvmesh({"metrics", (folder / "ball.vtu").string(), labels, "--truth",
                                       (folder / "truth.off").string(), "--allow-shear", "--out",
                                       (folder / "judged.json").string()});
  REQUIRE(judged.exit_code == 0);
  CHECK_THAT(judged.out, Contains("distances in mm of the world"));

  // The mesh is a ball but for the staircase and its chords; the truth's facets are within 0.02 of
  // a sphere. So the sphere is about 2 mm away everywhere in the world, and exactly so at the worst
  // place.
  const Json truth = json_of(folder / "judged.json")["results"]["distances"]["to_truth"];
  const Json& there = truth["world_mm"]["mesh_to_reference"];
  CHECK(there["mean"].get<double>() == Approx(kGap).margin(0.25));
  CHECK(there["max"].get<double>() < kGap + 1);
  const Json at = there["worst"]["position"];
  const double worst = norm({at[0].get<double>(), at[1].get<double>(), at[2].get<double>()});
  CHECK(there["max"].get<double>() == Approx(kRadius + kGap - worst).margin(0.03));
  // In grid mm lengths along one diagonal of the leaning axes are twice those along the other.
  CHECK(truth["mm"]["mesh_to_reference"]["max"].get<double>() >
        1.2 * truth["mm"]["mesh_to_reference"]["mean"].get<double>());
  for (const char* reference : {"to_dense", "to_labels"})
    CHECK(run["results"]["distances"][reference].contains("world_mm"));
  CHECK(run["results"]["labels"][0]["distances"]["to_labels"].contains("world_mm"));
}

TEST_CASE("cvmesh metrics: faults of a mesh are reported, not refused", "[cli]") {
  const MeshedBalls balls;
  // A tet too few leaves a hole that no label's boundary should have.
  std::ifstream file(balls.path("balls.mesh"));
  std::string text((std::istreambuf_iterator<char>(file)), {});
  const std::size_t section = text.find("Tetrahedra\n") + 11, line = text.find('\n', section) + 1;
  const std::size_t count = std::stoul(text.substr(section));
  const std::size_t second = text.find('\n', line) + 1;
  // The first tet becomes the second one: one is missing, and one is there twice.
  text.replace(line, second - line, text.substr(second, text.find('\n', second) + 1 - second));
  write_text(balls.path("broken.mesh"), text);
  const Json judged = balls.judged("broken.mesh");
  CHECK(judged["results"]["mesh"]["tets"] == count);
  CHECK(judged["judged_mesh"]["tet_faults"]["repeated_tets"] == 1);
  CHECK(judged["results"]["checks"]["tets_are_valid"] == false);
  // Faults name labels and places as the files do.
  const std::string faults = judged["results"]["checks"]["faults"].dump();
  INFO(faults);
  CHECK(faults.find("label 1 (") != std::string::npos);
  CHECK(faults.find(") mm in ") != std::string::npos);
  CHECK(faults.find("material 1") == std::string::npos);
}

TEST_CASE("cvmesh metrics: what cannot be judged is refused with code 3", "[cli]") {
  const MeshedBalls balls;
  const auto refused = [&](const std::string& mesh, const std::vector<std::string>& more = {}) {
    std::vector<std::string> words = {"metrics", balls.path(mesh), balls.labels()};
    words.insert(words.end(), more.begin(), more.end());
    const auto outcome = run_cli::cvmesh(words);
    CHECK(outcome.exit_code == 3);
    CHECK(outcome.out.empty());
    return outcome.err;
  };
  const std::string points = "MeshVersionFormatted 2 Dimension 3 Vertices 4\n";
  write_text(balls.path("label.mesh"),
             points + "0 0 0 0 1 0 0 0 0 1 0 0 0 0 1 0\nTetrahedra 1 1 2 3 4 9 End\n");
  CHECK_THAT(refused("label.mesh"), Contains("label 9"));
  write_text(balls.path("far.mesh"), points +
                                         "900 0 0 0 901 0 0 0 900 1 0 0 900 0 1 0\n"
                                         "Tetrahedra 1 1 2 3 4 1 End\n");
  CHECK_THAT(refused("far.mesh"), Contains("--space"));
  CHECK_THAT(refused("absent.vtu"), Contains("absent.vtu"));
  CHECK_THAT(refused("balls.vtu", {"--truth", balls.path("balls.vtu")}), Contains("'.vtu'"));
  write_text(balls.path("line.off"), "OFF\n3 1 0\n1 0 0\n2 0 0\n3 0 0\n3 0 1 2\n");
  CHECK_THAT(refused("balls.vtu", {"--truth", balls.path("line.off")}), Contains("no area"));
  CHECK(run_cli::cvmesh({"metrics", balls.path("balls.vtu")}).exit_code == 2);
}

TEST_CASE("cvmesh schema --metrics: real reports follow it", "[cli]") {
  const MeshedBalls balls;
  const Json judged = balls.judged("balls.vtu");
  CHECK(judged["status"] == "success");
  const auto schema = run_cli::cvmesh({"schema", "--metrics"});
  REQUIRE(schema.exit_code == 0);
  write_text(balls.path("schema.json"), schema.out);
  const Json run = balls.run_report();
  CHECK(run["input"]["file_sha256"].get<std::string>().size() == 64);
  CHECK(run["libraries"].contains("cgal"));
  // A failed run's report, too.
  run_cli::cvmesh(
      {"mesh", balls.labels(), "--out", balls.path("failed"), "-q", "--set", "drop_labels=[1,2]"});
  const auto valid = [&](const std::string& report) {
    const std::string command = "/usr/bin/python3 " CVMESH_SOURCE_DIR
                                "/tests/cli/check_schema.py " +
                                balls.path("schema.json") + " " + balls.path(report);
    return WEXITSTATUS(std::system(command.c_str()));  // NOLINT(concurrency-mt-unsafe)
  };
  const int first = valid("balls.metrics.json");
  if (first == 77) {
    WARN("skipped: jsonschema is missing");
    return;
  }
  CHECK(first == 0);
  CHECK(valid("judged.json") == 0);
  CHECK(valid("failed/balls.failed.json") == 0);
  // The schema can say no.
  Json changed = run;
  changed["results"]["distances"]["to_labels"]["mm"]["mesh_to_reference"]["max"] = "far";
  write_text(balls.path("changed.json"), changed.dump());
  CHECK(valid("changed.json") == 1);
  changed = run;
  changed["results"]["quality"]["tets"].erase("below_5_deg");
  write_text(balls.path("changed.json"), changed.dump());
  CHECK(valid("changed.json") == 1);
}
