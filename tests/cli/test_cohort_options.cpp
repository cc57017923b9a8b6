// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/io/json_io.h"

#include <nlohmann/json.hpp>

#include "io/image_files.h"
#include "support/catch.h"
#include "support/phantoms.h"
#include "support/run_cli.h"
#include "support/test_data.h"
#include "support/volume_file.h"
#include <algorithm>
#include <filesystem>
#include <set>

using namespace cvmesh;
namespace fs = std::filesystem;
using cvmesh::image_files::read_file;
using cvmesh::image_files::write_file;
using Words = std::vector<std::string>;
using run_cli::Outcome;

namespace {

bool contains(const std::string& text, const std::string& part) {
  return text.find(part) != std::string::npos;
}

/// A folder with the volume a.nii, of labels 1 and 2, and runs that mesh it into out/.
class Subject {
 public:
  Subject() { write_volume_file(folder_ / "a.nii", phantoms::touching_balls(6)); }

  [[nodiscard]] Outcome mesh(const Words& more) const {
    Words words = {"mesh", path("a.nii"), "--out", path("out"), "--force", "--set", "epsilon=2"};
    words.insert(words.end(), more.begin(), more.end());
    return run_cli::cvmesh(words);
  }

  [[nodiscard]] std::string path(const std::string& name) const {
    return (folder_ / name).string();
  }

  [[nodiscard]] bool has(const std::string& name) const {
    return fs::exists(folder_ / "out" / name);
  }

 private:
  test_data::TemporaryFolder folder_;
};

}  // namespace

TEST_CASE("cvmesh mesh: every format is written, and gone after the next run", "[cli]") {
  const Subject subject;
  const Words tets = {"a.vtu", "a.mesh", "a.inp", "a.msh", "a.v22.msh", "a.feb"};
  const Words surfaces = {"a.label_1.stl", "a.label_2.ply", "a.interface_2_1.vtp",
                          "a.interface_1_0.stl"};
  const Outcome all = subject.mesh({"--formats", "vtu,mesh,inp,msh,msh22,feb,stl,ply,vtp"});
  INFO(all.err);
  REQUIRE(all.exit_code == 0);
  for (const Words& files : {tets, surfaces})
    for (const std::string& file : files)
      CHECK(subject.has(file));
  write_file(subject.path("out/a.label_1.txt"), "a note");

  CHECK(subject.mesh({"--formats", "stl", "--surface-only"}).exit_code == 0);
  for (const std::string& file : tets)
    CHECK_FALSE(subject.has(file));
  CHECK(subject.has("a.label_1.stl"));
  CHECK_FALSE(subject.has("a.label_2.ply"));
  CHECK(subject.has("a.label_1.txt"));
  // Somebody's own model is no result of an earlier run.
  write_file(subject.path("out/a.feb"), "<febio_spec version=\"4.0\"/>\n");
  CHECK(subject.mesh({"--formats", "vtu"}).exit_code == 0);
  CHECK(subject.has("a.feb"));
  CHECK_FALSE(subject.has("a.label_1.stl"));
}

TEST_CASE("cvmesh mesh: names from a file, below those of the parameters", "[cli]") {
  const Subject subject;
  write_file(subject.path("names.txt"),
             "1 255 0 0 1 1 1 \"femur\"\n2 0 255 0 1 1 1 \"tibia\"\n9 0 0 0 1 1 1 \"other\"\n");
  const Outcome run =
      subject.mesh({"--label-names", subject.path("names.txt"), "--set", "labels.2.name=shin"});
  INFO(run.err);
  REQUIRE(run.exit_code == 0);
  CHECK(contains(run.err, "not in the volume, and not used: 9"));
  const std::string mesh = read_file(subject.path("out/a.mesh"));
  CHECK(contains(mesh, "# label 1: \"femur\""));
  CHECK(contains(mesh, "# label 2: \"shin\""));
  write_file(subject.path("names.txt"), "1 red green\n");
  const Outcome broken = subject.mesh({"--label-names", subject.path("names.txt")});
  CHECK(broken.exit_code == 2);
  CHECK(contains(broken.err, "line 1"));
}

