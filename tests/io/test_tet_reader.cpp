// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/core/error.h"
#include "cvmesh/io/msh_writer.h"
#include "cvmesh/io/surface_reader.h"
#include "cvmesh/io/tet_reader.h"
#include "cvmesh/io/tet_writer.h"

#include "metrics/simple_meshes.h"
#include "support/catch.h"
#include "support/test_data.h"
#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <fstream>
#include <functional>
#include <set>
#include <utility>

using namespace cvmesh;

namespace {

void write_file(const std::filesystem::path& path, const std::string& content) {
  std::ofstream(path, std::ios::binary) << content;
}

std::string content_of(const std::filesystem::path& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), {}};
}

// The message of the Error BadInput that reading must end with.
std::string refusal(const std::function<void()>& read) {
  try {
    read();
  } catch (const Error& error) {
    CHECK(error.code() == ErrorCode::BadInput);
    return error.what();
  }
  return "accepted";
}

std::string refusal_of_tets(const std::string& name, const std::string& content) {
  const test_data::TemporaryFolder folder;
  write_file(folder / name, content);
  return refusal([&] { read_tet_file(folder / name); });
}

using Catch::Contains;

const std::string kMedit =
    "MeshVersionFormatted 2\nDimension 3\nVertices\n4\n0 0 0 0\n1 0 0 0\n0 1 0 0\n0 0 1 0\n"
    "Tetrahedra\n1\n1 2 3 4 5\nEnd\n";

const std::string kVtu =
    "<?xml version=\"1.0\"?>\n<VTKFile type=\"UnstructuredGrid\" byte_order=\"LittleEndian\">\n"
    "<UnstructuredGrid><Piece NumberOfPoints=\"4\" NumberOfCells=\"1\">\n"
    "<Points><DataArray type=\"Float64\" NumberOfComponents=\"3\" format=\"ascii\">\n"
    "0 0 0 1 0 0 0 1 0 0 0 1\n</DataArray></Points>\n"
    "<Cells><DataArray type=\"Int64\" Name=\"connectivity\" format=\"ascii\">0 1 2 3</DataArray>\n"
    "<DataArray type=\"Int64\" Name=\"offsets\" format=\"ascii\">4</DataArray>\n"
    "<DataArray type=\"UInt8\" Name=\"types\" format=\"ascii\">10</DataArray></Cells>\n"
    "<CellData><DataArray type=\"Int32\" Name=\"ref\" format=\"ascii\">6</DataArray>\n"
    "<DataArray type=\"Float64\" Name=\"labels\" format=\"ascii\">5</DataArray></CellData>\n"
    "</Piece></UnstructuredGrid></VTKFile>\n";

std::string replaced(std::string text, const std::string& from, const std::string& to) {
  const std::size_t at = text.find(from);
  REQUIRE(at != std::string::npos);
  return text.replace(at, from.size(), to);
}

// Runs a script of this folder; false, with a warning, where what it needs is missing.
bool runs(const std::string& script, const std::string& arguments) {
  const std::string command =
      "/usr/bin/python3 " CVMESH_SOURCE_DIR "/tests/io/" + script + " " + arguments;
  const int status = WEXITSTATUS(std::system(command.c_str()));  // NOLINT(concurrency-mt-unsafe)
  if (status == 77) {
    WARN("skipped: " + script + " lacks a package");
    return false;
  }
  REQUIRE(status == 0);
  return true;
}

// Label and corners of each tet, sorted: what stays the same however points and tets are numbered.
using PlacedTet = std::pair<Label, std::array<std::array<double, 3>, 4>>;

std::vector<PlacedTet> placed_tets(const TetFile& file, double digit) {
  std::vector<PlacedTet> result;
  for (std::size_t t = 0; t < file.tets.size(); ++t) {
    PlacedTet placed{file.label_of[t], {}};
    for (std::size_t k = 0; k < 4; ++k) {
      const Vec3& p = file.points[static_cast<std::size_t>(file.tets[t][k])];
      placed.second[k] = {std::round(p.x / digit), std::round(p.y / digit),
                          std::round(p.z / digit)};
    }
    std::sort(placed.second.begin(), placed.second.end());
    result.push_back(placed);
  }
  std::sort(result.begin(), result.end());
  return result;
}

}  // namespace

