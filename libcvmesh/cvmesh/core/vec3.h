// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include <array>
#include <cmath>

namespace cvmesh {

/// A point or vector in three dimensions. Grid millimetres unless a name says otherwise.
struct Vec3 {
  double x = 0, y = 0, z = 0;

  double& operator[](int axis) { return axis == 0 ? x : axis == 1 ? y : z; }

  double operator[](int axis) const { return axis == 0 ? x : axis == 1 ? y : z; }

  Vec3& operator+=(const Vec3& b) {
    x += b.x;
    y += b.y;
    z += b.z;
    return *this;
  }

  Vec3& operator-=(const Vec3& b) {
    x -= b.x;
    y -= b.y;
    z -= b.z;
    return *this;
  }

  Vec3& operator*=(double s) {
    x *= s;
    y *= s;
    z *= s;
    return *this;
  }

  friend bool operator==(const Vec3&, const Vec3&) = default;
};

inline Vec3 operator+(Vec3 a, const Vec3& b) {
  return a += b;
}

inline Vec3 operator-(Vec3 a, const Vec3& b) {
  return a -= b;
}

inline Vec3 operator-(const Vec3& a) {
  return {-a.x, -a.y, -a.z};
}

inline Vec3 operator*(double s, Vec3 a) {
  return a *= s;
}

inline Vec3 operator*(Vec3 a, double s) {
  return a *= s;
}

inline Vec3 operator/(Vec3 a, double s) {
  return a *= 1 / s;
}

inline double dot(const Vec3& a, const Vec3& b) {
  return a.x * b.x + a.y * b.y + a.z * b.z;
}

inline Vec3 cross(const Vec3& a, const Vec3& b) {
  return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}

inline double squared_norm(const Vec3& a) {
  return dot(a, a);
}

inline double norm(const Vec3& a) {
  return std::sqrt(dot(a, a));
}

inline double distance(const Vec3& a, const Vec3& b) {
  return norm(a - b);
}

/// Unit vector along `a`; the zero vector stays zero.
inline Vec3 normalized(const Vec3& a) {
  const double n = norm(a);
  return n > 0 ? a / n : a;
}

/// Component-wise product and quotient: between index space and millimetres.
inline Vec3 scaled_by(const Vec3& a, const Vec3& s) {
  return {a.x * s.x, a.y * s.y, a.z * s.z};
}

inline Vec3 divided_by(const Vec3& a, const Vec3& s) {
  return {a.x / s.x, a.y / s.y, a.z / s.z};
}

/// Twice the area vector of triangle abc, along its normal (counter-clockwise seen from its tip).
inline Vec3 area_vector2(const Vec3& a, const Vec3& b, const Vec3& c) {
  return cross(b - a, c - a);
}

/// Six times the signed volume of tet abcd; positive when d is on the side that abc's normal shows.
inline double volume6(const Vec3& a, const Vec3& b, const Vec3& c, const Vec3& d) {
  return dot(cross(b - a, c - a), d - a);
}

/// Shape of a triangle, 2r/R (inscribed over circumscribed radius): 1 equilateral, 0 degenerate.
inline double triangle_quality(const Vec3& a, const Vec3& b, const Vec3& c) {
  const double la = distance(b, c), lb = distance(c, a), lc = distance(a, b);
  const double denominator = la * lb * lc * (la + lb + lc);
  return denominator > 0 ? 4 * squared_norm(area_vector2(a, b, c)) / denominator : 0;
}

/// The point of triangle abc nearest to p [Ericson 2005, §5.1.5].
Vec3 nearest_on_triangle(const Vec3& p, const Vec3& a, const Vec3& b, const Vec3& c);
/// The point of segment ab nearest to p.
Vec3 nearest_on_segment(const Vec3& p, const Vec3& a, const Vec3& b);

}  // namespace cvmesh
