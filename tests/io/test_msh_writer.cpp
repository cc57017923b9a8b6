// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/core/box3.h"
#include "cvmesh/io/msh_writer.h"
#include "cvmesh/tet/split_contacts.h"

#include "io/image_files.h"
#include "io/writer_meshes.h"
#include "support/catch.h"
#include "support/test_data.h"
#include <map>
#include <set>
#include <sstream>

using namespace cvmesh;
using namespace cvmesh::image_files;
using namespace cvmesh::writer_meshes;

namespace {

struct Element {
  int type = 0;
  long physical = 0;
  std::vector<long> nodes;
};

/// A file of either version, by a reader of our own.
struct Msh {
  std::string comments;
  std::map<std::pair<int, long>, std::string> names;  // by dimension and physical tag
  std::map<long, Vec3> nodes;
  std::map<long, Element> elements;
  std::map<std::string, std::map<long, double>> data;
};

std::string section(const std::string& text, const std::string& name) {
  const std::size_t begin = text.find("$" + name + "\n") + name.size() + 2;
  const std::size_t end = text.find("$End" + name + "\n");
  REQUIRE(end != std::string::npos);
  return text.substr(begin, end - begin);
}

std::size_t nodes_of_type(int type) {
  static const std::map<int, std::size_t> count = {{2, 3}, {4, 4}, {9, 6}, {11, 10}};
  return count.at(type);
}

void read_41(const std::string& text, Msh& msh) {
  std::map<std::pair<int, long>, long> physical_of;  // by dimension and entity
  std::istringstream entities(section(text, "Entities"));
  std::size_t points = 0, curves = 0, surfaces = 0, volumes = 0;
  entities >> points >> curves >> surfaces >> volumes;
  CHECK(points + curves == 0);
  for (std::size_t i = 0; i < surfaces + volumes; ++i) {
    long tag = 0, physicals = 0, physical = 0, bounding = 0;
    Box3 box;
    entities >> tag >> box.lo.x >> box.lo.y >> box.lo.z >> box.hi.x >> box.hi.y >> box.hi.z;
    entities >> physicals >> physical >> bounding;
    CHECK(physicals == 1);
    for (long k = 0, ignored = 0; k < bounding; ++k)
      entities >> ignored;
    physical_of[{i < surfaces ? 2 : 3, tag}] = physical;
  }
  std::istringstream nodes(section(text, "Nodes"));
  std::size_t blocks = 0, count = 0, lowest = 0, highest = 0;
  nodes >> blocks >> count >> lowest >> highest;
  for (std::size_t block = 0; block < blocks; ++block) {
    long dimension = 0, entity = 0, parametric = 0;
    std::size_t size = 0;
    nodes >> dimension >> entity >> parametric >> size;
    CHECK(physical_of.count({static_cast<int>(dimension), entity}) == 1);
    std::vector<long> numbers(size);
    for (long& number : numbers)
      nodes >> number;
    for (const long number : numbers) {
      std::array<std::string, 3> x;
      nodes >> x[0] >> x[1] >> x[2];
      CHECK(msh.nodes.emplace(number, Vec3{std::stod(x[0]), std::stod(x[1]), std::stod(x[2])})
                .second);
    }
  }
  CHECK(msh.nodes.size() == count);
  CHECK(highest == count);
  std::istringstream elements(section(text, "Elements"));
  elements >> blocks >> count >> lowest >> highest;
  for (std::size_t block = 0; block < blocks; ++block) {
    int dimension = 0, type = 0;
    long entity = 0;
    std::size_t size = 0;
    elements >> dimension >> entity >> type >> size;
    for (std::size_t i = 0; i < size; ++i) {
      long number = 0;
      elements >> number;
      Element element{type, physical_of.at({dimension, entity}), {}};
      element.nodes.resize(nodes_of_type(type));
      for (long& node : element.nodes)
        elements >> node;
      CHECK(msh.elements.emplace(number, element).second);
    }
  }
  CHECK(msh.elements.size() == count);
}

void read_22(const std::string& text, Msh& msh) {
  std::istringstream nodes(section(text, "Nodes"));
  std::size_t count = 0;
  nodes >> count;
  for (std::size_t i = 0; i < count; ++i) {
    long number = 0;
    std::array<std::string, 3> x;
    nodes >> number >> x[0] >> x[1] >> x[2];
    msh.nodes[number] = {std::stod(x[0]), std::stod(x[1]), std::stod(x[2])};
  }
  std::istringstream elements(section(text, "Elements"));
  elements >> count;
  for (std::size_t i = 0; i < count; ++i) {
    long number = 0, tags = 0, entity = 0;
    Element element;
    elements >> number >> element.type >> tags >> element.physical >> entity;
    CHECK(tags == 2);
    element.nodes.resize(nodes_of_type(element.type));
    for (long& node : element.nodes)
      elements >> node;
    msh.elements[number] = element;
  }
}

Msh read_msh(const std::filesystem::path& path) {
  const std::string text = read_file(path);
  Msh msh;
  msh.comments = section(text, "Comments");
  std::istringstream names(section(text, "PhysicalNames"));
  std::size_t count = 0;
  names >> count;
  for (std::size_t i = 0; i < count; ++i) {
    int dimension = 0;
    long tag = 0;
    std::string rest;
    names >> dimension >> tag;
    std::getline(names, rest);
    REQUIRE(rest.size() > 3);
    msh.names[{dimension, tag}] = rest.substr(2, rest.size() - 3);
  }
  if (section(text, "MeshFormat").rfind("4.1", 0) == 0)
    read_41(text, msh);
  else
    read_22(text, msh);
  for (const std::string kind : {"NodeData", "ElementData"}) {
    for (std::size_t at = text.find("$" + kind + "\n"); at != std::string::npos;
         at = text.find("$" + kind + "\n", at + 1)) {
      std::istringstream in(text.substr(at + kind.size() + 2));
      std::string name;
      std::size_t strings = 0, reals = 0, integers = 0, step = 0, components = 0, values = 0;
      double time = 0;
      in >> strings >> name >> reals >> time >> integers >> step >> components >> values;
      for (std::size_t i = 0; i < values; ++i) {
        long number = 0;
        in >> number >> msh.data[name][number];
      }
    }
  }
  return msh;
}

using Write = decltype(&write_msh);
constexpr std::array<Write, 2> kVersions = {&write_msh, &write_msh22};

Msh written(Write write, const TetMesh& mesh, const LabelVolume& labels, const Affine& map) {
  const test_data::TemporaryFolder folder;
  write(folder / "a.msh", mesh, labels, map, Space::Lps);
  return read_msh(folder / "a.msh");
}

/// Gmsh's edges of a tet of 10 nodes.
constexpr std::array<std::array<std::size_t, 2>, 6> kGmshEdges = {
    {{0, 1}, {1, 2}, {2, 0}, {0, 3}, {2, 3}, {1, 3}}};

}  // namespace

