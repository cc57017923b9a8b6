// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/core/error.h"
#include "cvmesh/io/inp_writer.h"
#include "cvmesh/io/output_tables.h"
#include "cvmesh/io/set_names.h"

#include "io/image_files.h"
#include "io/writer_meshes.h"
#include "metrics/simple_meshes.h"
#include "support/catch.h"
#include "support/test_data.h"
#include <algorithm>
#include <cstdlib>
#include <map>
#include <set>
#include <sstream>

using namespace cvmesh;
using namespace cvmesh::image_files;
using namespace cvmesh::writer_meshes;

namespace {

/// Nodes on the outside of the cube move by a linear function of where they are; those inside (the
/// mid node of its diagonal) have to follow, and the volume is known. Arguments: the folder of
/// a.inp, the number of nodes inside.
constexpr char kStretch[] = R"py(
import os, re, subprocess, sys
os.chdir(sys.argv[1])
text = open("a.inp").read()
rows = text.split("*NODE, NSET=NALL\n")[1].split("*")[0].split("\n")[:-1]
nodes = {int(r.split(",")[0]): [float(x) for x in r.split(",")[1:]] for r in rows}
outside = set()
for block in re.findall(r"NSET=N_\w+_EXTERIOR\w*\n([^*]*)", text):
    outside |= {int(n) for n in re.findall(r"\d+", block)}
assert len(nodes) - len(outside) == int(sys.argv[2]), (len(nodes), len(outside))
def moved(p):
    return [1e-3 * p[0] + 2e-3 * p[1], 3e-3 * p[1] - 1e-3 * p[2], 2e-3 * p[2] + 1e-3 * p[0]]
deck = ["*INCLUDE, INPUT=a.inp", "*MATERIAL, NAME=M", "*ELASTIC", "1000, 0.3"]
sets = re.findall(r"ELSET=(\w+)", text)
assert sets == ["E_A_B_SCRIPT_NODE", "E_BONE"], sets
for name in sets:
    deck += ["*SOLID SECTION, ELSET=" + name + ", MATERIAL=M"]
deck += ["*STEP", "*STATIC", "*BOUNDARY"]
for n in sorted(outside):
    deck += ["%d, %d, %d, %.12g" % (n, k + 1, k + 1, u) for k, u in enumerate(moved(nodes[n]))]
deck += ["*NODE PRINT, NSET=NALL", "U"]
for name in sets:
    deck += ["*EL PRINT, ELSET=" + name + ", TOTALS=ONLY", "EVOL"]
open("job.inp", "w").write("\n".join(deck + ["*END STEP"]) + "\n")
done = subprocess.run(["ccx", "-i", "job"], stdout=subprocess.PIPE, text=True,
                      env={**os.environ, "OMP_NUM_THREADS": "1"})
assert done.returncode == 0 and "*ERROR" not in done.stdout, done.stdout
lines = [line.split() for line in open("job.dat")]
found = {int(w[0]): [float(x) for x in w[1:]] for w in lines if len(w) == 4 and w[0].isdigit()}
assert found.keys() == nodes.keys(), found.keys()
for n, u in found.items():
    for a, b in zip(u, moved(nodes[n])):
        assert abs(a - b) < 1e-6, (n, u, moved(nodes[n]))
volumes = [float(w[0]) for w in lines if len(w) == 1]
assert len(volumes) == 2 and abs(sum(volumes) - 1.23456789) < 1e-5, volumes
)py";

// ---- a reader of our own -----------------------------------------------------------------------

struct Element {
  std::string type, set;
  std::vector<long> nodes;
};

struct Deck {
  std::vector<std::string> comments;
  std::map<long, Vec3> nodes;
  std::map<long, Element> elements;
  std::map<std::string, std::vector<long>> node_sets;
  std::map<std::string, std::vector<std::pair<long, std::string>>> surfaces;
  std::size_t longest_number = 0, longest_line = 0, most_entries = 0;

  [[nodiscard]] Vec3 corner(const Element& e, std::size_t i) const { return nodes.at(e.nodes[i]); }
};

std::vector<std::string> split(const std::string& line) {
  std::vector<std::string> words;
  std::istringstream in(line);
  for (std::string word; std::getline(in, word, ',');) {
    word.erase(0, word.find_first_not_of(' '));
    words.push_back(word);
  }
  return words;
}

std::string value_of(const std::vector<std::string>& words, const std::string& key) {
  for (const std::string& word : words)
    if (word.rfind(key + "=", 0) == 0) return word.substr(key.size() + 1);
  FAIL("no " + key);
  return "";
}

