// SPDX-License-Identifier: AGPL-3.0-or-later
#include "support/phantoms.h"

#include "cvmesh/core/random.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>

namespace cvmesh::phantoms {
namespace {

double radians(double degrees) {
  return degrees * std::numbers::pi / 180;
}

Vec3 turned(const Vec3& p, const Vec3& unit_axis, double angle) {  // Rodrigues' formula
  const double c = std::cos(angle), s = std::sin(angle);
  return c * p + s * cross(unit_axis, p) + (1 - c) * dot(unit_axis, p) * unit_axis;
}

// The direction "tilted from z": towards x by the whole angle, then towards y by half of it.
Vec3 tilted_z(double tilt_deg) {
  const Vec3 once = turned({0, 0, 1}, {0, 1, 0}, radians(tilt_deg));
  return turned(once, {1, 0, 0}, -radians(tilt_deg) / 2);
}

// Half the extent along each axis of a flat-ended cylinder around unit direction `d`.
Vec3 cylinder_half_size(const Vec3& d, double half_length, double radius) {
  const auto extent = [&](double c) {
    return half_length * std::abs(c) + radius * std::sqrt(std::max(0.0, 1 - c * c));
  };
  return {extent(d.x), extent(d.y), extent(d.z)};
}

Label box_index(double coordinate, double half) {
  return std::abs(coordinate) < half ? 1 : 0;
}

}  // namespace

GridFrame centred_frame(const std::array<int, 3>& dims, const Vec3& spacing_mm) {
  GridFrame frame;
  frame.dims = dims;
  frame.spacing_mm = spacing_mm;
  frame.space = Space::Ras;
  frame.index_to_world.rows = {Vec3{spacing_mm.x, 0, 0}, Vec3{0, spacing_mm.y, 0},
                               Vec3{0, 0, spacing_mm.z}};
  for (int axis = 0; axis < 3; ++axis) {
    frame.index_to_world.offset[axis] = -0.5 * (dims[axis] - 1) * spacing_mm[axis];
  }
  return frame;
}

GridFrame frame_around(const Vec3& half_mm, const Vec3& spacing_mm) {
  std::array<int, 3> dims{};
  for (int axis = 0; axis < 3; ++axis) {
    dims[axis] = 2 * (static_cast<int>(std::ceil(half_mm[axis] / spacing_mm[axis])) + kMargin) + 1;
  }
  return centred_frame(dims, spacing_mm);
}

InputVolume sample(const GridFrame& frame, const std::function<Label(const Vec3&)>& label_at) {
  InputVolume volume(frame);
  const auto centre = [&](int index, int axis) {
    return (index - 0.5 * (frame.dims[axis] - 1)) * frame.spacing_mm[axis];
  };
  for (int k = 0; k < frame.dims[2]; ++k) {
    for (int j = 0; j < frame.dims[1]; ++j) {
      for (int i = 0; i < frame.dims[0]; ++i) {
        volume(i, j, k) = label_at({centre(i, 0), centre(j, 1), centre(k, 2)});
      }
    }
  }
  return volume;
}

InputVolume ball(double radius_mm, const Vec3& spacing_mm, Label label) {
  return sample(frame_around(radius_mm * Vec3{1, 1, 1}, spacing_mm),
                [&](const Vec3& p) { return norm(p) < radius_mm ? label : 0; });
}

InputVolume nested_balls(double inner_mm, double outer_mm, const Vec3& spacing_mm) {
  return sample(frame_around(outer_mm * Vec3{1, 1, 1}, spacing_mm), [&](const Vec3& p) {
    const double r = norm(p);
    return r < inner_mm ? 1 : r < outer_mm ? 2 : 0;
  });
}

InputVolume touching_balls(double radius_mm, const Vec3& spacing_mm) {
  // Balls of radius r whose centres are h from a plane cut it in a disc of radius sqrt(r² - h²).
  const double h = radius_mm * std::sqrt(0.75);
  return sample(frame_around({radius_mm + h, radius_mm, radius_mm}, spacing_mm),
                [&](const Vec3& p) -> Label {
                  if (p.x < 0) return norm(p + Vec3{h, 0, 0}) < radius_mm ? 1 : 0;
                  return norm(p - Vec3{h, 0, 0}) < radius_mm ? 2 : 0;
                });
}

InputVolume touching_boxes(const std::array<int, 3>& size_vox, const Vec3& spacing_mm) {
  const std::array<int, 3> dims{2 * size_vox[0] + 2 * kMargin, size_vox[1] + 2 * kMargin,
                                size_vox[2] + 2 * kMargin};
  const Vec3 half{size_vox[0] * spacing_mm.x, 0.5 * size_vox[1] * spacing_mm.y,
                  0.5 * size_vox[2] * spacing_mm.z};
  return sample(centred_frame(dims, spacing_mm), [&](const Vec3& p) {
    const Label inside = box_index(p.x, half.x) * box_index(p.y, half.y) * box_index(p.z, half.z);
    return inside * (p.x < 0 ? 1 : 2);
  });
}

InputVolume three_material_wedge(double angle_deg, double radius_mm, const Vec3& spacing_mm) {
  const double half_angle = radians(angle_deg) / 2;
  return sample(frame_around(radius_mm * Vec3{1, 1, 1}, spacing_mm), [&](const Vec3& p) -> Label {
    if (norm(p) >= radius_mm) return 0;
    if (std::abs(std::atan2(p.y, p.x)) < half_angle) return 1;
    return p.y > 0 ? 2 : 3;
  });
}

InputVolume four_material_corner(double radius_mm, const Vec3& spacing_mm) {
  // A tetrahedron in general position: none of the interfaces lies in a lattice plane.
  std::array<Vec3, 4> directions{Vec3{1, 1, 1}, Vec3{1, -1, -1}, Vec3{-1, 1, -1}, Vec3{-1, -1, 1}};
  for (Vec3& d : directions)
    d = turned(d, normalized(Vec3{3, 1, 2}), radians(25));
  return sample(frame_around(radius_mm * Vec3{1, 1, 1}, spacing_mm), [&](const Vec3& p) -> Label {
    if (norm(p) >= radius_mm) return 0;
    const auto best =
        std::max_element(directions.begin(), directions.end(),
                         [&](const Vec3& a, const Vec3& b) { return dot(a, p) < dot(b, p); });
    return static_cast<Label>(best - directions.begin()) + 1;
  });
}

InputVolume torus(double major_mm, double minor_mm, const Vec3& spacing_mm) {
  const double reach = major_mm + minor_mm;
  return sample(frame_around({reach, reach, minor_mm}, spacing_mm), [&](const Vec3& p) {
    return std::hypot(std::hypot(p.x, p.y) - major_mm, p.z) < minor_mm ? 1 : 0;
  });
}

InputVolume thin_plate(double thickness_mm, double tilt_deg, const Vec3& spacing_mm) {
  constexpr double kHalfSide = 12;
  const Vec3 normal = tilted_z(tilt_deg);
  const Vec3 u = normalized(cross(Vec3{0, 1, 0}, normal));
  const Vec3 v = cross(normal, u);
  Vec3 half;
  for (int axis = 0; axis < 3; ++axis) {
    half[axis] = kHalfSide * (std::abs(u[axis]) + std::abs(v[axis])) +
                 0.5 * thickness_mm * std::abs(normal[axis]);
  }
  return sample(frame_around(half, spacing_mm), [&](const Vec3& p) {
    return box_index(dot(p, u), kHalfSide) * box_index(dot(p, v), kHalfSide) *
           box_index(dot(p, normal), 0.5 * thickness_mm);
  });
}

InputVolume rod(double radius_mm, double tilt_deg, const Vec3& spacing_mm) {
  constexpr double kHalfLength = 12;
  const Vec3 direction = tilted_z(tilt_deg);
  const Vec3 half = cylinder_half_size(direction, kHalfLength, radius_mm);
  return sample(frame_around(half, spacing_mm), [&](const Vec3& p) {
    const double along = dot(p, direction);
    const double away = norm(p - along * direction);
    return std::abs(along) < kHalfLength && away < radius_mm ? 1 : 0;
  });
}

InputVolume one_voxel_island(double radius_mm, const Vec3& spacing_mm) {
  InputVolume volume = ball(radius_mm, spacing_mm);
  // Two voxels inside the corner: background all around, out of the ball's lattice reach.
  volume(2, 2, 2) = 1;
  return volume;
}

InputVolume one_voxel_label(double radius_mm, const Vec3& spacing_mm) {
  InputVolume volume = ball(radius_mm, spacing_mm);
  const auto& dims = volume.frame.dims;
  volume(dims[0] / 2, dims[1] / 2, dims[2] / 2) = 2;
  return volume;
}

InputVolume box_without_background(const std::array<int, 3>& dims, const Vec3& spacing_mm) {
  const GridFrame frame = centred_frame(dims, spacing_mm);
  const Vec3 size = frame.index_to_mm({1.0 * dims[0], 1.0 * dims[1], 1.0 * dims[2]});
  const double radius = 0.3 * std::min(size.x, std::min(size.y, size.z));
  return sample(frame, [&](const Vec3& p) { return norm(p) < radius ? 2 : 1; });
}

InputVolume random_blobs(std::uint64_t seed, int n_labels, int side_vox, const Vec3& spacing_mm) {
  struct Blob {
    Vec3 centre;  // mm
    double radius;
  };

  const CounterRandom random(seed, "random_blobs");
  const double reach = 0.5 * side_vox - kMargin;  // voxels
  std::vector<Blob> blobs;
  for (int n = 0; n < n_labels; ++n) {
    const double radius = reach * (0.35 + 0.3 * random.uniform(n, 3));
    Vec3 centre;
    for (int axis = 0; axis < 3; ++axis) {
      centre[axis] = (2 * random.uniform(n, axis) - 1) * (reach - radius) * spacing_mm[axis];
    }
    blobs.push_back({centre, radius});
  }
  InputVolume volume =
      sample(centred_frame({side_vox, side_vox, side_vox}, spacing_mm), [&](const Vec3& p) {
        Label winner = 0;
        double depth = 0;
        for (int n = 0; n < n_labels; ++n) {
          const double r = norm(divided_by(p - blobs[n].centre, spacing_mm));
          if (1 - r / blobs[n].radius > depth) {
            depth = 1 - r / blobs[n].radius;
            winner = n + 1;
          }
        }
        return winner;
      });
  // The voxel nearest to a blob's centre belongs to it, whoever overlaps it.
  for (int n = 0; n < n_labels; ++n) {
    const Vec3 index =
        divided_by(blobs[n].centre, spacing_mm) + 0.5 * (side_vox - 1) * Vec3{1, 1, 1};
    volume(static_cast<int>(std::lround(index.x)), static_cast<int>(std::lround(index.y)),
           static_cast<int>(std::lround(index.z))) = n + 1;
  }
  return volume;
}

InputVolume checkerboard(int cube_vox, int cubes, const Vec3& spacing_mm) {
  const int side = cube_vox * cubes;
  InputVolume volume(
      centred_frame({side + 2 * kMargin, side + 2 * kMargin, side + 2 * kMargin}, spacing_mm));
  for (int k = 0; k < side; ++k) {
    for (int j = 0; j < side; ++j) {
      for (int i = 0; i < side; ++i) {
        volume(i + kMargin, j + kMargin, k + kMargin) =
            1 + (i / cube_vox + j / cube_vox + k / cube_vox) % 2;
      }
    }
  }
  return volume;
}

InputVolume voxel_noise(std::uint64_t seed, int n_labels, int side_vox) {
  const CounterRandom random(seed, "voxel_noise");
  const int outer = side_vox + 2 * kMargin;
  InputVolume volume(centred_frame({outer, outer, outer}));
  std::uint64_t voxel = 0;
  for (int k = kMargin; k < kMargin + side_vox; ++k) {
    for (int j = kMargin; j < kMargin + side_vox; ++j) {
      for (int i = kMargin; i < kMargin + side_vox; ++i) {
        volume(i, j, k) =
            static_cast<Label>(random.bits(voxel++) % static_cast<std::uint64_t>(n_labels + 1));
      }
    }
  }
  return volume;
}

InputVolume rotated(InputVolume volume, const Vec3& axis, double angle_deg, const Vec3& shift_mm) {
  Affine& map = volume.frame.index_to_world;
  const Vec3 unit = normalized(axis);
  const double angle = radians(angle_deg);
  std::array<Vec3, 3> columns;
  for (int c = 0; c < 3; ++c) {
    columns[c] = turned({map.rows[0][c], map.rows[1][c], map.rows[2][c]}, unit, angle);
  }
  for (int r = 0; r < 3; ++r)
    map.rows[r] = {columns[0][r], columns[1][r], columns[2][r]};
  map.offset = turned(map.offset, unit, angle) + shift_mm;
  return volume;
}

InputVolume mirrored(InputVolume volume) {
  Affine& map = volume.frame.index_to_world;
  map.rows[0] = -map.rows[0];
  map.offset.x = -map.offset.x;
  return volume;
}

std::size_t voxel_count(const InputVolume& volume, Label label) {
  return static_cast<std::size_t>(std::count(volume.values.begin(), volume.values.end(), label));
}

double volume_mm3(const InputVolume& volume, Label label) {
  const Vec3& s = volume.frame.spacing_mm;
  return static_cast<double>(voxel_count(volume, label)) * s.x * s.y * s.z;
}

std::vector<NamedPhantom> all_small() {
  std::vector<NamedPhantom> phantoms;
  const auto add = [&](const char* name, InputVolume volume) {
    phantoms.push_back({name, std::move(volume)});
  };
  add("ball", ball(8));
  add("ball, anisotropic", ball(5, kAnisotropic));
  add("ball, rotated", rotated(ball(6), {1, 2, 3}, 40, {10, -20, 30}));
  add("ball, mirrored", mirrored(ball(6)));
  add("nested balls", nested_balls(5, 9));
  add("touching balls", touching_balls(6));
  add("touching boxes", touching_boxes({8, 7, 6}));
  add("touching boxes, anisotropic", touching_boxes({8, 7, 6}, kAnisotropic));
  add("wedge of 30 degrees", three_material_wedge(30, 10));
  add("wedge of 120 degrees", three_material_wedge(120, 10));
  add("four-material corner", four_material_corner(10));
  add("torus", torus(9, 3.5));
  add("plate of 3 voxels", thin_plate(3, 20));
  add("plate of 1 voxel", thin_plate(1, 0));
  add("rod of radius 2", rod(2, 30));
  add("one-voxel island", one_voxel_island());
  add("one-voxel label", one_voxel_label());
  add("box without background", box_without_background());
  add("random blobs", random_blobs(1, 5));
  add("checkerboard", checkerboard(3, 3));
  return phantoms;
}

}  // namespace cvmesh::phantoms