TEST_CASE("write_msh: nodes, tets and their groups read back, in both versions", "[io][unit]") {
  for (const Write write : kVersions)
    for (const bool is_second_order : {false, true})
      for (const bool is_mirrored : {false, true}) {
        CAPTURE(write == &write_msh, is_second_order, is_mirrored);
        const TetMesh mesh = cube(is_second_order);
        const Affine map = oblique(is_mirrored);
        const Msh msh = written(write, mesh, named("soft \"tissue\"", "b\xC3\xB6ne"), map);
        CHECK(msh.comments.find("SPACE=LPS") != std::string::npos);
        // Label -7 is none that Gmsh can have as tag: it comes after the largest.
        CHECK(msh.names.at({3, 300}) == "b\xC3\xB6ne");
        CHECK(msh.names.at({3, 301}) == "soft 'tissue'");
        CHECK(msh.comments.find("physical volume 301: label -7 ") != std::string::npos);
        REQUIRE(msh.nodes.size() == mesh.points.size() + mesh.mid_points.size());
        for (const auto& [number, p] : msh.nodes) {
          const auto i = static_cast<std::size_t>(number - 1);
          const Vec3& point =
              i < mesh.points.size() ? mesh.points[i] : mesh.mid_points[i - mesh.points.size()];
          CHECK(p == map(point));  // to the last bit
        }
        std::size_t tets = 0;
        for (const auto& [number, element] : msh.elements) {
          if (element.type != (is_second_order ? 11 : 4)) continue;
          const auto tet = static_cast<std::size_t>(number - 1) - mesh.surface.facets.size();
          ++tets;
          CHECK(element.physical == (mesh.material_of[tet] == 1 ? 301 : 300));
          const auto at = [&](std::size_t k) { return msh.nodes.at(element.nodes[k]); };
          CHECK(volume6(at(0), at(1), at(2), at(3)) > 0);
          std::set<long> nodes(element.nodes.begin(), element.nodes.begin() + 4), expected;
          for (const std::int32_t v : mesh.tets[tet])
            expected.insert(v + 1);
          CHECK(nodes == expected);
          for (std::size_t e = 0; is_second_order && e < kGmshEdges.size(); ++e)
            CHECK(norm(at(4 + e) - 0.5 * (at(kGmshEdges[e][0]) + at(kGmshEdges[e][1]))) < 1e-12);
        }
        CHECK(tets == mesh.tets.size());
      }
}