Deck read_inp(const std::filesystem::path& path) {
  Deck deck;
  std::istringstream in(read_file(path));
  std::vector<std::string> keyword;
  for (std::string line; std::getline(in, line);) {
    deck.longest_line = std::max(deck.longest_line, line.size());
    if (line.rfind("**", 0) == 0) {
      CHECK(keyword.empty());  // at the top only
      deck.comments.push_back(line);
      continue;
    }
    const std::vector<std::string> words = split(line);
    if (line[0] == '*') {
      keyword = words;
      continue;
    }
    deck.most_entries = std::max(deck.most_entries, words.size());
    if (keyword[0] == "*NODE") {
      REQUIRE(words.size() == 4);
      for (const std::string& word : words)
        deck.longest_number = std::max(deck.longest_number, word.size());
      const Vec3 p{std::stod(words[1]), std::stod(words[2]), std::stod(words[3])};
      CHECK(deck.nodes.emplace(std::stol(words[0]), p).second);
    } else if (keyword[0] == "*ELEMENT") {
      Element element{value_of(keyword, "TYPE"), value_of(keyword, "ELSET"), {}};
      for (std::size_t i = 1; i < words.size(); ++i)
        element.nodes.push_back(std::stol(words[i]));
      CHECK(deck.elements.emplace(std::stol(words[0]), element).second);
    } else if (keyword[0] == "*NSET") {
      for (const std::string& word : words)
        deck.node_sets[value_of(keyword, "NSET")].push_back(std::stol(word));
    } else if (keyword[0] == "*SURFACE") {
      CHECK(value_of(keyword, "TYPE") == "ELEMENT");
      REQUIRE(words.size() == 2);
      deck.surfaces[value_of(keyword, "NAME")].emplace_back(std::stol(words[0]), words[1]);
    } else {
      FAIL("unknown keyword " + keyword[0]);
    }
  }
  return deck;
}

Deck written(const TetMesh& mesh, const LabelVolume& labels, const Affine& map) {
  const test_data::TemporaryFolder folder;
  write_inp(folder / "a.inp", mesh, labels, map, Space::Lps);
  return read_inp(folder / "a.inp");
}

/// Corners of a face by the manuals' tables, from 0.
std::array<std::size_t, 3> corners_of(const std::string& face) {
  static const std::map<std::string, std::array<std::size_t, 3>> corners = {
      {"S1", {0, 1, 2}}, {"S2", {0, 3, 1}}, {"S3", {1, 3, 2}}, {"S4", {2, 3, 0}}};
  return corners.at(face);
}

bool is_legal(const std::string& name) {
  return !name.empty() && name.size() <= 64 && name[0] >= 'A' && name[0] <= 'Z' &&
         name.find_first_not_of("ABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_") == std::string::npos;
}

std::set<std::string> names_of(const Deck& deck) {
  std::set<std::string> names;
  for (const auto& [number, element] : deck.elements)
    names.insert(element.set);
  for (const auto& [name, nodes] : deck.node_sets)
    names.insert(name);
  for (const auto& [name, faces] : deck.surfaces)
    names.insert(name);
  return names;
}

}  // namespace

TEST_CASE("write_inp: nodes read back exactly and each tet is once in the set of its label",
          "[io][unit]") {
  const LabelVolume labels = named("soft tissue", "bone");
  for (const bool is_second_order : {false, true})
    for (const bool is_mirrored : {false, true}) {
      CAPTURE(is_second_order, is_mirrored);
      const TetMesh mesh = cube(is_second_order);
      const Affine map = oblique(is_mirrored);
      const Deck deck = written(mesh, labels, map);
      REQUIRE(deck.nodes.size() == mesh.points.size() + mesh.mid_points.size());
      for (const auto& [number, p] : deck.nodes) {
        const auto i = static_cast<std::size_t>(number - 1);
        const Vec3& point =
            i < mesh.points.size() ? mesh.points[i] : mesh.mid_points[i - mesh.points.size()];
        CHECK(p == map(point));  // to the last bit
      }
      REQUIRE(deck.elements.size() == mesh.tets.size());
      for (const auto& [number, element] : deck.elements) {
        const auto tet = static_cast<std::size_t>(number - 1);
        CHECK(element.type == (is_second_order ? "C3D10" : "C3D4"));
        CHECK(element.set == (mesh.material_of[tet] == 1 ? "E_SOFT_TISSUE" : "E_BONE"));
        REQUIRE(element.nodes.size() == (is_second_order ? 10 : 4));
        const std::set<long> nodes(element.nodes.begin(), element.nodes.begin() + 4);
        std::set<long> expected;
        for (const std::int32_t v : mesh.tets[tet])
          expected.insert(v + 1);
        CHECK(nodes == expected);
        CHECK(volume6(deck.corner(element, 0), deck.corner(element, 1), deck.corner(element, 2),
                      deck.corner(element, 3)) > 0);
        if (!is_second_order) continue;
        for (std::size_t e = 0; e < kEdges.size(); ++e) {
          const Vec3 middle =
              0.5 * (deck.corner(element, kEdges[e][0]) + deck.corner(element, kEdges[e][1]));
          // The mapped middle and the middle of the mapped ends: rounding of 1e3 / 7, no more.
          CHECK(norm(deck.corner(element, 4 + e) - middle) < 1e-12);
        }
      }
      CHECK(deck.comments[0] == kInpFirstLine);
      CHECK(deck.comments[1] == "** coordinates: mm, SPACE=LPS");
      CHECK(deck.comments[3] == "** ELSET E_BONE: label 300 \"bone\"");
    }
}

