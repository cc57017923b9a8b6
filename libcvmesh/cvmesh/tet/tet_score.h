// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/core/vec3.h"
#include "cvmesh/core/vec3_pair.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <limits>
#include <optional>

namespace cvmesh {

/// How good a tet is, by the two measures that meshes are judged by.
struct TetScore {
  double min_sine = 0;      ///< of the six dihedral angles; 0 when flat, negative when inverted
  double radius_ratio = 0;  ///< 3 r / R, 1 when regular, 0 when flat or inverted
};

/// What the scores of all tets on one face abc have in common.
template <typename V>
struct BaseTerms {
  using Real = decltype(V::x);

  BaseTerms(const V& corner_a, const V& corner_b, const V& corner_c)
      : a(corner_a),
        b(corner_b),
        c(corner_c),
        u(b - a),
        v(c - a),
        face_d(cross(v, u)),
        area2_d(squared_norm(face_d)),
        ab(squared_norm(u)),
        ac(squared_norm(v)),
        bc(squared_norm(c - b)) {}

  V a, b, c, u, v;
  V face_d;  // twice the area vector, towards the tet's outside
  Real area2_d, ab, ac, bc;
};

/// What both measures of tet abcd are made of: of one tet, or of two at a time (`Vec3Pair`), with
/// the same operations in the same order.
template <typename V>
struct TetTerms {
  using Real = decltype(V::x);

  [[gnu::always_inline]] TetTerms(const BaseTerms<V>& base, const V& d) {
    // All from one corner: u, v, w span the tet, and the area vectors of its faces follow from the
    // three cross products (they sum to zero).
    const V w = d - base.a;
    const V face_b = cross(w, base.v), face_c = cross(base.u, w);
    const V face_a = -(face_b + face_c + base.face_d);
    volume = -dot(base.u, face_b);
    area2_a = squared_norm(face_a);
    area2_b = squared_norm(face_b);
    area2_c = squared_norm(face_c);
    area2_d = base.area2_d;
    const Real &ab = base.ab, &ac = base.ac, &bc = base.bc;
    const Real ad = squared_norm(w), bd = squared_norm(d - base.b), cd = squared_norm(d - base.c);
    // sin(dihedral at edge e) = 3 V |e| / (2 A B), A and B the areas of the two faces on e: in six
    // volumes and doubled areas, volume |e| / (A B). An edge's faces are those opposite the two
    // other corners; over the product of all four areas, the other two stand above the line.
    at_edge = {ab * area2_a * area2_b, ac * area2_a * area2_c, ad * area2_a * area2_d,
               bc * area2_b * area2_c, bd * area2_b * area2_d, cd * area2_c * area2_d};
    product = (area2_a * area2_b) * (area2_c * area2_d);
    opposite_ab = ab * cd;
    opposite_ac = ac * bd;
    opposite_ad = ad * bc;
  }

  /// Heron's product of the products of opposite edges: 24 V R is its root.
  [[nodiscard]] Real heron() const {
    const Real &x = opposite_ab, &y = opposite_ac, &z = opposite_ad;
    return 2 * (x * y + y * z + z * x) - (x * x + y * y + z * z);
  }

