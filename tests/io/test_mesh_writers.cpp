// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/core/error.h"
#include "cvmesh/io/output_tables.h"
#include "cvmesh/io/surface_writer.h"
#include "cvmesh/io/tet_writer.h"

#include "io/image_files.h"
#include "support/catch.h"
#include "support/test_data.h"
#include <algorithm>
#include <cmath>
#include <map>
#include <regex>
#include <sstream>

using namespace cvmesh;
using namespace cvmesh::image_files;

namespace {

// Two tets of two materials on one common facet, all numbers inconvenient.
TetMesh two_tets() {
  TetMesh mesh;
  mesh.points = {
      {0.1, 0, 0}, {1.0 / 3, 0, 0.2}, {0, 0.7, 1e-7}, {0.2, 0.3, 12.3456789}, {0.3, 0.2, -5}};
  mesh.tets = {{0, 1, 2, 3}, {0, 2, 1, 4}};
  for (auto& tet : mesh.tets) {
    const auto& p = mesh.points;
    const auto at = [&](int k) {
      return p[static_cast<std::size_t>(tet[static_cast<std::size_t>(k)])];
    };
    if (volume6(at(0), at(1), at(2), at(3)) < 0) std::swap(tet[2], tet[3]);
  }
  mesh.material_of = {2, 1};
  mesh.surface.points = mesh.points;
  const auto add = [&](std::array<std::int32_t, 3> facet, Sides sides, std::uint8_t wall,
                       Vec3 inner) {
    const auto& p = mesh.points;
    const Vec3 &a = p[static_cast<std::size_t>(facet[0])],
               &b = p[static_cast<std::size_t>(facet[1])],
               &c = p[static_cast<std::size_t>(facet[2])];
    if (volume6(a, b, c, inner) > 0) std::swap(facet[1], facet[2]);
    mesh.surface.facets.push_back(facet);
    mesh.surface.patch_of.push_back({sides, wall});
  };
  const auto& p = mesh.points;
  add({0, 1, 2}, {2, 1}, 0, p[3]);
  add({0, 1, 3}, {2, 0}, 0, p[2]);
  add({1, 2, 3}, {2, 0}, 0, p[0]);
  add({2, 0, 3}, {2, 0}, 3, p[1]);
  add({0, 1, 4}, {1, 0}, 0, p[2]);
  add({1, 2, 4}, {1, 0}, 0, p[0]);
  add({2, 0, 4}, {1, 0}, 0, p[1]);
  return mesh;
}

LabelVolume two_labels() {
  LabelVolume labels;
  labels.label_of = {0, -7, 300};
  labels.name_of = {"", "soft <tissue> & \"more\"", "bone\nsecond line"};
  return labels;
}

Affine oblique(bool is_mirrored) {
  Affine map;
  map.rows = {Vec3{0.8, -0.6, 0}, Vec3{0.6, 0.8, 0}, Vec3{0, 0, is_mirrored ? -1.0 : 1.0}};
  map.offset = {10.125, -20, 1e3 / 7};
  return map;
}

// ---- a small reader of our own for each format -------------------------------------------------

struct Medit {
  std::vector<Vec3> points;
  std::vector<std::array<long, 5>> tets;
  std::vector<std::array<long, 4>> triangles;
  std::vector<std::string> comments;
};

Medit read_medit(const std::filesystem::path& path) {
  Medit mesh;
  std::istringstream in(read_file(path));
  std::string word;
  std::size_t count = 0;
  while (in >> word && word != "End") {
    if (word[0] == '#') {
      std::string rest;
      std::getline(in, rest);
      mesh.comments.push_back(word + rest);
    } else if (word == "MeshVersionFormatted" || word == "Dimension") {
      in >> count;
      CHECK(count == (word == "Dimension" ? 3 : 2));
    } else if (word == "Vertices") {
      in >> count;
      mesh.points.resize(count);
      for (Vec3& p : mesh.points) {
        std::string x, y, z, reference;
        in >> x >> y >> z >> reference;
        p = {std::stod(x), std::stod(y), std::stod(z)};
      }
    } else if (word == "Tetrahedra") {
      in >> count;
      mesh.tets.resize(count);
      for (auto& tet : mesh.tets)
        for (long& v : tet)
          in >> v;
    } else if (word == "Triangles") {
      in >> count;
      mesh.triangles.resize(count);
      for (auto& triangle : mesh.triangles)
        for (long& v : triangle)
          in >> v;
    } else {
      FAIL("unknown word " + word);
    }
  }
  CHECK(word == "End");
  return mesh;
}

// A VTK XML file with arrays in base64: these as bytes, by name, and its text.
struct VtkFile {
  std::string xml;
  std::map<std::string, std::string> arrays;
  std::vector<std::string> order;

