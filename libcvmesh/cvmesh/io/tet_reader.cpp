// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/io/tet_reader.h"

#include "cvmesh/io/byte_source.h"

#include <algorithm>
#include <cmath>

namespace cvmesh {
namespace detail {

std::optional<Space> space_of_name(const std::string& name) {
  for (const Space space : {Space::Ras, Space::Lps, Space::Las, Space::Grid})
    if (name == space_name(space)) return space;
  return std::nullopt;
}

}  // namespace detail

namespace {

void check(const std::filesystem::path& path, const TetFile& file) {
  if (file.tets.empty())
    detail::refuse_file(path, "has no tetrahedra, but " + std::to_string(file.other_elements) +
                                  " other elements; give a mesh of tetrahedra");
  for (std::size_t v = 0; v < file.points.size(); ++v) {
    const Vec3& p = file.points[v];
    if (!std::isfinite(p.x) || !std::isfinite(p.y) || !std::isfinite(p.z))
      detail::refuse_file(path, "point " + std::to_string(v) + " is not finite");
  }
  const auto points = std::ssize(file.points);
  for (std::size_t t = 0; t < file.tets.size(); ++t)
    for (const std::int32_t v : file.tets[t])
      if (v < 0 || v >= points)
        detail::refuse_file(path, "tetrahedron " + std::to_string(t) + " has the vertex " +
                                      std::to_string(v) + " (counted from 0), but there are " +
                                      std::to_string(points) + " points");
}

}  // namespace

TetFile read_tet_file(const std::filesystem::path& path) {
  const std::string suffix = path.extension().string();
  const auto read = suffix == ".vtu"    ? &detail::read_vtu
                    : suffix == ".mesh" ? &detail::read_medit
                    : suffix == ".msh"  ? &detail::read_gmsh
                                        : nullptr;
  if (read == nullptr)
    detail::refuse_file(path, "has the suffix '" + suffix + "'; give a .vtu, .mesh or .msh file");
  TetFile file = read(path, detail::read_content(path));
  check(path, file);
  return file;
}

}  // namespace cvmesh