  Real volume;                                 // six times the tet's
  Real area2_a, area2_b, area2_c, area2_d;     // squares of twice the areas of the faces
  std::array<Real, 6> at_edge;                 // squared sine times product over squared volume
  Real product;                                // of the four squares
  Real opposite_ab, opposite_ac, opposite_ad;  // edge times opposite edge, squared
};

/// The score of tet abcd; its radius ratio stays 0 where the smallest sine is below `floor`.
inline TetScore score_any_tet(
    const Vec3& a, const Vec3& b, const Vec3& c, const Vec3& d, double floor) {
  const TetTerms<Vec3> terms(BaseTerms<Vec3>(a, b, c), d);
  const double volume = terms.volume;
  // A face without area makes the sines meaningless; so does a product that underflows.
  if (!(terms.product > 0)) return {volume < 0 ? -1.0 : 0.0, 0};
  double least = terms.at_edge[0], most = terms.at_edge[0];
  for (std::size_t e = 1; e < 6; ++e) {
    least = std::min(terms.at_edge[e], least);
    most = std::max(terms.at_edge[e], most);
  }
  TetScore score;
  score.min_sine = volume * std::sqrt((volume > 0 ? least : most) / terms.product);
  if (!(volume > 0) || score.min_sine < floor) return score;
  // r = 3 V / sum of areas
  const double heron = terms.heron();
  const double areas = std::sqrt(terms.area2_a) + std::sqrt(terms.area2_b) +
                       std::sqrt(terms.area2_c) + std::sqrt(terms.area2_d);
  if (heron > 0) score.radius_ratio = 12 * volume * volume / (areas * std::sqrt(heron));
  return score;
}

/// The scores of two tets at a time; nothing where one of them has a sine below `floor`.
/// @pre floor > 0
inline std::optional<std::array<TetScore, 2>> score_two_tets(
    const Vec3Pair& a, const Vec3Pair& b, const Vec3Pair& c, const Vec3Pair& d, double floor) {
  const TetTerms<Vec3Pair> terms(BaseTerms<Vec3Pair>(a, b, c), d);
  const DoublePair& volume = terms.volume;
  if (!(volume[0] > 0 && volume[1] > 0)) return std::nullopt;
  DoublePair least = terms.at_edge[0];
  for (std::size_t e = 1; e < 6; ++e)
    least = smaller_of(terms.at_edge[e], least);
  const DoublePair sine = volume * square_root(least / terms.product);
  // not so either where a face has no area
  if (!(sine[0] >= floor && sine[1] >= floor)) return std::nullopt;
  const DoublePair heron = terms.heron();
  const DoublePair areas = square_root(terms.area2_a) + square_root(terms.area2_b) +
                           square_root(terms.area2_c) + square_root(terms.area2_d);
  const DoublePair ratio =
      heron > 0 ? 12 * volume * volume / (areas * square_root(heron)) : DoublePair{};
  return std::array<TetScore, 2>{{{sine[0], ratio[0]}, {sine[1], ratio[1]}}};
}

/// The score of tet abcd. For changes that are refused anyway it saves the time: below `floor` the
/// radius ratio stays 0, and below a floor above 0 all flat and inverted tets get a sine of -1.
inline TetScore score_tet(const Vec3& a,
                          const Vec3& b,
                          const Vec3& c,
                          const Vec3& d,
                          double floor = -std::numeric_limits<double>::infinity()) {
  if (floor > 0 && !(dot(b - a, cross(c - a, d - a)) > 0)) return {-1, 0};
  return score_any_tet(a, b, c, d, floor);
}

/// Smallest sine of the dihedral angles of tet abcd, negative when the tet is inverted, 0 when it
/// is flat.
inline double min_dihedral_sine(const Vec3& a, const Vec3& b, const Vec3& c, const Vec3& d) {
  return score_any_tet(a, b, c, d, std::numeric_limits<double>::infinity()).min_sine;
}

/// The same for two tets, with d on their bases.
inline DoublePair min_dihedral_sines(const BaseTerms<Vec3Pair>& bases, const Vec3& d) {
  const TetTerms<Vec3Pair> terms(bases, {d, d});
  const DoublePair& volume = terms.volume;
  DoublePair least = terms.at_edge[0], most = least;
  for (std::size_t e = 1; e < 6; ++e) {
    least = smaller_of(terms.at_edge[e], least);
    most = larger_of(terms.at_edge[e], most);
  }
  const DoublePair sine = volume * square_root((volume > 0 ? least : most) / terms.product);
  return terms.product > 0 ? sine : volume < 0 ? both(-1) : both(0);
}

}  // namespace cvmesh