  template <typename T>
  [[nodiscard]] std::vector<T> get(const std::string& name) const {
    const std::string& raw = arrays.at(name);
    std::vector<T> values(raw.size() / sizeof(T));
    if (!raw.empty()) std::memcpy(values.data(), raw.data(), raw.size());
    return values;
  }

  // Strings are character codes, each string ended by a 0.
  [[nodiscard]] std::vector<std::string> strings(const std::string& name) const {
    std::smatch match;
    const std::regex pattern("Name=\"" + name + "\"[^>]*>([^<]*)<");
    REQUIRE(std::regex_search(xml, match, pattern));
    std::istringstream in(match[1].str());
    std::vector<std::string> values;
    std::string value;
    for (int code = 0; in >> code;) {
      if (code == 0) {
        values.push_back(value);
        value.clear();
      } else {
        value += static_cast<char>(code);
      }
    }
    return values;
  }
};

// One run of base64 with padding, as VTK wants it.
std::string decode_base64(const std::string& text) {
  const std::string digits = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  REQUIRE(text.size() % 4 == 0);
  std::string bytes;
  for (std::size_t i = 0; i < text.size(); i += 4) {
    std::uint32_t group = 0;
    std::size_t padding = 0;
    for (std::size_t k = 0; k < 4; ++k) {
      const std::size_t digit = digits.find(text[i + k]);
      if (digit == std::string::npos) {
        REQUIRE(text[i + k] == '=');
        REQUIRE(i + 4 == text.size());
        ++padding;
      }
      group = group << 6 | (digit == std::string::npos ? 0U : static_cast<std::uint32_t>(digit));
    }
    for (std::size_t k = 0; k + padding < 3; ++k)
      bytes += static_cast<char>(group >> (16 - 8 * k) & 255);
  }
  return bytes;
}

VtkFile read_vtk(const std::filesystem::path& path) {
  VtkFile file;
  file.xml = read_file(path);
  CHECK(file.xml.find("byte_order=\"LittleEndian\" header_type=\"UInt64\"") != std::string::npos);
  CHECK(file.xml.find("AppendedData") == std::string::npos);
  const std::string kForm = " format=\"binary\">";
  for (std::size_t at = file.xml.find(kForm); at != std::string::npos;
       at = file.xml.find(kForm, at + 1)) {
    const std::string tag = file.xml.substr(file.xml.rfind('<', at), at - file.xml.rfind('<', at));
    std::smatch match;
    REQUIRE(std::regex_search(tag, match, std::regex("Name=\"([^\"]*)\"")));
    const std::size_t begin = at + kForm.size();
    const std::string bytes =
        decode_base64(file.xml.substr(begin, file.xml.find('<', begin) - begin));
    std::uint64_t size = 0;
    REQUIRE(bytes.size() >= sizeof size);
    std::memcpy(&size, bytes.data(), sizeof size);
    CHECK(bytes.size() == sizeof size + size);
    file.arrays[match[1]] = bytes.substr(sizeof size);
    file.order.push_back(match[1]);
  }
  return file;
}

Vec3 point_of(const std::vector<double>& values, std::int64_t index) {
  const auto i = static_cast<std::size_t>(3 * index);
  return {values[i], values[i + 1], values[i + 2]};
}

}  // namespace

