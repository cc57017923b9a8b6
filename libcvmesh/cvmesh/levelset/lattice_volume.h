// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include <array>

namespace cvmesh {

/// What the piece of a boundary in one lattice cube says about the volume inside it, in voxels.
struct CubeVolume {
  bool is_cut = false;
  float lack = 0;   ///< volume of the voxels inside, as far as they lie in the cube, less that
                    ///< inside the boundary
  float slope = 0;  ///< how fast the volume inside grows when the field is raised everywhere
};

/// The part of a tet inside the zero set of the linear field with these values at its nodes.
inline float inside_part(const std::array<float, 4>& values) {
  std::array<float, 4> in{}, out{};
  int ins = 0, outs = 0;
  for (const float value : values) {
    if (value > 0)
      in[ins++] = value;
    else
      out[outs++] = value;
  }
  const auto cut = [](float from, float to) { return from / (from - to); };  // part of the edge
  switch (ins) {
    case 0:
      return 0;
    case 1:
      return cut(in[0], out[0]) * cut(in[0], out[1]) * cut(in[0], out[2]);
    case 2: {
      // Edges a and b from the first node inside, c and d from the second; split into three tets.
      const float a = cut(in[0], out[0]), b = cut(in[0], out[1]);
      const float c = cut(in[1], out[0]), d = cut(in[1], out[1]);
      return a * b + c * d * (1 - b) + c * b * (1 - a);
    }
    case 3:
      return 1 - cut(out[0], in[0]) * cut(out[0], in[1]) * cut(out[0], in[2]);
    default:
      return 1;
  }
}

/// The volume inside a field's zero set in one cube of the Freudenthal lattice, by the same six
/// tets that `extract_interfaces` cuts; exact for the piecewise linear surface.
///
/// @param corner  values at the corners; bit 0, 1, 2 of the index is the step along x, y, z
/// @param held    nodes of at most this magnitude are held by their constraint: tets at one of them
///                do not follow when the field is raised, and add only `kHeldShare` to the slope
inline CubeVolume volume_in_cube(const std::array<float, 8>& corner, float held) {
  constexpr float kHeldShare = 0.02F;
  constexpr float kRaise = 0.1F;  // small against a voxel, large against rounding
  constexpr std::array<std::array<int, 2>, 6> kTets = {
      {{1, 3}, {1, 5}, {2, 3}, {2, 6}, {4, 5}, {4, 6}}};
  int ins = 0;
  for (const float value : corner)
    ins += value > 0 ? 1 : 0;
  CubeVolume result;
  if (ins == 0 || ins == 8) return result;
  result.is_cut = true;
  for (const auto& [a, b] : kTets) {
    const std::array<float, 4> tet{corner[0], corner[a], corner[b], corner[7]};
    std::array<float, 4> raised = tet;
    int nodes_inside = 0;
    bool is_held = false;
    for (int c = 0; c < 4; ++c) {
      nodes_inside += tet[c] > 0 ? 1 : 0;
      is_held = is_held || (tet[c] < 0 ? -tet[c] : tet[c]) <= held;
      raised[c] += kRaise;
    }
    const float inside = inside_part(tet);
    // Each of the 24 tets around a node has a quarter of its sixth of a cube from that node.
    result.lack += (0.25F * static_cast<float>(nodes_inside) - inside) / 6;
    result.slope += (is_held ? kHeldShare : 1) * (inside_part(raised) - inside) / (6 * kRaise);
  }
  return result;
}

}  // namespace cvmesh
