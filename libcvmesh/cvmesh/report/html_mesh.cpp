// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/report/html_mesh.h"

#include "cvmesh/core/base64.h"
#include "cvmesh/core/box3.h"
#include "cvmesh/core/error.h"
#include "cvmesh/core/parallel.h"
#include "cvmesh/metrics/tet_quality.h"

#include <nlohmann/json.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <zlib.h>

namespace cvmesh {
namespace {

constexpr double kMost16 = 65535;
// Typed arrays must start at multiples of their element size; 8 serves all.
constexpr std::size_t kAlignment = 8;

std::uint16_t to_16_bits(double share) {
  return static_cast<std::uint16_t>(std::lround(std::clamp(share, 0.0, 1.0) * kMost16));
}

std::string deflate_bytes(const std::string& bytes) {
  uLongf size = compressBound(bytes.size());
  std::string result(size, '\0');
  const int code =
      compress2(reinterpret_cast<Bytef*>(result.data()), &size,
                reinterpret_cast<const Bytef*>(bytes.data()), bytes.size(), Z_DEFAULT_COMPRESSION);
  // With room for the bound, zlib can only run out of memory.
  require(code == Z_OK, ErrorCode::Limit, "report", "zlib is out of memory");
  result.resize(size);
  return result;
}

void pack_points(const std::vector<Vec3>& points, const Affine& mm_to_out, HtmlMesh& result) {
  Box3 box;
  for (const Vec3& p : points)
    box.add(mm_to_out(p));
  if (box.is_empty()) box.add({});
  result.lo = box.lo;
  result.step = box.extent() / kMost16;
  std::vector<std::uint16_t> packed;
  packed.reserve(3 * points.size());
  for (const Vec3& p : points) {
    const Vec3 from_lo = mm_to_out(p) - box.lo;
    for (int axis = 0; axis < 3; ++axis) {
      const double extent = box.extent()[axis];
      packed.push_back(extent > 0 ? to_16_bits(from_lo[axis] / extent) : std::uint16_t{0});
    }
  }
  result.arrays.add("points", "Uint16Array", packed);
}

void pack_tets(const TetMesh& mesh, PackedArrays& arrays) {
  std::vector<std::uint16_t> ratio(mesh.tets.size()), min_angle(mesh.tets.size());
  parallel_for_each_index(0, mesh.tets.size(), [&](std::size_t t) {
    const auto& [a, b, c, d] = mesh.tets[t];
    const TetShape shape =
        tet_shape(mesh.points[a], mesh.points[b], mesh.points[c], mesh.points[d]);
    ratio[t] = to_16_bits(shape.radius_ratio);
    min_angle[t] =
        to_16_bits(*std::min_element(shape.dihedral_deg.begin(), shape.dihedral_deg.end()) / 180);
  });
  std::vector<std::int32_t> corners;
  corners.reserve(4 * mesh.tets.size());
  for (const auto& tet : mesh.tets)
    corners.insert(corners.end(), tet.begin(), tet.end());
  arrays.add("tets", "Int32Array", corners);
  arrays.add("tet_material", "Uint16Array", mesh.material_of);
  arrays.add("tet_ratio", "Uint16Array", ratio);
  arrays.add("tet_min_angle", "Uint16Array", min_angle);
}

void pack_facets(const InterfaceMesh& surface,
                 const FacetDistances& distances,
                 PackedArrays& arrays) {
  std::vector<std::int32_t> corners;
  std::vector<std::uint16_t> sides, ratio;
  for (std::size_t f = 0; f < surface.facets.size(); ++f) {
    const auto& [a, b, c] = surface.facets[f];
    corners.insert(corners.end(), {a, b, c});
    sides.push_back(surface.patch_of[f].sides.inside);
    sides.push_back(surface.patch_of[f].sides.outside);
    ratio.push_back(
        to_16_bits(triangle_quality(surface.points[a], surface.points[b], surface.points[c])));
  }
  arrays.add("facets", "Int32Array", corners);
  arrays.add("facet_sides", "Uint16Array", sides);
  arrays.add("facet_ratio", "Uint16Array", ratio);
  arrays.add("facet_distance", "Float32Array", distances.largest_mm);
}

}  // namespace

void PackedArrays::append(
    const char* name, const char* type, const void* data, std::size_t count, std::size_t size) {
  bytes_.resize((bytes_.size() + kAlignment - 1) / kAlignment * kAlignment, '\0');
  entries_.push_back({name, type, bytes_.size(), count});
  bytes_.append(static_cast<const char*>(data), count * size);
}

nlohmann::ordered_json PackedArrays::directory() const {
  nlohmann::ordered_json object = nlohmann::ordered_json::object();
  for (const Entry& entry : entries_)
    object[entry.name] = {{"type", entry.type}, {"offset", entry.offset}, {"length", entry.length}};
  return object;
}

std::string PackedArrays::base64() const {
  std::string text;
  append_base64(deflate_bytes(bytes_), text);
  return text;
}

HtmlMesh pack_html_mesh(const TetMesh& mesh,
                        const FacetDistances& distances,
                        const Affine& mm_to_out,
                        bool with_tets) {
  HtmlMesh result;
  if (with_tets && !mesh.tets.empty()) {
    pack_points(mesh.points, mm_to_out, result);
    pack_tets(mesh, result.arrays);
  } else {
    pack_points(mesh.surface.points, mm_to_out, result);
    pack_tets({}, result.arrays);
    result.tets_left_out = mesh.tets.size();
  }
  pack_facets(mesh.surface, distances, result.arrays);
  return result;
}

}  // namespace cvmesh
