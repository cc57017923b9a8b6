// SPDX-License-Identifier: AGPL-3.0-or-later
#include "levelset/label_grids.h"

#include "cvmesh/core/random.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace cvmesh::label_grids {
namespace {

constexpr int kMargin = 6;

int side_for(double half) {
  return 2 * (static_cast<int>(std::ceil(half)) + kMargin) + 1;
}

Labels cylinder(double radius, double half_length, const Vec3& direction) {
  const Vec3 d = normalized(direction);
  const int side = side_for(std::hypot(radius, half_length));
  const Vec3 middle = (side / 2) * Vec3{1, 1, 1};
  return sample({side, side, side}, [&](const Vec3& p) -> MaterialId {
    const double along = dot(p - middle, d);
    const double away = norm(p - middle - along * d);
    return std::abs(along) <= half_length && away <= radius ? 1 : 0;
  });
}

Labels blobs(std::uint64_t seed, int blob_count) {
  constexpr int kSide = 34;
  const CounterRandom random(seed, "blobs");
  std::vector<Vec3> centre;
  std::vector<double> radius;
  for (int b = 0; b < blob_count; ++b) {
    radius.push_back(4 + 5 * random.uniform(b, 3));
    Vec3 c;
    for (int axis = 0; axis < 3; ++axis)
      c[axis] = 8 + (kSide - 17) * random.uniform(b, axis);
    centre.push_back(c);
  }
  return sample({kSide, kSide, kSide}, [&](const Vec3& p) {
    MaterialId winner = 0;
    double depth = 0;
    for (int b = 0; b < blob_count; ++b)
      if (const double d = 1 - distance(p, centre[b]) / radius[b]; d > depth) {
        depth = d;
        winner = static_cast<MaterialId>(b + 1);
      }
    return winner;
  });
}

}  // namespace

Labels sample(const std::array<int, 3>& dims,
              const std::function<MaterialId(const Vec3&)>& material_at,
              const Vec3& spacing_mm) {
  GridFrame frame;
  frame.dims = dims;
  frame.spacing_mm = spacing_mm;
  Labels labels(frame);
  for (int k = 0; k < dims[2]; ++k)
    for (int j = 0; j < dims[1]; ++j)
      for (int i = 0; i < dims[0]; ++i)
        labels(i, j, k) = material_at({double(i), double(j), double(k)});
  return labels;
}

Vec3 ball_centre(double radius, const Vec3& shift) {
  return (side_for(radius) / 2) * Vec3{1, 1, 1} + shift;
}

Labels ball(double radius, const Vec3& shift) {
  const int side = side_for(radius);
  const Vec3 centre = ball_centre(radius, shift);
  return sample({side, side, side},
                [&](const Vec3& p) -> MaterialId { return distance(p, centre) < radius ? 1 : 0; });
}

Labels noisy_ball(double radius, double rate, std::uint64_t seed) {
  const int side = side_for(radius);
  const Vec3 centre = ball_centre(radius);
  const CounterRandom random(seed, "noisy ball");
  std::uint64_t node = 0;
  return sample({side, side, side}, [&](const Vec3& p) -> MaterialId {
    const double depth = radius - distance(p, centre);
    const bool is_flipped = random.uniform(node++) < rate && std::abs(depth) < 1;
    return (depth > 0) != is_flipped ? 1 : 0;
  });
}

Labels rod(double radius, double half_length, const Vec3& direction) {
  return cylinder(radius, half_length, direction);
}

Labels disc(double radius, double half_thickness, const Vec3& direction) {
  return cylinder(radius, half_thickness, direction);
}

Labels noise(const std::array<int, 3>& dims, int material_count, std::uint64_t seed) {
  const CounterRandom random(seed, "noise");
  std::uint64_t node = 0;
  return sample(dims, [&](const Vec3&) {
    return static_cast<MaterialId>(random.bits(node++) %
                                   static_cast<std::uint64_t>(material_count));
  });
}

std::shared_ptr<const Labels> shared(Labels labels) {
  return std::make_shared<const Labels>(std::move(labels));
}

std::size_t count(const Labels& labels, MaterialId m) {
  return static_cast<std::size_t>(std::count(labels.values.begin(), labels.values.end(), m));
}

std::size_t material_count(const Labels& labels) {
  return *std::max_element(labels.values.begin(), labels.values.end()) + std::size_t{1};
}

std::vector<LatticeTopology> topology(const Labels& labels) {
  Labels shifted = labels;
  for (MaterialId& m : shifted.values)
    ++m;
  auto all = lattice_topology(shifted, material_count(labels) + 1);
  all.erase(all.begin());
  return all;
}

std::vector<double> volumes(const InterfaceMesh& mesh, std::size_t material_count) {
  std::vector<double> six(material_count);
  for (std::size_t f = 0; f < mesh.facets.size(); ++f) {
    const auto& [a, b, c] = mesh.facets[f];
    const double v = volume6({}, mesh.points[a], mesh.points[b], mesh.points[c]);
    six[mesh.patch_of[f].sides.inside] += v;
    six[mesh.patch_of[f].sides.outside] -= v;
  }
  for (double& v : six)
    v /= 6;
  return six;
}

std::vector<Named> phantoms() {
  std::vector<Named> list;
  list.push_back({"torus", sample({33, 33, 19}, [](const Vec3& p) -> MaterialId {
                    const Vec3 q = p - Vec3{16, 16, 9};
                    return std::hypot(std::hypot(q.x, q.y) - 9, q.z) < 3 ? 1 : 0;
                  })});
  list.push_back({"thin torus", sample({33, 33, 15}, [](const Vec3& p) -> MaterialId {
                    const Vec3 q = p - Vec3{16, 16, 7};
                    return std::hypot(std::hypot(q.x, q.y) - 9, q.z) < 1.5 ? 1 : 0;
                  })});
  list.push_back({"plate of one voxel", disc(9, 0.5, {0, 0, 1})});
  list.push_back({"tilted plate", disc(9, 1.2, {1, 2, 5})});
  list.push_back({"thin rod", rod(1, 10, {1, 2, 4})});
  list.push_back({"rod", rod(2, 10, {3, 1, 4})});
  list.push_back({"nested balls", sample({29, 29, 29}, [](const Vec3& p) -> MaterialId {
                    const double d = distance(p, {14, 14, 14});
                    return d < 5.3 ? 1 : d < 7.1 ? 2 : d < 9.9 ? 3 : 0;
                  })});
  list.push_back({"blobs", blobs(1, 5)});
  list.push_back({"more blobs", blobs(2, 9)});
  list.push_back({"touching boxes", sample({24, 18, 18}, [](const Vec3& p) -> MaterialId {
                    if (p.x < 5 || p.x > 18 || p.y < 5 || p.y > 12 || p.z < 5 || p.z > 12) return 0;
                    return p.x < 12 ? 1 : 2;
                  })});
  list.push_back({"cube in the corner", sample({16, 15, 14}, [](const Vec3& p) -> MaterialId {
                    return p.x < 8 && p.y < 7 && p.z < 6 ? 1 : 0;
                  })});
  list.push_back({"slanted layers up to the border", sample({15, 14, 13}, [](const Vec3& p) {
                    const double s = p.x + 0.6 * p.y + 0.3 * p.z;
                    return static_cast<MaterialId>(s < 8 ? 0 : s < 11 ? 1 : s < 12.5 ? 2 : 3);
                  })});
  list.push_back({"noisy ball", noisy_ball(8, 0.3, 3)});
  list.push_back({"noise", noise({12, 11, 10}, 4, 7)});
  return list;
}

}  // namespace cvmesh::label_grids