TEST_CASE("read_tet_file: reads back what the writers wrote", "[io][unit]") {
  const TetMesh mesh = simple_meshes::two_material_cube();
  LabelVolume labels;
  labels.label_of = {0, -7, 300};
  labels.name_of = {"", "a", "b"};
  Affine map;
  map.offset = {10.125, -20, 1e3 / 7};
  const test_data::TemporaryFolder folder;
  write_vtu(folder / "m.vtu", mesh, labels, map, Space::Lps);
  write_medit(folder / "m.mesh", mesh, labels, map, Space::Lps);
  for (const char* name : {"m.vtu", "m.mesh"}) {
    const TetFile file = read_tet_file(folder / name);
    REQUIRE(file.points.size() == mesh.points.size());
    for (std::size_t i = 0; i < file.points.size(); ++i)
      CHECK(file.points[i] == map(mesh.points[i]));
    CHECK(file.tets == mesh.tets);
    REQUIRE(file.label_of.size() == mesh.tets.size());
    for (std::size_t t = 0; t < file.label_of.size(); ++t)
      CHECK(file.label_of[t] == labels.label_of[mesh.material_of[t]]);
    CHECK(file.space == Space::Lps);
  }
  CHECK(read_tet_file(folder / "m.mesh").other_elements == mesh.surface.facets.size());
}

TEST_CASE("read_tet_file: reads every form that meshio writes", "[io][unit]") {
  const test_data::TemporaryFolder folder;
  if (!runs("write_meshio_files.py", folder.path().string())) return;
  for (const char* name : {"ascii.vtu", "base64.vtu", "zlib.vtu", "base64_32.vtu", "zlib_64.vtu",
                           "medit.mesh", "gmsh.msh", "gmsh_binary.msh"}) {
    CAPTURE(name);
    const TetFile file = read_tet_file(folder / name);
    REQUIRE(file.points.size() == 5);
    CHECK(file.points[2] == Vec3{0, 1.5, 0});
    CHECK(file.points[4].z == Approx(0.1).epsilon(1e-15));
    CHECK(file.tets == std::vector<std::array<std::int32_t, 4>>{{0, 1, 2, 3}, {1, 4, 2, 3}});
    CHECK(file.other_elements == 1);
    CHECK(file.label_of == std::vector<Label>{2, 7});
    CHECK_FALSE(file.space.has_value());
  }
  for (const char* name : {"text.ply", "binary.ply", "text.stl", "binary.stl"}) {
    CAPTURE(name);
    const SurfaceFile file = read_surface_file(folder / name);
    REQUIRE(file.facets.size() == 2);
    CHECK(file.points[file.facets[0][2]] == Vec3{0, 1.5, 0});
    CHECK(file.points[file.facets[1][2]] == Vec3{0, 0, 2});
  }
}

TEST_CASE("read_tet_file: labels of a Gmsh 4.1 file are the physical groups of its volumes",
          "[io][unit]") {
  const test_data::TemporaryFolder folder;
  write_file(folder / "m.msh",
             "$MeshFormat\n4.1 0 8\n$EndMeshFormat\n$PhysicalNames\n1\n3 70 \"a # b\"\n"
             "$EndPhysicalNames\n$Entities\n1 0 0 2\n9 0 0 0 0\n1 0 0 0 1 1 1 1 70 0\n"
             "2 0 0 0 1 1 1 0 1 -3\n$EndEntities\n$Nodes\n1 5 1 9\n3 1 0 5\n1\n2\n3\n4\n9\n"
             "0 0 0\n1 0 0\n0 1 0\n0 0 1\n1 1 1\n$EndNodes\n$Elements\n3 3 1 3\n2 4 2 1\n1 1 2 3\n"
             "3 1 4 1\n2 1 2 3 4\n3 2 4 1\n3 2 3 4 9\n$EndElements\n");
  const TetFile file = read_tet_file(folder / "m.msh");
  CHECK(file.label_of == std::vector<Label>{70, 2});  // the second volume is in no group
  CHECK(file.tets == std::vector<std::array<std::int32_t, 4>>{{0, 1, 2, 3}, {1, 2, 3, 4}});
  CHECK(file.other_elements == 1);
  CHECK(file.label_source == "gmsh:physical");
}

