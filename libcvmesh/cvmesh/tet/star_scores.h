// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/core/vec3.h"
#include "cvmesh/tet/tet_goal.h"

#include <cstddef>
#include <vector>

namespace cvmesh {

/// The tets around a vertex, ready to be scored for one place of the vertex after the other.
///
/// Four tets at a time, so that compilers make vectors of the arithmetic, and with all that does
/// not depend on the place worked out beforehand. Every lane does what a processor without vectors
/// would do, in the same order: the results are the same on all of them.
class StarScores {
 public:
  void clear();

  /// A tet, by its face opposite the vertex: counter-clockwise when seen from outside the tet.
  void add(const Vec3& a, const Vec3& b, const Vec3& c);

  /// Smallest sine and radius ratios, as `score_tet` defines them, with the vertex at p; of a tet
  /// that is inverted the sine is just some number below 0. Stops once a sine is below `floor`.
  [[nodiscard]] TetQuality quality_at(const Vec3& p, double floor) const;

 private:
  static constexpr std::size_t kLanes = 4;
  /// A vector extension that GCC and Clang share; two registers where they hold two doubles.
  using Lanes [[gnu::vector_size(32)]] = double;

  struct Points {
    Lanes x, y, z;
  };

  struct alignas(sizeof(Lanes)) Faces {
    Points a, b, c;           ///< the corners
    Points area_vector;       ///< twice the area, out of the tet
    Lanes area2, root_area2;  ///< its squared length, and its length
    Lanes ab, bc, ca;         ///< squared lengths of the edges
  };

  /// For `count` tets, in blocks of which the last may be padded.
  static TetQuality score(const Faces* faces, std::size_t count, const Vec3& p, double floor);

  std::vector<Faces> faces_;
  std::size_t count_ = 0;
};

}  // namespace cvmesh