TEST_CASE("write_medit: points, tets and facets read back exactly", "[io][unit]") {
  const test_data::TemporaryFolder folder;
  const TetMesh mesh = two_tets();
  for (const bool is_mirrored : {false, true}) {
    CAPTURE(is_mirrored);
    const Affine map = oblique(is_mirrored);
    write_medit(folder / "a.mesh", mesh, two_labels(), map, Space::Ras);
    const Medit read = read_medit(folder / "a.mesh");
    REQUIRE(read.points.size() == mesh.points.size());
    for (std::size_t i = 0; i < mesh.points.size(); ++i)
      CHECK(read.points[i] == map(mesh.points[i]));  // to the last bit
    REQUIRE(read.tets.size() == 2);
    CHECK(read.tets[0][4] == 300);
    CHECK(read.tets[1][4] == -7);
    const auto at = [&](long v) { return read.points[static_cast<std::size_t>(v - 1)]; };
    for (const auto& t : read.tets)
      CHECK(volume6(at(t[0]), at(t[1]), at(t[2]), at(t[3])) > 0);
    REQUIRE(read.triangles.size() == 7);
    // Facets of the label 300 (rows 2 to 4: against the exterior, its wall, and label -7) enclose
    // its tet with normals outwards: the divergence theorem gives its volume.
    double volume = 0;
    for (const auto& t : read.triangles)
      if (t[3] >= 2) volume += dot(at(t[0]), cross(at(t[1]), at(t[2])));
    const auto& t = read.tets[0];
    CHECK(volume == Approx(volume6(at(t[0]), at(t[1]), at(t[2]), at(t[3]))).epsilon(1e-9));
    CHECK(read.comments[0] == "# SPACE=RAS");
    const auto has = [&](const std::string& line) {
      return std::find(read.comments.begin(), read.comments.end(), line) != read.comments.end();
    };
    CHECK(has("# 1: inside label -7 \"soft <tissue> & \"more\"\" | outside label 0 (exterior)"));
    CHECK(has("# 2: inside label 300 \"bone second line\" | outside label 0 (exterior)"));
    CHECK(
        has("# 3: inside label 300 \"bone second line\" | outside label 0 (exterior), "
            "box face y-"));
    CHECK(
        has("# 4: inside label 300 \"bone second line\" | outside label -7 "
            "\"soft <tissue> & \"more\"\""));
  }
}

TEST_CASE("write_vtu: labels come first, volumes are positive, fields are told", "[io][unit]") {
  const test_data::TemporaryFolder folder;
  const TetMesh mesh = two_tets();
  for (const bool is_mirrored : {false, true}) {
    const Affine map = oblique(is_mirrored);
    write_vtu(folder / "a.vtu", mesh, two_labels(), map, Space::Lps);
    const VtkFile read = read_vtk(folder / "a.vtu");
    CHECK(read.order ==
          std::vector<std::string>{"labels", "Points", "connectivity", "offsets", "types"});
    CHECK(read.xml.find("<CellData Scalars=\"labels\">") != std::string::npos);
    CHECK(read.get<std::int32_t>("labels") == std::vector<std::int32_t>{300, -7});
    CHECK(read.get<std::int64_t>("offsets") == std::vector<std::int64_t>{4, 8});
    CHECK(read.get<std::uint8_t>("types") == std::vector<std::uint8_t>{10, 10});
    const auto points = read.get<double>("Points");
    const auto tets = read.get<std::int64_t>("connectivity");
    REQUIRE(points.size() == 15);
    REQUIRE(tets.size() == 8);
    for (std::size_t i = 0; i < 5; ++i)
      CHECK(point_of(points, static_cast<std::int64_t>(i)) == map(mesh.points[i]));
    for (const std::size_t t : {0u, 4u})
      CHECK(volume6(point_of(points, tets[t]), point_of(points, tets[t + 1]),
                    point_of(points, tets[t + 2]), point_of(points, tets[t + 3])) > 0);
    CHECK(read.strings("SPACE") == std::vector<std::string>{"LPS"});
    CHECK(read.strings("label_names") ==
          std::vector<std::string>{"soft <tissue> & \"more\"", "bone second line"});
    CHECK(read.xml.find("Name=\"label_values\" NumberOfTuples=\"2\"") != std::string::npos);
  }
}

TEST_CASE("write_surface_vtp: each facet carries its two labels and its interface", "[io][unit]") {
  const test_data::TemporaryFolder folder;
  const TetMesh mesh = two_tets();
  write_surface_vtp(folder / "a.vtp", mesh.surface, two_labels(), oblique(true), Space::Ras);
  const VtkFile read = read_vtk(folder / "a.vtp");
  CHECK(read.get<std::int32_t>("inside_label") ==
        std::vector<std::int32_t>{300, 300, 300, 300, -7, -7, -7});
  CHECK(read.get<std::int32_t>("outside_label") == std::vector<std::int32_t>{-7, 0, 0, 0, 0, 0, 0});
  CHECK(read.get<std::int32_t>("interface") == std::vector<std::int32_t>{4, 2, 2, 3, 1, 1, 1});
  CHECK(read.strings("interface_names").size() == 4);
  const auto points = read.get<double>("Points");
  const auto facets = read.get<std::int64_t>("connectivity");
  // Outwards normals in the mirrored coordinates: the enclosed volume of both tets is positive.
  double volume = 0;
  for (std::size_t f = 1; f < 7; ++f)
    volume += dot(point_of(points, facets[3 * f]),
                  cross(point_of(points, facets[3 * f + 1]), point_of(points, facets[3 * f + 2])));
  CHECK(volume > 0);
}