TEST_CASE("read_tet_file: Gmsh's binary files hold what its text files do", "[io][unit]") {
  const test_data::TemporaryFolder folder;
  if (!runs("write_gmsh_files.py", folder.path().string())) return;
  for (const std::string order : {"order1", "order2"})
    for (const std::string version : {"2.2", "4.1"}) {
      CAPTURE(order, version);
      const std::string stem = order + "_" + version;
      const TetFile text = read_tet_file(folder / (stem + "_text.msh"));
      const TetFile binary = read_tet_file(folder / (stem + "_binary.msh"));
      REQUIRE(binary.points.size() == text.points.size());
      double farthest = 0;
      for (std::size_t i = 0; i < text.points.size(); ++i)
        farthest = std::max(farthest, norm(binary.points[i] - text.points[i]));
      CHECK(farthest < 1e-15);
      CHECK(binary.tets.size() > 50);
      CHECK(binary.tets == text.tets);
      CHECK(binary.label_of == text.label_of);
      CHECK(binary.other_elements == text.other_elements);
      CHECK(binary.other_elements > 20);
      CHECK(binary.label_source == "gmsh:physical");
      CHECK(std::set<Label>(binary.label_of.begin(), binary.label_of.end()) ==
            std::set<Label>{7, 40});
      double volume = 0;
      for (const auto& tet : binary.tets) {
        std::array<Vec3, 4> p;
        for (std::size_t k = 0; k < 4; ++k)
          p[k] = binary.points[static_cast<std::size_t>(tet[k])];
        volume += volume6(p[0], p[1], p[2], p[3]) / 6;
      }
      CHECK(volume == Approx(1.7).epsilon(1e-12));
    }
}

TEST_CASE("read_tet_file: damaged binary Gmsh files are refused", "[io][unit]") {
  const test_data::TemporaryFolder folder;
  if (!runs("write_gmsh_files.py", folder.path().string())) return;
  const std::string whole = content_of(folder / "order1_4.1_binary.msh");
  const auto refused = [&](const std::string& from, const std::string& to) {
    return refusal_of_tets("m.msh", replaced(whole, from, to));
  };
  using namespace std::string_literals;
  CHECK_THAT(refused("4.1 1 8", "4.1 1 4"), Contains("data size 4"));
  CHECK_THAT(refused("4.1 1 8", "4.1 2 8"), Contains("the file type (2)"));
  CHECK_THAT(refused("8\n\1\0\0\0"s, "8\n\0\0\0\1"s), Contains("big endian"));
  CHECK_THAT(refused("$EndElements", "$EndElement"), Contains("expected $EndElements"));
  CHECK_THAT(refused("$Elements\n", "$Elements "), Contains("line break"));
  CHECK_THAT(refused("$EndPhysicalNames", "$EndNames"), Contains("$PhysicalNames does not end"));
  // A number of blocks that no file could hold.
  CHECK_THAT(refused("$Nodes\n"s, "$Nodes\n\0\0\0\0\0\0\1\0"s),
             Contains("byte ") && Contains("number of node blocks"));
  std::size_t refusals = 0, tried = 0;
  for (const char* name : {"order1_4.1_binary.msh", "order1_2.2_binary.msh"}) {
    const std::string content = content_of(folder / name);
    for (std::size_t length = 0; length + 20 < content.size(); length += 997, ++tried)
      refusals += refusal_of_tets("m.msh", content.substr(0, length)) != "accepted" ? 1 : 0;
    CHECK(refusals == tried);
    for (std::size_t at = 0; at < content.size(); at += 499) {
      std::string changed = content;
      changed[at] = static_cast<char>(changed[at] ^ (1 << at % 8));
      refusal_of_tets("m.msh", changed);  // no worse than a refusal
    }
  }
}