TEST_CASE("write_inp: surfaces and node sets are those of the interfaces", "[io][unit]") {
  const LabelVolume labels = named("soft", "bone");
  const std::vector<std::string> names = {"SOFT_EXTERIOR", "SOFT_EXTERIOR_XMIN", "BONE_EXTERIOR",
                                          "BONE_SOFT"};
  for (const bool is_second_order : {false, true})
    for (const bool is_mirrored : {false, true}) {
      CAPTURE(is_second_order, is_mirrored);
      const TetMesh mesh = cube(is_second_order);
      const InterfaceTable table = interface_table(mesh.surface);
      const Deck deck = written(mesh, labels, oblique(is_mirrored));
      CHECK(deck.most_entries <= 16);
      REQUIRE(table.patches.size() == names.size());
      REQUIRE(deck.surfaces.size() == names.size());
      REQUIRE(deck.node_sets.size() == names.size());
      for (std::size_t row = 0; row < names.size(); ++row) {
        CAPTURE(names[row]);
        std::set<std::set<long>> facets, faces;
        for (std::size_t i = 0; i < mesh.surface.facets.size(); ++i)
          if (table.index_of[i] == static_cast<std::int32_t>(row + 1)) {
            const auto& f = mesh.surface.facets[i];
            facets.insert({f[0] + 1, f[1] + 1, f[2] + 1});
          }
        std::set<long> nodes;
        std::vector<Vec3> middles;
        for (const auto& [number, face] : deck.surfaces.at("S_" + names[row])) {
          const Element& element = deck.elements.at(number);
          CHECK(element.set == (table.patches[row].sides.inside == 1 ? "E_SOFT" : "E_BONE"));
          const auto [a, b, c] = corners_of(face);
          CHECK(faces.insert({element.nodes[a], element.nodes[b], element.nodes[c]}).second);
          for (const auto& [from, to] : {std::pair(a, b), std::pair(b, c), std::pair(c, a)}) {
            nodes.insert(element.nodes[from]);
            middles.push_back(0.5 * (deck.corner(element, from) + deck.corner(element, to)));
          }
        }
        CHECK(faces == facets);
        if (is_second_order)
          for (const auto& [number, p] : deck.nodes)
            for (const Vec3& middle : middles)
              if (norm(p - middle) < 1e-12) nodes.insert(number);
        const std::vector<long>& set = deck.node_sets.at("N_" + names[row]);
        CHECK(set == std::vector<long>(nodes.begin(), nodes.end()));
      }
      // A plane of 4 corners, 4 sides and a diagonal.
      CHECK(deck.node_sets.at("N_BONE_SOFT").size() == (is_second_order ? 9 : 4));
      CHECK(std::find(deck.comments.begin(), deck.comments.end(),
                      "** NSET N_SOFT_EXTERIOR_XMIN, SURFACE S_SOFT_EXTERIOR_XMIN: inside label -7 "
                      "\"soft\" | outside label 0 (exterior), box face x-") != deck.comments.end());
    }
}

TEST_CASE("write_inp: set names are legal and unique whatever the labels are called",
          "[io][unit]") {
  const TetMesh mesh = cube(false);
  const std::string hostile = "a\"b<script>\n*NODE";
  const std::string endless(300, 'x');
  const std::vector<std::array<std::string, 2>> names = {
      {hostile, hostile}, {"bone", "bone"},         {"", "  \n"},
      {"exterior", "b"},  {endless, endless + "y"}, {"7 \xC3\xBC, ELSET=E", "bone_M7"},
      {"\xC3\xBC", "300"}};
  for (const auto& [first, second] : names) {
    CAPTURE(first, second);
    const Deck deck = written(mesh, named(first, second), {});
    CHECK(deck.nodes.size() == 8);
    CHECK(deck.elements.size() == 6);
    CHECK(deck.longest_line <= 204);
    // Two labels, and two sets for each of the four interfaces.
    const std::set<std::string> all = names_of(deck);
    CHECK(all.size() == 10);
    for (const std::string& name : all) {
      CAPTURE(name);
      CHECK(is_legal(name));
    }
  }
  using Names = std::vector<std::string>;
  CHECK(plain_label_names(named(hostile, "bone")) == Names{"EXTERIOR", "A_B_SCRIPT_NODE", "BONE"});
  CHECK(plain_label_names(named("Bone", "bone")) == Names{"EXTERIOR", "BONE_M7", "BONE_300"});
  CHECK(plain_label_names(named("", "Exterior")) == Names{"EXTERIOR", "LABEL_M7", "EXTERIOR_300"});
  LabelVolume three = named("bone", "bone");
  three.label_of.push_back(301);
  three.name_of.emplace_back("bone 300");
  CHECK(plain_label_names(three) == Names{"EXTERIOR", "BONE_M7", "BONE_300_300", "BONE_300_301"});
}