TEST_CASE("write_msh: triangles of each group enclose its label", "[io][unit]") {
  for (const Write write : kVersions)
    for (const bool is_second_order : {false, true})
      for (const bool is_mirrored : {false, true}) {
        const Msh msh =
            written(write, cube(is_second_order), named("soft", "bone"), oblique(is_mirrored));
        // Normals from inside to outside: the divergence theorem gives the volume of the tets.
        std::map<long, double> flux;
        double bone = 0;
        for (const auto& [number, element] : msh.elements) {
          const auto at = [&](std::size_t k) { return msh.nodes.at(element.nodes[k]); };
          if (element.nodes.size() % 3 == 0) {
            flux[element.physical] += dot(at(0), cross(at(1), at(2)));
            for (std::size_t e = 0; element.nodes.size() == 6 && e < 3; ++e)
              CHECK(norm(at(3 + e) - 0.5 * (at(e) + at((e + 1) % 3))) < 1e-12);
          } else if (element.physical == 300) {
            bone += volume6(at(0), at(1), at(2), at(3));
          }
        }
        // Tags of surfaces follow those of volumes, 300 and 301.
        CHECK(msh.names.at({2, 302}) == "soft | exterior");
        CHECK(msh.names.at({2, 303}) == "soft | exterior, x-");
        CHECK(msh.names.at({2, 304}) == "bone | exterior");
        CHECK(msh.names.at({2, 305}) == "bone | soft");
        CHECK(flux[304] + flux[305] == Approx(bone).epsilon(1e-9));
      }
}

TEST_CASE("write_msh: names stay short, on one line and apart", "[io][unit]") {
  const std::string endless = std::string(200, 'x') + "\n$Nodes";
  for (const Write write : kVersions)
    for (const auto& [first, second] :
         {std::pair(endless, endless), std::pair<std::string, std::string>("", " "),
          std::pair<std::string, std::string>("a | b", "a")}) {
      const Msh msh = written(write, cube(false), named(first, second), {});
      CHECK(msh.elements.size() == 6 + cube(false).surface.facets.size());
      std::set<std::string> names;
      for (const auto& [group, name] : msh.names) {
        CHECK(name.size() <= 127);
        CHECK(names.insert(name).second);
      }
      CHECK(names.size() == 6);
    }
}