TEST_CASE("cvmesh mesh: contacts are cut and named, by value or name", "[cli]") {
  const Subject subject;
  const Words named = {"--set", "labels.1.name=stem", "--formats", "inp,msh,feb,vtu,mesh,stl"};
  const auto mesh = [&](const std::string& contact) {
    Words words = named;
    words.insert(words.end(), {"--set", "contact=" + contact});
    return subject.mesh(words);
  };
  const Outcome cut = mesh(R"([["stem", 2]])");
  INFO(cut.err);
  REQUIRE(cut.exit_code == 0);
  const std::string deck = read_file(subject.path("out/a.inp"));
  for (const char* line : {"*SURFACE, NAME=S_LABEL_2_STEM,", "*SURFACE, NAME=S_STEM_LABEL_2,",
                           "*NSET, NSET=N_LABEL_2_STEM", "*NSET, NSET=N_STEM_LABEL_2"})
    CHECK(contains(deck, line));
  CHECK(contains(read_file(subject.path("out/a.feb")), "<SurfacePair name="));
  CHECK(contains(read_file(subject.path("out/a.vtu")), "Name=\"original_point\""));
  CHECK(subject.has("a.interface_1_2.stl"));
  const auto report = read_json(subject.path("out/a.metrics.json"));
  CHECK(report["results"]["stages"]["contacts"]["node_pairs"] > 3);

  const Outcome unknown = mesh(R"([["stem", "cement"]])");
  CHECK(unknown.exit_code == 2);
  CHECK(contains(unknown.err, "\"cement\", which is none of the labels to mesh"));
  CHECK(mesh(R"([["stem"]])").exit_code == 2);
  CHECK(mesh(R"([[2, 2]])").exit_code == 2);
}

TEST_CASE("cvmesh mesh: an image is sampled onto the tets, materials in bins", "[cli]") {
  const Subject subject;
  InputVolume image = phantoms::touching_balls(6);
  // A ramp along the first axis, in an image of its own frame: only every value is another one.
  for (std::size_t i = 0; i < image.values.size(); ++i)
    image.values[i] =
        100 + 10 * static_cast<Label>(i % static_cast<std::size_t>(image.frame.dims[0]));
  write_volume_file(subject.path("ct.nii"), image);
  const std::string laws =
      R"(sample={"labels": [2], "density_slope": 0.001, "density_intercept": 0.5,)"
      R"( "modulus_factor": 6850, "modulus_exponent": 1.49, "bins": 4})";
  const Outcome run =
      subject.mesh({"--sample", subject.path("ct.nii"), "--set", laws, "--formats", "inp,vtu,msh"});
  INFO(run.err);
  REQUIRE(run.exit_code == 0);
  const std::string grid = read_file(subject.path("out/a.vtu"));
  for (const char* array : {"sample_mean", "sample_median", "density_g_cm3", "modulus_mpa"})
    CHECK(contains(grid, std::string("Name=\"") + array + "\""));
  const std::string deck = read_file(subject.path("out/a.inp"));
  CHECK(contains(deck, "*ELSET, ELSET=B_001\n"));
  CHECK(contains(deck, "*SOLID SECTION, ELSET=B_004, MATERIAL=M_B_004\n"));
  const auto sampling =
      read_json(subject.path("out/a.metrics.json"))["results"]["stages"]["sampling"];
  CHECK(sampling["bins"] == 4);
  CHECK(sampling["max_mean"] > sampling["min_mean"]);

  CHECK(subject.mesh({"--sample", subject.path("absent.nii")}).exit_code == 3);
  CHECK(subject.mesh({"--set", R"(sample={"bins": 3})"}).exit_code == 2);
  image.frame.index_to_world.offset += Vec3{500, 0, 0};
  write_volume_file(subject.path("far.nii"), image);
  const Outcome far = subject.mesh({"--sample", subject.path("far.nii")});
  CHECK(far.exit_code == 3);
  CHECK(contains(far.err, "outside the image"));
}