TEST_CASE("write_inp: interfaces whose names run into each other are told apart", "[io][unit]") {
  // "a" against "b_c" and "a_b" against "c" both give A_B_C: four materials in two cubes.
  TetMesh mesh = simple_meshes::two_material_cube();
  const TetMesh other = simple_meshes::two_material_cube();
  const auto shift = static_cast<std::int32_t>(mesh.points.size());
  mesh.surface = simple_meshes::together(mesh.surface, other.surface);
  for (std::size_t i = 0; i < other.tets.size(); ++i) {
    auto tet = other.tets[i];
    for (std::int32_t& v : tet)
      v += shift;
    mesh.tets.push_back(tet);
    mesh.material_of.push_back(static_cast<MaterialId>(other.material_of[i] + 2));
  }
  for (const Vec3& p : other.points)
    mesh.points.push_back(p + Vec3{5, 0, 0});
  mesh.surface.points = mesh.points;
  for (std::size_t i = other.surface.facets.size(); i < mesh.surface.facets.size(); ++i) {
    Sides& sides = mesh.surface.patch_of[i].sides;
    sides.inside = static_cast<MaterialId>(sides.inside + 2);
    if (sides.outside != kExterior) sides.outside = static_cast<MaterialId>(sides.outside + 2);
  }
  LabelVolume labels;
  labels.label_of = {0, 1, 2, 3, 4};
  labels.name_of = {"exterior", "b_c", "a", "c", "a_b"};
  const Deck deck = written(mesh, labels, {});
  CHECK(deck.elements.size() == 12);
  CHECK(deck.surfaces.size() == 6);
  CHECK(deck.surfaces.count("S_A_B_C_3") == 1);  // rows 3 and 6 of the table
  CHECK(deck.surfaces.count("S_A_B_C_6") == 1);
}

TEST_CASE("write_inp: numbers are no longer than what CalculiX reads", "[io][unit]") {
  TetMesh mesh = cube(false);
  mesh.points[0] = {1.2345678901234567e-05, -1.2345678901234567e-10, -1.0 / 3e200};
  mesh.points[1] = {-0.00123456789012345678, -1e3 / 7, -0.0123456789012345678};
  const Deck deck = written(mesh, named("a", "b"), {});
  CHECK(deck.longest_number <= 20);
  for (const long number : {1L, 2L})
    for (int axis = 0; axis < 3; ++axis) {
      const double expected = mesh.points[static_cast<std::size_t>(number - 1)][axis];
      CHECK(deck.nodes.at(number)[axis] == Approx(expected).epsilon(1e-12).margin(0));
    }
  CHECK(deck.nodes.at(2).y == -1e3 / 7);
}

TEST_CASE("write_inp: CalculiX stretches the mesh evenly, in both orders", "[io][unit]") {
  if (std::system("command -v ccx > /dev/null") != 0) {  // NOLINT(concurrency-mt-unsafe)
    WARN("skipped: no ccx here (Debian's package calculix-ccx)");
    return;
  }
  const test_data::TemporaryFolder folder;
  for (const bool is_second_order : {false, true})
    for (const bool is_mirrored : {false, true}) {
      CAPTURE(is_second_order, is_mirrored);
      write_inp(folder / "a.inp", cube(is_second_order), named("a\"b<script>\n*NODE", "bone"),
                oblique(is_mirrored), Space::Ras);
      const PythonRun run =
          run_python(folder.path(), kStretch,
                     "'" + folder.path().string() + "' " + (is_second_order ? "1" : "0"));
      INFO(run.output);
      CHECK(run.ok);
    }
}

TEST_CASE("write_inp: a folder that is not there is an Output error", "[io][unit]") {
  const test_data::TemporaryFolder folder;
  try {
    write_inp(folder / "absent" / "a.inp", cube(false), named("a", "b"), {}, Space::Ras);
    FAIL("written");
  } catch (const Error& error) {
    CHECK(error.code() == ErrorCode::Output);
  }
}
