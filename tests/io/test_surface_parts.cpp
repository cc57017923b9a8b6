// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/io/surface_parts.h"
#include "cvmesh/tet/split_contacts.h"

#include "io/image_files.h"
#include "io/writer_meshes.h"
#include "support/catch.h"
#include "support/test_data.h"
#include <cstring>

using namespace cvmesh;
using namespace cvmesh::image_files;
using namespace cvmesh::writer_meshes;

namespace {

using Triangle = std::array<Vec3, 3>;

/// Six times the volume that the triangles enclose, normals outwards.
double enclosed6(const std::vector<Triangle>& triangles) {
  double sum = 0;
  for (const Triangle& t : triangles)
    sum += dot(t[0], cross(t[1], t[2]));
  return sum;
}

double volume6_of(const TetMesh& mesh, MaterialId material) {
  double sum = 0;
  for (std::size_t t = 0; t < mesh.tets.size(); ++t) {
    if (mesh.material_of[t] != material) continue;
    const auto at = [&](std::size_t k) {
      return mesh.points[static_cast<std::size_t>(mesh.tets[t][k])];
    };
    sum += volume6(at(0), at(1), at(2), at(3));
  }
  return sum;
}

template <typename T>
T load(const std::string& bytes, std::size_t at) {
  T value;
  std::memcpy(&value, bytes.data() + at, sizeof value);
  return value;
}

std::vector<Triangle> read_stl(const std::filesystem::path& path, std::string& header) {
  const std::string bytes = read_file(path);
  header = bytes.substr(0, 80);
  const auto count = load<std::uint32_t>(bytes, 80);
  REQUIRE(bytes.size() == 84 + 50 * std::size_t{count});
  std::vector<Triangle> triangles(count);
  for (std::size_t i = 0; i < count; ++i) {
    std::array<Vec3, 4> v;
    for (std::size_t k = 0; k < 12; ++k)
      v[k / 3][static_cast<int>(k % 3)] = load<float>(bytes, 84 + 50 * i + 4 * k);
    triangles[i] = {v[1], v[2], v[3]};
    CHECK(dot(v[0], normalized(area_vector2(v[1], v[2], v[3]))) > 0.999);
  }
  return triangles;
}

std::vector<Triangle> read_ply(const std::filesystem::path& path, std::string& header) {
  const std::string bytes = read_file(path);
  std::size_t at = bytes.find("end_header\n") + 11;
  header = bytes.substr(0, at);
  const auto count_of = [&](const std::string& element) {
    return std::stoul(header.substr(header.find("element " + element) + 9 + element.size()));
  };
  std::vector<Vec3> points(count_of("vertex"));
  for (Vec3& p : points)
    for (int axis = 0; axis < 3; ++axis, at += 8)
      p[axis] = load<double>(bytes, at);
  std::vector<Triangle> triangles(count_of("face"));
  for (Triangle& t : triangles) {
    CHECK(bytes[at++] == 3);
    for (Vec3& corner : t) {
      corner = points.at(static_cast<std::size_t>(load<std::int32_t>(bytes, at)));
      at += 4;
    }
  }
  CHECK(at == bytes.size());
  return triangles;
}

}  // namespace

TEST_CASE("surface_parts: a closed boundary per label and every interface, cut or not",
          "[io][unit]") {
  for (const bool is_cut : {false, true}) {
    CAPTURE(is_cut);
    TetMesh mesh = cube(false);
    if (is_cut) split_contacts(mesh, {{2, 1}});
    const auto parts = surface_parts(mesh.surface, named("soft", "bone"));
    std::vector<std::string> names;
    for (const SurfacePart& part : parts)
      names.push_back(part.name);
    using Names = std::vector<std::string>;
    const Names expected =
        is_cut
            ? Names{"label_-7",         "label_300",       "interface_-7_0",  "interface_-7_0_xmin",
                    "interface_-7_300", "interface_300_0", "interface_300_-7"}
            : Names{"label_-7",        "label_300",       "interface_-7_0", "interface_-7_0_xmin",
                    "interface_300_0", "interface_300_-7"};
    CHECK(names == expected);
    for (const std::size_t m : {0U, 1U}) {
      std::vector<Triangle> triangles;
      for (const auto& facet : parts[m].mesh.facets) {
        Triangle& t = triangles.emplace_back();
        for (std::size_t k = 0; k < 3; ++k)
          t[k] = parts[m].mesh.points.at(static_cast<std::size_t>(facet[k]));
      }
      CHECK(enclosed6(triangles) ==
            Approx(volume6_of(mesh, static_cast<MaterialId>(m + 1))).epsilon(1e-12));
      for (const PatchKey& patch : parts[m].mesh.patch_of)
        CHECK(patch.sides.inside == m + 1);
    }
  }
}

TEST_CASE("write_stl, write_ply: space, label and triangles read back", "[io][unit]") {
  const test_data::TemporaryFolder folder;
  const LabelVolume labels = named("soft\ntissue", "bone");
  for (const bool is_mirrored : {false, true}) {
    const Affine map = oblique(is_mirrored);
    const TetMesh mesh = cube(false);
    const double scale = std::abs(map.determinant());
    const SurfacePart bone = surface_parts(mesh.surface, labels)[1];
    std::string header;
    write_stl(folder / "a.stl", bone, map, Space::Lps);
    const auto stl = read_stl(folder / "a.stl", header);
    CHECK(header.rfind("cvmesh SPACE=LPS mm, label 300 \"bone\"", 0) == 0);
    CHECK(stl.size() == bone.mesh.facets.size());
    // Single precision at coordinates of 140 mm: 1e-5 mm over a cube of 12 mm.
    CHECK(enclosed6(stl) == Approx(scale * volume6_of(mesh, 2)).epsilon(1e-3));

    write_ply(folder / "a.ply", bone, map, Space::Lps);
    const auto ply = read_ply(folder / "a.ply", header);
    CHECK(header.find("comment cvmesh SPACE=LPS mm, label 300 \"bone\"\n") != std::string::npos);
    CHECK(enclosed6(ply) == Approx(scale * volume6_of(mesh, 2)).epsilon(1e-9));
  }
}

TEST_CASE("is_surface_part_file: names of parts, and nothing else", "[io][unit]") {
  for (const char* file :
       {"a.label_3.stl", "a.label_-3.ply", "a.interface_3_0.vtp", "a.interface_-3_2_zmax.stl"})
    CHECK(is_surface_part_file(file, "a"));
  for (const char* file : {"a.stl", "b.label_3.stl", "a.label_3.vtu", "a.label_bone.stl",
                           "a.interface_3.stl", "a.interface_3_2_xmid.stl", "ab.label_3.stl"})
    CHECK_FALSE(is_surface_part_file(file, "a"));
}