TEST_CASE("exterior_label: 0, or a negative number that is no label", "[io][unit]") {
  LabelVolume labels = two_labels();
  CHECK(exterior_label(labels) == 0);
  labels.label_of = {0, 0, 5};
  CHECK(exterior_label(labels) == -1);
  labels.label_of = {0, -2, -1, 0};
  CHECK(exterior_label(labels) == -3);
  CHECK(output_labels(labels) == std::vector<Label>{-3, -2, -1, 0});
}

TEST_CASE("write_off: numbers read back to the last bit", "[io][unit]") {
  const test_data::TemporaryFolder folder;
  const TetMesh mesh = two_tets();
  write_off(folder / "a.off", mesh.surface, oblique(false));
  std::istringstream in(read_file(folder / "a.off"));
  std::string magic, word;
  std::size_t points = 0, facets = 0, edges = 0;
  in >> magic >> points >> facets >> edges;
  CHECK(magic == "OFF");
  REQUIRE(points == 5);
  REQUIRE(facets == 7);
  for (const Vec3& p : mesh.surface.points)
    for (int k = 0; k < 3; ++k) {
      in >> word;
      CHECK(std::stod(word) == oblique(false)(p)[k]);
    }
  for (const auto& facet : mesh.surface.facets) {
    in >> word;
    CHECK(word == "3");
    for (const std::int32_t v : facet) {
      in >> word;
      CHECK(std::stol(word) == v);
    }
  }
}

TEST_CASE("write_points_vtp: points with their named values", "[io][unit]") {
  const test_data::TemporaryFolder folder;
  const std::vector<Vec3> points = {{1, 2, 3}, {-4, 5, 6.5}};
  const std::vector<double> radius = {0.25, 1e-9};
  const std::vector<std::int32_t> material = {3, 0};
  write_points_vtp(folder / "a.vtp", points, {{{"radius_mm", radius}}, {{"material", material}}},
                   {}, Space::Grid);
  const VtkFile read = read_vtk(folder / "a.vtp");
  CHECK(read.get<double>("radius_mm") == radius);
  CHECK(read.get<std::int32_t>("material") == material);
  CHECK(read.get<double>("Points") == std::vector<double>{1, 2, 3, -4, 5, 6.5});
  CHECK(read.get<std::int64_t>("connectivity") == std::vector<std::int64_t>{0, 1});
  CHECK(read.strings("SPACE") == std::vector<std::string>{"grid"});
  write_points_vtp(folder / "empty.vtp", {}, {}, {}, Space::Grid);
  CHECK(read_vtk(folder / "empty.vtp").get<double>("Points").empty());
  const std::vector<double> wrong(3, 0.0);
  CHECK_THROWS_AS(
      write_points_vtp(folder / "b.vtp", points, {{{"wrong", wrong}}, {}}, {}, Space::Grid), Error);
  CHECK_FALSE(std::filesystem::exists(folder / "b.vtp"));
}

TEST_CASE("write_vertex_field_vtp: a mesh with values at its vertices", "[io][unit]") {
  const test_data::TemporaryFolder folder;
  const InterfaceMesh mesh = two_tets().surface;
  const std::vector<double> h = {1, 2, 3, 4, 5};
  write_vertex_field_vtp(folder / "a.vtp", mesh, {{{"h_mm", h}}, {}}, oblique(false), Space::Ras);
  const VtkFile read = read_vtk(folder / "a.vtp");
  CHECK(read.get<double>("h_mm") == h);
  CHECK(read.get<std::int64_t>("connectivity").size() == 21);
}

TEST_CASE("writers: a folder that is not there is an Output error", "[io][unit]") {
  const test_data::TemporaryFolder folder;
  const TetMesh mesh = two_tets();
  const auto code_of = [](const auto& write) {
    try {
      write();
    } catch (const Error& error) {
      return error.code();
    }
    return ErrorCode::Internal;
  };
  const auto path = folder / "absent" / "a";
  CHECK(code_of([&] { write_vtu(path, mesh, two_labels(), {}, Space::Ras); }) == ErrorCode::Output);
  CHECK(code_of([&] { write_medit(path, mesh, two_labels(), {}, Space::Ras); }) ==
        ErrorCode::Output);
  CHECK(code_of([&] { write_off(path, mesh.surface, {}); }) == ErrorCode::Output);
}