TEST_CASE("read_tet_file: a Gmsh file of ours states its space", "[io][unit]") {
  LabelVolume labels;
  labels.label_of = {0, 1, 2};
  labels.name_of = {"", "SPACE=RAS", "b"};
  const test_data::TemporaryFolder folder;
  write_msh(folder / "m.msh", simple_meshes::two_material_cube(), labels, {}, Space::Lps);
  CHECK(read_tet_file(folder / "m.msh").space == Space::Lps);
}

TEST_CASE("read_tet_file: pieces of a VTU file become one mesh", "[io][unit]") {
  const TetMesh mesh = simple_meshes::two_material_cube();
  LabelVolume labels;
  labels.label_of = {0, 5, 300};
  labels.name_of = {"", "a", "b"};
  const test_data::TemporaryFolder folder;
  write_vtu(folder / "whole.vtu", mesh, labels, {}, Space::Lps);
  if (!runs("write_vtk_pieces.py", (folder / "whole.vtu").string() + " " + folder.path().string()))
    return;
  const TetFile whole = read_tet_file(folder / "whole.vtu");
  for (const char* name : {"Ascii_None.vtu", "Ascii_ZLib.vtu", "Binary_None.vtu", "Binary_ZLib.vtu",
                           "Appended_None.vtu", "Appended_ZLib.vtu", "ghosts.vtu"}) {
    CAPTURE(name);
    const TetFile pieces = read_tet_file(folder / name);
    CHECK(pieces.points.size() == whole.points.size());
    // VTK makes floats of the points when it cuts a mesh into pieces.
    CHECK(placed_tets(pieces, 1e-5) == placed_tets(whole, 1e-5));
    CHECK(pieces.space == Space::Lps);
  }
}

TEST_CASE("read_tet_file: points of one piece stay apart, and join those of the next in turn",
          "[io][unit]") {
  // Two tets on one face, cut open: each piece has the face's corners twice.
  const std::string piece =
      "<Piece NumberOfPoints=\"8\" NumberOfCells=\"2\">\n"
      "<Points><DataArray type=\"Float64\" NumberOfComponents=\"3\" format=\"ascii\">\n"
      "0 0 0 1 0 0 0 1 0 0 0 0 1 0 0 0 1 0 0 0 1 0 0 -1\n</DataArray></Points>\n"
      "<Cells><DataArray type=\"Int64\" Name=\"connectivity\" format=\"ascii\">0 1 2 6 3 5 4 7"
      "</DataArray>\n<DataArray type=\"Int64\" Name=\"offsets\" format=\"ascii\">4 8</DataArray>"
      "<DataArray type=\"UInt8\" Name=\"types\" format=\"ascii\">10 10</DataArray></Cells>\n"
      "<CellData><DataArray type=\"Int32\" Name=\"ref\" format=\"ascii\">1 2</DataArray>"
      "</CellData></Piece>\n";
  const std::string empty = "<Piece NumberOfPoints=\"0\" NumberOfCells=\"0\"></Piece>\n";
  const std::string head =
      "<VTKFile type=\"UnstructuredGrid\" byte_order=\"LittleEndian\">\n<UnstructuredGrid>\n";
  const std::string foot = "</UnstructuredGrid></VTKFile>\n";
  const test_data::TemporaryFolder folder;
  write_file(folder / "m.vtu", head + empty + piece + piece + foot);
  const TetFile file = read_tet_file(folder / "m.vtu");
  CHECK(file.points.size() == 8);
  CHECK(file.tets == std::vector<std::array<std::int32_t, 4>>{
                         {0, 1, 2, 6}, {3, 5, 4, 7}, {0, 1, 2, 6}, {3, 5, 4, 7}});
  CHECK(file.label_of == std::vector<Label>{1, 2, 1, 2});
  // The second piece calls its labels otherwise.
  CHECK_THAT(refusal_of_tets("m.vtu", head + piece + replaced(piece, "\"ref\"", "\"a\"") + foot),
             Contains("'ref'") && Contains("CellData"));
  CHECK_THAT(refusal_of_tets("m.vtu", head + foot), Contains("no piece"));
  CHECK_THAT(refusal_of_tets("m.vtu", head + empty + empty + foot), Contains("no tetrahedra"));
}

