// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/core/label.h"
#include "cvmesh/grid/grid_frame.h"
#include "cvmesh/labels/label_volume.h"
#include "cvmesh/mesh/interface_mesh.h"

#include <array>
#include <cstdint>
#include <string>
#include <vector>

// What the mesh and surface writers have in common.
namespace cvmesh {

/// The label that stands for the exterior in files: 0, or, where label 0 is a meshed material,
/// the largest negative number that is no label (-1, else -2, ...).
Label exterior_label(const LabelVolume& labels);

/// Material id -> label in files: the user's, and `exterior_label` for the exterior.
std::vector<Label> output_labels(const LabelVolume& labels);

/// The interfaces of a mesh, one row per distinct patch, ascending by (inside, outside, wall).
/// Files number them from 1.
struct InterfaceTable {
  std::vector<PatchKey> patches;
  std::vector<std::int32_t> index_of;  ///< per facet: 1-based row
};

InterfaceTable interface_table(const InterfaceMesh& mesh);

/// `inside label 3 "femur" | outside label 0 (exterior)`, and `, box face x-` for a wall. One line
/// whatever the name holds.
std::string describe_interface(const PatchKey& patch, const LabelVolume& labels);

/// Points under a map, and the vertex order that keeps orientation in the target space: a
/// mirroring map (negative determinant) swaps two vertices of every triangle and tet, so that
/// volumes stay positive and normals still point from inside to outside.
class Placement {
 public:
  explicit Placement(const Affine& mm_to_out)
      : map_(mm_to_out), is_mirroring_(mm_to_out.determinant() < 0) {}

  /// Without negative zeros, which only look like faults in text files.
  [[nodiscard]] Vec3 operator()(const Vec3& p) const { return map_(p) + Vec3{}; }

  [[nodiscard]] std::array<std::int32_t, 3> operator()(std::array<std::int32_t, 3> facet) const {
    if (is_mirroring_) std::swap(facet[1], facet[2]);
    return facet;
  }

  [[nodiscard]] std::array<std::int32_t, 4> operator()(std::array<std::int32_t, 4> tet) const {
    if (is_mirroring_) std::swap(tet[2], tet[3]);
    return tet;
  }

  /// The nodes on the edges of a tet, in the order of `TetMesh::mid_of`.
  [[nodiscard]] std::array<std::int32_t, 6> operator()(std::array<std::int32_t, 6> mids) const {
    if (is_mirroring_) {
      std::swap(mids[1], mids[4]);  // edges 12 and 13
      std::swap(mids[2], mids[3]);  // edges 20 and 03
    }
    return mids;
  }

 private:
  Affine map_;
  bool is_mirroring_;
};

/// Appends the shortest decimal text that reads back as the same number.
void append_number(std::string& text, double value);
void append_number(std::string& text, std::int64_t value);
/// The three coordinates in that form, between them `separator`.
void append_point(std::string& text, const Vec3& p, char separator);

/// `name` on one line: control characters become blanks.
std::string one_line(const std::string& name);

}  // namespace cvmesh