TEST_CASE("write_vtu: meshio reads the same mesh", "[io][unit]") {
  if (!python_has("meshio")) {
    WARN("skipped: python3 has no meshio");
    return;
  }
  const test_data::TemporaryFolder folder;
  write_vtu(folder / "a.vtu", two_tets(), two_labels(), oblique(true), Space::Ras);
  const PythonRun run = run_python(folder.path(), R"(
import sys, meshio
m = meshio.read(sys.argv[1])
assert m.points[0][0] == 0.8 * 0.1 + 10.125, m.points[0]
assert m.cell_data["labels"][0].tolist() == [300, -7], m.cell_data
assert bytes(m.field_data["SPACE"]).decode() == "RAS\0", m.field_data
)",
                                   "'" + (folder / "a.vtu").string() + "'");
  CAPTURE(run.output);
  CHECK(run.ok);
}

TEST_CASE("write_medit: meshio reads the same mesh", "[io][unit]") {
  if (!python_has("meshio")) {
    WARN("skipped: python3 has no meshio");
    return;
  }
  const test_data::TemporaryFolder folder;
  write_medit(folder / "a.mesh", two_tets(), two_labels(), oblique(true), Space::Ras);
  const PythonRun run = run_python(folder.path(), R"(
import sys, meshio
m = meshio.read(sys.argv[1])
assert m.points.shape == (5, 3), m.points.shape
assert m.points[0][0] == 0.8 * 0.1 + 10.125, m.points[0]
blocks = {b.type: (b.data, r) for b, r in zip(m.cells, m.cell_data["medit:ref"])}
assert blocks["tetra"][1].tolist() == [300, -7], blocks
assert sorted(blocks["triangle"][1].tolist()) == [1, 1, 1, 2, 2, 3, 4], blocks
)",
                                   "'" + (folder / "a.mesh").string() + "'");
  CAPTURE(run.output);
  CHECK(run.ok);
}

TEST_CASE("write_vtu and write_surface_vtp: VTK reads the same mesh and fields", "[io][unit]") {
  if (!python_has("vtkmodules.vtkIOXML")) {
    WARN("skipped: python3 has no VTK");
    return;
  }
  const test_data::TemporaryFolder folder;
  write_vtu(folder / "a.vtu", two_tets(), two_labels(), oblique(true), Space::Ras);
  write_surface_vtp(folder / "a.vtp", two_tets().surface, two_labels(), oblique(true), Space::Ras);
  const PythonRun run = run_python(folder.path(), R"(
import sys
from vtkmodules.vtkIOXML import vtkXMLUnstructuredGridReader, vtkXMLPolyDataReader
def read(reader, name):
    reader.SetFileName(name)
    reader.Update()
    assert reader.GetErrorCode() == 0
    return reader.GetOutput()
def strings(data, name):
    a = data.GetFieldData().GetAbstractArray(name)
    if a.GetClassName() == "vtkStringArray":
        return [a.GetValue(i) for i in range(a.GetNumberOfValues())]
    codes = bytes(a.GetValue(i) for i in range(a.GetNumberOfValues()))
    return codes.decode().split("\0")[:-1]
g = read(vtkXMLUnstructuredGridReader(), sys.argv[1] + ".vtu")
assert (g.GetNumberOfPoints(), g.GetNumberOfCells()) == (5, 2)
labels = g.GetCellData().GetScalars()
assert labels.GetName() == "labels" and labels.GetDataTypeAsString() == "int"
assert [labels.GetValue(i) for i in range(2)] == [300, -7]
assert g.GetPoint(0)[0] == 0.8 * 0.1 + 10.125
assert g.GetCellType(0) == 10
assert strings(g, "SPACE") == ["RAS"]
assert strings(g, "label_names") == ['soft <tissue> & "more"', "bone second line"]
v = g.GetFieldData().GetArray("label_values")
assert [v.GetValue(i) for i in range(2)] == [-7, 300]
s = read(vtkXMLPolyDataReader(), sys.argv[1] + ".vtp")
assert (s.GetNumberOfPoints(), s.GetNumberOfPolys()) == (5, 7)
a = s.GetCellData().GetArray("outside_label")
assert [a.GetValue(i) for i in range(7)] == [-7, 0, 0, 0, 0, 0, 0]
assert strings(s, "SPACE") == ["RAS"]
)",
                                   "'" + (folder / "a").string() + "'");
  CAPTURE(run.output);
  CHECK(run.ok);
}