TEST_CASE("read_tet_file: the array labels goes before the others, whatever its type",
          "[io][unit]") {
  const test_data::TemporaryFolder folder;
  write_file(folder / "m.vtu", kVtu);
  CHECK(read_tet_file(folder / "m.vtu").label_of == std::vector<Label>{5});
  write_file(folder / "m.vtu", replaced(kVtu, "\"labels\"", "\"density\""));
  CHECK(read_tet_file(folder / "m.vtu").label_of == std::vector<Label>{6});
  CHECK(read_tet_file(folder / "m.vtu").label_source == "ref");
  CHECK_THAT(
      refusal_of_tets("m.vtu", replaced(replaced(kVtu, "\"labels\"", "\"a\""), "\"ref\"", "\"b\"")),
      Contains("no cell array of labels") && Contains("b, a"));
  CHECK_THAT(refusal_of_tets("m.vtu", replaced(kVtu, ">5<", ">5.5<")), Contains("5.5"));
}

TEST_CASE("read_tet_file: damaged Medit files are refused with line and value", "[io][unit]") {
  const auto refused = [](const std::string& from, const std::string& to) {
    return refusal_of_tets("m.mesh", replaced(kMedit, from, to));
  };
  CHECK(refusal_of_tets("m.mesh", kMedit) == "accepted");
  CHECK_THAT(refused("Dimension 3", "Dimension 2"), Contains("line 2") && Contains("(2)"));
  CHECK_THAT(refused("1 0 0 0", "1 zero 0 0"), Contains("line 6") && Contains("'zero'"));
  CHECK_THAT(refused("Vertices\n4", "Vertices\n2000000000"), Contains("line 4"));
  CHECK_THAT(refused("Vertices\n4", "Vertices\n-1"), Contains("(-1)"));
  CHECK_THAT(refused("1 2 3 4 5", "1 2 3 9 5"), Contains("vertex 8") && Contains("4 points"));
  CHECK_THAT(refused("1 2 3 4 5", "0 2 3 4 5"), Contains("(0)"));
  CHECK_THAT(refused("1 2 3 4 5", "1 2 3 4 5000000000"), Contains("5000000000"));
  CHECK_THAT(refused("1 0 0 0", "inf 0 0 0"), Contains("point 1 is not finite"));
  CHECK_THAT(refused("Tetrahedra", "Tetrahedrons"), Contains("'Tetrahedrons' is not known"));
  CHECK_THAT(refused("1 2 3 4 5\nEnd\n", "1 2 3"), Contains("the end of the file"));
  CHECK_THAT(refused("Tetrahedra\n1\n1 2 3 4 5\n", ""), Contains("no tetrahedra"));
  CHECK_THAT(refusal_of_tets("m.mesh", ""), Contains("MeshVersionFormatted"));
}