TEST_CASE("cvmesh mesh: --resume skips what is done, and only that", "[cli]") {
  const Subject subject;
  const auto written = [&] { return fs::last_write_time(subject.path("out/a.metrics.json")); };
  REQUIRE(subject.mesh({"--resume"}).exit_code == 0);
  const auto first = written();
  const Outcome again = subject.mesh({"--resume"});
  CHECK(again.exit_code == 0);
  CHECK(contains(again.err, "done already"));
  CHECK(written() == first);
  // Other parameters, formats and another volume of the same name are other runs.
  CHECK(subject.mesh({"--resume", "--set", "epsilon=2.5"}).exit_code == 0);
  const auto second = written();
  CHECK(second != first);
  CHECK(subject.mesh({"--resume", "--set", "epsilon=2.5", "--formats", "inp"}).exit_code == 0);
  const auto third = written();
  CHECK(third != second);
  write_volume_file(subject.path("a.nii"), phantoms::touching_balls(7));
  CHECK(subject.mesh({"--resume", "--set", "epsilon=2.5", "--formats", "inp"}).exit_code == 0);
  CHECK(written() != third);
  // Without the option everything is done again.
  CHECK_FALSE(contains(subject.mesh({"--set", "epsilon=2.5", "--formats", "inp"}).err, "done"));
}

TEST_CASE("cvmesh mesh: --resume tells of missed gates again, and makes lost files again",
          "[cli]") {
  const Subject subject;
  const Words words = {"--resume", "--set", "gates.min_dihedral_deg=60"};
  REQUIRE(subject.mesh(words).exit_code == 5);
  const Outcome again = subject.mesh(words);
  CHECK(again.exit_code == 5);
  CHECK(contains(again.err, "done already"));
  CHECK(contains(again.err, "1 of 1 gates missed: min_dihedral_deg is "));
  fs::remove(subject.path("out/a.vtu"));
  CHECK(subject.mesh(words).exit_code == 5);
  CHECK(subject.has("a.vtu"));

  // A report that was written in is made anew.
  const std::string report = subject.path("out/a.metrics.json");
  auto json = nlohmann::ordered_json::parse(read_file(report));
  json["results"]["gates"] = {1};
  write_file(report, json.dump());
  const Outcome anew = subject.mesh(words);
  CHECK(anew.exit_code == 5);
  CHECK_FALSE(contains(anew.err, "done already"));
}

TEST_CASE("cvmesh mesh: --surface-only refuses what is about tets", "[cli]") {
  const Subject subject;
  for (const Words& words :
       {Words{"--sample", subject.path("a.nii")}, Words{"--set", "element_order=2"},
        Words{"--set", "contact=[[1,2]]"}}) {
    Words all = words;
    all.emplace_back("--surface-only");
    const Outcome outcome = subject.mesh(all);
    CHECK(outcome.exit_code == 2);
    CHECK(contains(outcome.err, "is about tets, which --surface-only does not make"));
  }
}

TEST_CASE("cvmesh mesh: several volumes are refused with a hint", "[cli]") {
  const Subject subject;
  const Outcome outcome = subject.mesh({subject.path("b.nii")});
  CHECK(outcome.exit_code == 2);
  CHECK(contains(outcome.err, "one volume"));
  CHECK(contains(outcome.err, "slurm_cohort.sh"));
  CHECK_FALSE(fs::exists(subject.path("out")));
}

TEST_CASE("manual page and completion know every option of cvmesh mesh", "[cli]") {
  const std::string help = run_cli::cvmesh({"mesh", "--help"}).out;
  std::string manual = read_file(fs::path(CVMESH_SOURCE_DIR) / "scripts/packaging/cvmesh.1");
  manual.erase(std::remove(manual.begin(), manual.end(), '\\'), manual.end());
  const std::string descriptor =
      read_file(fs::path(CVMESH_SOURCE_DIR) / "scripts/packaging/boutiques.json");
  CHECK(nlohmann::json::parse(descriptor)["inputs"].size() > 5);
  std::set<std::string> options;
  for (std::size_t at = help.find("--"); at != std::string::npos; at = help.find("--", at + 2)) {
    const std::size_t end = help.find_first_not_of("abcdefghijklmnopqrstuvwxyz-", at);
    options.insert(help.substr(at, end - at));
  }
  CHECK(options.contains("--formats"));
  for (const std::string& option : options) {
    CAPTURE(option);
    CHECK(contains(manual, option));
  }
}
