// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/grid/grid_frame.h"
#include "cvmesh/mesh/tet_mesh.h"
#include "cvmesh/metrics/facet_distances.h"

#include <nlohmann/json_fwd.hpp>

#include <cstddef>
#include <string>
#include <vector>

namespace cvmesh {

/// Arrays for a script to read: packed one after the other, deflated, in base64.
class PackedArrays {
 public:
  /// Adds an array under `name`; `type` is that of JavaScript's typed array.
  template <typename T>
  void add(const char* name, const char* type, const std::vector<T>& values) {
    append(name, type, values.data(), values.size(), sizeof(T));
  }

  /// name -> {type, offset in bytes, length}.
  [[nodiscard]] nlohmann::ordered_json directory() const;
  /// All bytes, in zlib's format, as base64.
  [[nodiscard]] std::string base64() const;

 private:
  struct Entry {
    std::string name, type;
    std::size_t offset = 0, length = 0;
  };

  void append(
      const char* name, const char* type, const void* data, std::size_t count, std::size_t size);

  std::vector<Entry> entries_;
  std::string bytes_;
};

/// What the 3-D view of the HTML report draws.
struct HtmlMesh {
  Vec3 lo, step;  ///< a point is lo + step * (its three 16-bit numbers), in the output's space
  std::size_t tets_left_out = 0;
  PackedArrays arrays;
};

/// Points in 16 bits an axis, tets and facets by index, and what they are coloured by:
/// `points`, `tets`, `tet_material`, `tet_ratio` (3r/R), `tet_min_angle` (degrees), `facets`,
/// `facet_sides`, `facet_ratio` (2r/R), `facet_distance` (mm). Shapes are in 16 bits, too: a
/// number of 65535 parts of 1, or of 180 degrees.
/// @param with_tets  false leaves out all tets, and the points that only they use
HtmlMesh pack_html_mesh(const TetMesh& mesh,
                        const FacetDistances& distances,
                        const Affine& mm_to_out,
                        bool with_tets = true);

}  // namespace cvmesh