TEST_CASE("write_msh: copies at contacts and sampled values are data", "[io][unit]") {
  TetMesh mesh = cube(true);
  mesh.arrays.push_back({"sample_mean", {1, 2, 3, 4, 5, 6.5}});
  split_contacts(mesh, {{2, 1}});
  for (const Write write : kVersions) {
    const Msh msh = written(write, mesh, named("soft", "bone"), {});
    CHECK(msh.names.at({2, 304}) == "soft | bone");
    CHECK(msh.names.at({2, 306}) == "bone | soft");
    const auto& original = msh.data.at("\"original_point\"");
    REQUIRE(original.size() == mesh.original_of.size());
    for (const auto& [number, source] : original)
      CHECK(msh.nodes.at(number) == msh.nodes.at(static_cast<long>(source)));
    CHECK(msh.data.at("\"sample_mean\"").rbegin()->second == 6.5);
  }
}

TEST_CASE("write_msh: meshio and Gmsh read the groups by name", "[io][unit]") {
  const test_data::TemporaryFolder folder;
  write_msh(folder / "a.msh", cube(true), named("soft", "bone"), oblique(true), Space::Ras);
  write_msh22(folder / "b.msh", cube(true), named("soft", "bone"), oblique(true), Space::Ras);
  const std::string argument = "'" + folder.path().string() + "'";
  if (python_has("meshio")) {
    const PythonRun run = run_python(folder.path(), R"(
import sys, meshio
for name in ("a", "b"):
    m = meshio.read(sys.argv[1] + "/" + name + ".msh")
    assert m.field_data["bone"].tolist() == [300, 3], m.field_data
    assert m.field_data["bone | soft"].tolist() == [305, 2], m.field_data
    tags = [t for b, t in zip(m.cells, m.cell_data["gmsh:physical"]) if b.type == "tetra10"]
    assert sorted(sum((t.tolist() for t in tags), [])) == [300] * 3 + [301] * 3, tags
)",
                                     argument);
    INFO(run.output);
    CHECK(run.ok);
  } else {
    WARN("skipped: python3 has no meshio");
  }
  if (python_has("gmsh")) {
    const PythonRun run = run_python(folder.path(), R"(
import sys, gmsh
gmsh.initialize(["-nopopup"])
gmsh.option.setNumber("General.Terminal", 0)
for name in ("a", "b"):
    gmsh.open(sys.argv[1] + "/" + name + ".msh")
    groups = {gmsh.model.getPhysicalName(d, t): (d, t) for d, t in gmsh.model.getPhysicalGroups()}
    assert groups["bone"] == (3, 300) and groups["soft"] == (3, 301), groups
    assert groups["bone | soft"] == (2, 305), groups
    points, weights = gmsh.model.mesh.getIntegrationPoints(11, "Gauss4")
    volume, least = 0, []
    for entity in (1, 2):
        determinants = gmsh.model.mesh.getJacobians(11, points, entity)[1]
        least.append(min(determinants))
        volume += sum(d * w for d, w in zip(determinants, list(weights) * 3))
    assert abs(volume - 1.23456789) < 1e-9, volume
    # Gmsh's own check of quality: the Jacobians are constant and positive.
    gmsh.logger.start()
    gmsh.plugin.setNumber("AnalyseMeshQuality", "JacobianDeterminant", 1)
    gmsh.plugin.setNumber("AnalyseMeshQuality", "DimensionOfElements", 3)
    gmsh.plugin.setNumber("AnalyseMeshQuality", "Recompute", 1)
    gmsh.plugin.run("AnalyseMeshQuality")
    said = [line for line in gmsh.logger.get() if "minJ  " in line]
    gmsh.logger.stop()
    assert len(said) == 1, said
    lowest = float(said[0].split("=")[1].split(",")[0])
    assert lowest > 0 and abs(lowest / min(least) - 1) < 0.01, (lowest, min(least))
    gmsh.clear()
gmsh.finalize()
)",
                                     argument);
    INFO(run.output);
    CHECK(run.ok);
  } else {
    WARN("skipped: python3 has no gmsh");
  }
}
