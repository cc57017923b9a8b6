// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/report/html_mesh.h"
#include "cvmesh/report/html_report.h"

#include <nlohmann/json.hpp>

#include "metrics/simple_meshes.h"
#include "support/catch.h"
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <regex>
#include <string>
#include <vector>
#include <zlib.h>

using namespace cvmesh;
using Json = nlohmann::ordered_json;

namespace {

const std::string kHostile = "</script><script>alert(1)</script><!-- \u2028 & \xff {{three}}";

Report report_of_cube() {
  Report report;
  report.version = "1.2.3";
  report.input.file = kHostile;
  report.label_of = {0, 3, 9};
  report.name_of = {"exterior", kHostile, "bone"};
  report.warnings = {"labels: " + kHostile};
  return report;
}

std::string page_of_cube() {
  const TetMesh cube = simple_meshes::two_material_cube();
  return html_report(report_of_cube(), cube, measure_facet_distances(cube.surface, cube.surface, 1),
                     {});
}

/// The text of the script element with an id.
std::string script_of(const std::string& page, const std::string& id) {
  const std::size_t tag = page.find("id=\"" + id + "\">");
  REQUIRE(tag != std::string::npos);
  const std::size_t begin = page.find('>', tag) + 1;
  return page.substr(begin, page.find("</script>", begin) - begin);
}

std::string from_base64(const std::string& text) {
  const std::string digits = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string bytes;
  std::uint32_t group = 0;
  int bits = 0;
  for (const char c : text) {
    if (c == '=') break;
    const std::size_t digit = digits.find(c);
    REQUIRE(digit != std::string::npos);
    group = group << 6 | static_cast<std::uint32_t>(digit);
    bits += 6;
    if (bits < 8) continue;
    bits -= 8;
    bytes += static_cast<char>(group >> bits & 255);
  }
  return bytes;
}

std::string inflate_bytes(const std::string& bytes) {
  std::string result(1 << 20, '\0');
  uLongf size = result.size();
  REQUIRE(uncompress(reinterpret_cast<Bytef*>(result.data()), &size,
                     reinterpret_cast<const Bytef*>(bytes.data()), bytes.size()) == Z_OK);
  result.resize(size);
  return result;
}

template <typename T>
std::vector<T> array_of(const std::string& bytes, const Json& directory, const char* name) {
  std::vector<T> values(directory[name]["length"].get<std::size_t>());
  const auto offset = directory[name]["offset"].get<std::size_t>();
  REQUIRE(offset % sizeof(T) == 0);
  REQUIRE(offset + values.size() * sizeof(T) <= bytes.size());
  std::memcpy(values.data(), bytes.data() + offset, values.size() * sizeof(T));
  return values;
}

}  // namespace

TEST_CASE("html_report: texts of the user are data and never markup", "[report][unit]") {
  const std::string page = page_of_cube();
  CHECK(page.find("alert(1)</script>") == std::string::npos);
  const std::string text = script_of(page, "report-data");
  CHECK(text.find('<') == std::string::npos);
  CHECK(std::all_of(text.begin(), text.end(), [](char c) { return c >= ' ' && c <= '~'; }));
  const Json data = Json::parse(text);
  // What is no UTF-8 becomes U+FFFD; all the rest comes back as it was.
  std::string expected = kHostile;
  expected.replace(expected.find('\xff'), 1, "\uFFFD");
  CHECK(data["materials"][1]["name"] == expected);
  CHECK(data["report"]["input"]["file"] == expected);
  CHECK(data["report"]["results"]["warnings"][0] == "labels: " + expected);
}

TEST_CASE("html_report: is complete in itself", "[report][unit]") {
  const std::string page = page_of_cube();
  CHECK(page.rfind("<!DOCTYPE html>", 0) == 0);
  CHECK(page.find("</html>") != std::string::npos);
  // The only marker left is the one in the hostile name.
  const std::string data = script_of(page, "report-data");
  const auto count = [](const std::string& in, const std::string& what) {
    std::size_t found = 0;
    for (std::size_t at = in.find(what); at != std::string::npos; at = in.find(what, at + 1))
      ++found;
    return found;
  };
  for (const char* marker : {"{{style}}", "{{data}}", "{{arrays}}", "{{three}}",
                             "{{orbit_controls}}", "{{charts}}", "{{viewer}}", "{{report}}"}) {
    INFO(marker);
    CHECK(count(page, marker) == count(data, marker));
  }
  // Tags only; scripts may speak of addresses.
  const std::string tags = page.substr(0, page.find("<script>"));
  CHECK_FALSE(std::regex_search(tags, std::regex("(src|href|action)\\s*=")));
  CHECK(page.find("<script src") == std::string::npos);
  CHECK(page.find("<link") == std::string::npos);
  CHECK(page.find("default-src 'none'") != std::string::npos);
  CHECK(page.find("OrbitControls") != std::string::npos);
  // The scripts are 0.9 MB; a mesh of six tets adds next to nothing.
  CHECK(page.size() < 1'100'000);
}