TEST_CASE("read_tet_file: damaged VTU files are refused with array and value", "[io][unit]") {
  const auto refused = [](const std::string& from, const std::string& to) {
    return refusal_of_tets("m.vtu", replaced(kVtu, from, to));
  };
  CHECK_THAT(refused("NumberOfPoints=\"4\"", "NumberOfPoints=\"2000000000\""),
             Contains("fewer than 6000000000 values"));
  CHECK_THAT(refused("NumberOfCells=\"1\"", "NumberOfCells=\"x\""),
             Contains("NumberOfCells ('x')"));
  CHECK_THAT(refused(">4<", ">400000000000<"), Contains("400000000000"));
  CHECK_THAT(refused(">4<", ">-4<"), Contains("(-4)"));
  CHECK_THAT(refused(">4<", ">3<"), Contains("3 nodes"));
  CHECK_THAT(refused("0 1 2 3<", "0 1 2 7<"), Contains("the point 7"));
  CHECK_THAT(refused("\"UnstructuredGrid\"", "\"PolyData\""), Contains("type UnstructuredGrid"));
  CHECK_THAT(refused("LittleEndian", "BigEndian"), Contains("BigEndian"));
  CHECK_THAT(refused("</Cells>", "</Points>"), Contains("does not close"));
  CHECK_THAT(refused("type=\"UInt8\"", "type=\"Bit\""), Contains("'Bit'"));
  CHECK_THAT(refused("<DataArray type=\"UInt8\" Name=\"types\" format=\"ascii\">10<",
                     "<DataArray type=\"UInt8\" Name=\"types\" format=\"binary\">!!!!<"),
             Contains("'types'"));
  CHECK_THAT(refused("<DataArray type=\"UInt8\" Name=\"types\" format=\"ascii\">10<",
                     "<DataArray type=\"UInt8\" Name=\"types\" format=\"binary\">/////w==<"),
             Contains("4294967295 bytes instead of 1"));
}

TEST_CASE("read_tet_file: a cut or changed file never does worse than a refusal", "[io][unit]") {
  // Every tenth length, and every byte of the text part set to others, of a binary and a text file.
  const TetMesh mesh = simple_meshes::two_material_cube();
  LabelVolume labels;
  labels.label_of = {0, 1, 2};
  labels.name_of = {"", "a", "b"};
  const test_data::TemporaryFolder folder;
  write_vtu(folder / "m.vtu", mesh, labels, {}, Space::Ras);
  write_medit(folder / "m.mesh", mesh, labels, {}, Space::Ras);
  std::size_t refused = 0, tried = 0;
  for (const char* name : {"m.vtu", "m.mesh"}) {
    const std::string whole = content_of(folder / name);
    const auto attempt = [&](const std::string& content) {
      write_file(folder / name, content);
      ++tried;
      refused += refusal([&] { read_tet_file(folder / name); }) != "accepted" ? 1 : 0;
    };
    for (std::size_t length = 0; length + 10 < whole.size(); length += 10)
      attempt(whole.substr(0, length));
    for (std::size_t at = 0; at < whole.size(); at += 3) {
      std::string changed = whole;
      changed[at] = static_cast<char>(changed[at] ^ (1 << at % 8));
      attempt(changed);
    }
  }
  CHECK(refused > tried / 4);
}

TEST_CASE("read_surface_file: damaged surfaces are refused with place and value", "[io][unit]") {
  const auto refused = [](const std::string& name, const std::string& content) {
    const test_data::TemporaryFolder folder;
    write_file(folder / name, content);
    return refusal([&] { read_surface_file(folder / name); });
  };
  CHECK(refused("s.off", "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2 0.5 0.5 0.5\n") == "accepted");
  CHECK_THAT(refused("s.off", "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 3\n"), Contains("vertex 3"));
  CHECK_THAT(refused("s.off", "OFF\n900000000 1 0\n0 0 0\n"), Contains("line 2"));
  CHECK_THAT(refused("s.off", "OFF\n3 0 0\n0 0 0\n1 0 0\n0 1 0\n"), Contains("no facets"));
  CHECK_THAT(refused("s.ply",
                     "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\n"
                     "element face 1\nproperty list uchar int vertex_indices\n"
                     "end_header\n0\n3 0 0 5\n"),
             Contains("vertex 5"));
  CHECK_THAT(refused("s.ply",
                     "ply\nformat binary_little_endian 1.0\nelement vertex 2000000000\n"
                     "property float x\nend_header\n0000"),
             Contains("ends early"));
  CHECK_THAT(refused("s.ply", "ply\nformat ascii 1.0\nelement vertex 1\nproperty word x\n"),
             Contains("'word'"));
  CHECK_THAT(refused("s.stl", "solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nendloop\n"),
             Contains("line 5") && Contains("fewer than three"));
  CHECK_THAT(refused("s.obj", ""), Contains("'.obj'"));
}
