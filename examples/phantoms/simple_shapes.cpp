// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/core/error.h"

#include "phantoms/implicit.h"
#include "phantoms/phantoms.h"
#include <array>
#include <cmath>
#include <functional>
#include <string>

namespace cvmesh::examples {
namespace {

/// Voxels of 1 mm around the origin, `base` of them times `size`; `label_at` takes mm.
InputVolume sampled(const char* what,
                    const std::array<int, 3>& base,
                    double size,
                    const std::function<Label(const Vec3&)>& label_at) {
  require(size >= 0.5 && size <= 8, ErrorCode::BadParameter, what,
          "size (" + std::to_string(size) + ") is outside 0.5 to 8; choose one in between");
  GridFrame frame;
  frame.space = Space::Ras;
  for (int axis = 0; axis < 3; ++axis) {
    frame.dims[axis] = static_cast<int>(std::lround(base[axis] * size));
    frame.index_to_world.offset[axis] = -0.5 * (frame.dims[axis] - 1);
  }
  InputVolume volume(frame);
  for (int k = 0; k < frame.dims[2]; ++k) {
    for (int j = 0; j < frame.dims[1]; ++j) {
      for (int i = 0; i < frame.dims[0]; ++i) {
        volume(i, j, k) = label_at(Vec3{1.0 * i, 1.0 * j, 1.0 * k} + frame.index_to_world.offset);
      }
    }
  }
  return volume;
}

}  // namespace

InputVolume spheres(double size) {
  const Vec3 middle{-9 * size, 0, 0}, beside{16 * size, 0, 0};
  return sampled("spheres", {68, 44, 44}, size, [=](const Vec3& p) {
    if (distance(p, middle) < 9 * size) return 1;
    if (distance(p, middle) < 17 * size) return 2;
    return distance(p, beside) < 11 * size ? 3 : 0;
  });
}

InputVolume torus(double size) {
  return sampled("torus", {56, 56, 24}, size, [=](const Vec3& p) {
    return std::hypot(std::hypot(p.x, p.y) - 17 * size, p.z) < 7 * size ? 1 : 0;
  });
}

InputVolume plate(double size) {
  const Vec3 normal = normalized(Vec3{0.30, 0.15, 1});
  const Vec3 u = normalized(cross(Vec3{0, 1, 0}, normal));
  const Vec3 v = cross(normal, u);
  return sampled("plate", {48, 40, 28}, size, [=](const Vec3& p) {
    const bool is_inside = std::abs(dot(p, u)) < 18 * size && std::abs(dot(p, v)) < 13 * size &&
                           std::abs(dot(p, normal)) < 1;
    return is_inside ? 1 : 0;
  });
}

}  // namespace cvmesh::examples