TEST_CASE("html_report: histograms count every tet, angle and triangle", "[report][unit]") {
  const Json data = Json::parse(script_of(page_of_cube(), "report-data"));
  const TetMesh cube = simple_meshes::two_material_cube();
  const auto sum = [&](const char* name) {
    double total = 0;
    for (const double weight : data["histograms"][name]["weights"])
      total += weight;
    return total;
  };
  CHECK(sum("tet_ratio") == 6);
  CHECK(sum("dihedral_deg") == 36);
  CHECK(sum("triangle_ratio") == static_cast<double>(cube.surface.facets.size()));
  // Six faces of the cube, and the face between its halves.
  CHECK(sum("distance_mm") == Approx(6 + std::sqrt(2.0)));
}

TEST_CASE("html_report: without tets the page has the surface only", "[report][unit]") {
  TetMesh surface_only;
  surface_only.surface = simple_meshes::two_material_cube().surface;
  const FacetDistances distances =
      measure_facet_distances(surface_only.surface, surface_only.surface, 1);
  const std::string page = html_report(report_of_cube(), surface_only, distances, {});
  const Json data = Json::parse(script_of(page, "report-data"));
  CHECK_FALSE(data["histograms"].contains("tet_ratio"));
  CHECK(data["mesh"]["arrays"]["tets"]["length"] == 0);
  CHECK(data["mesh"]["arrays"]["facets"]["length"] == 3 * surface_only.surface.facets.size());
  CHECK(data["mesh"]["arrays"]["points"]["length"] == 3 * surface_only.surface.points.size());
}

TEST_CASE("html_report: the view of too many tets has the surface only", "[report][unit]") {
  TetMesh cube = simple_meshes::two_material_cube();
  cube.points.push_back({0.5, 0.5, 0.5});  // of the inside
  const FacetDistances distances = measure_facet_distances(cube.surface, cube.surface, 1);
  const std::size_t count = cube.tets.size();
  const auto data_of = [&](std::size_t most_tets) {
    return Json::parse(
        script_of(html_report(report_of_cube(), cube, distances, {}, most_tets), "report-data"));
  };
  const Json whole = data_of(count), surface = data_of(count - 1);
  CHECK(whole["mesh"]["tets_left_out"] == 0);
  CHECK(whole["mesh"]["arrays"]["tets"]["length"] == 4 * count);
  CHECK(whole["mesh"]["arrays"]["points"]["length"] == 3 * cube.points.size());
  CHECK(surface["mesh"]["tets_left_out"] == count);
  CHECK(surface["mesh"]["arrays"]["tets"]["length"] == 0);
  CHECK(surface["mesh"]["arrays"]["points"]["length"] == 3 * cube.surface.points.size());
  CHECK(surface["mesh"]["arrays"]["facets"]["length"] == 3 * cube.surface.facets.size());
  CHECK(surface["histograms"] == whole["histograms"]);
}

TEST_CASE("pack_html_mesh: the mesh comes back, points to 16 bits, in the output's space",
          "[report][unit]") {
  const TetMesh cube = simple_meshes::two_material_cube();
  // A left-handed map, as from LPS to RAS.
  const Affine mm_to_out{{Vec3{-2, 0, 0}, Vec3{0, 3, 0}, Vec3{0, 0, 1}}, {10, 20, 30}};
  const HtmlMesh mesh =
      pack_html_mesh(cube, measure_facet_distances(cube.surface, cube.surface, 1), mm_to_out);
  const Json directory = mesh.arrays.directory();
  const std::string bytes = inflate_bytes(from_base64(mesh.arrays.base64()));

  const auto points = array_of<std::uint16_t>(bytes, directory, "points");
  REQUIRE(points.size() == 3 * cube.points.size());
  for (std::size_t v = 0; v < cube.points.size(); ++v) {
    const Vec3 expected = mm_to_out(cube.points[v]);
    for (int axis = 0; axis < 3; ++axis)
      CHECK(mesh.lo[axis] + mesh.step[axis] * points[3 * v + axis] ==
            Approx(expected[axis]).margin(3.0 / 65535));
  }
  const auto tets = array_of<std::int32_t>(bytes, directory, "tets");
  const auto material = array_of<std::uint16_t>(bytes, directory, "tet_material");
  const auto angle = array_of<std::uint16_t>(bytes, directory, "tet_min_angle");
  REQUIRE(tets.size() == 4 * cube.tets.size());
  for (std::size_t t = 0; t < cube.tets.size(); ++t) {
    CHECK(std::equal(cube.tets[t].begin(), cube.tets[t].end(), tets.begin() + 4 * t));
    CHECK(material[t] == cube.material_of[t]);
    // All six are the tet of Kuhn, whose smallest dihedral angle is 45 degrees.
    CHECK(angle[t] / 65535.0 * 180 == Approx(45).margin(0.01));
  }
  const auto sides = array_of<std::uint16_t>(bytes, directory, "facet_sides");
  for (std::size_t f = 0; f < cube.surface.facets.size(); ++f) {
    CHECK(sides[2 * f] == cube.surface.patch_of[f].sides.inside);
    CHECK(sides[2 * f + 1] == cube.surface.patch_of[f].sides.outside);
  }
}
