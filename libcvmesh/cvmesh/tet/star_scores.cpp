// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/tet/star_scores.h"

#include <algorithm>
#include <cmath>

// Twice the lanes where the processor has them; it is asked when the program starts. Not with fused
// multiply-add: it would round otherwise. Sanitizers do not bear being called that early.
#if defined(__x86_64__) && defined(__linux__) && !defined(__SANITIZE_ADDRESS__) && \
    !defined(__SANITIZE_THREAD__) && !defined(__clang__)
#define CVMESH_FOR_EACH_PROCESSOR [[gnu::target_clones("avx2", "default")]]
#else
#define CVMESH_FOR_EACH_PROCESSOR
#endif

namespace cvmesh {

void StarScores::clear() {
  count_ = 0;
}

void StarScores::add(const Vec3& a, const Vec3& b, const Vec3& c) {
  const std::size_t block = count_ / kLanes, lane = count_ % kLanes;
  if (block >= faces_.size()) faces_.emplace_back();
  Faces& faces = faces_[block];
  const Vec3 normal = area_vector2(a, b, c);
  const double area2 = squared_norm(normal);
  // The rest of the block is padded with the same tet until another takes its place.
  for (std::size_t l = lane; l < kLanes; ++l) {
    const auto put = [l](const Vec3& from, Points& to) {
      to.x[l] = from.x;
      to.y[l] = from.y;
      to.z[l] = from.z;
    };
    put(a, faces.a);
    put(b, faces.b);
    put(c, faces.c);
    put(normal, faces.area_vector);
    faces.area2[l] = area2;
    faces.root_area2[l] = std::sqrt(area2);
    faces.ab[l] = squared_norm(b - a);
    faces.bc[l] = squared_norm(c - b);
    faces.ca[l] = squared_norm(a - c);
  }
  ++count_;
}

TetQuality StarScores::quality_at(const Vec3& p, double floor) const {
  return score(faces_.data(), count_, p, floor);
}

CVMESH_FOR_EACH_PROCESSOR
TetQuality StarScores::score(const Faces* faces, std::size_t count, const Vec3& p, double floor) {
  const Lanes none{};
  const auto take_root = [](Lanes & x) __attribute__((always_inline)) {
    for (std::size_t l = 0; l < kLanes; ++l)
      x[l] = std::sqrt(x[l]);
  };
  TetQuality quality;
  for (std::size_t first = 0; first < count; first += kLanes, ++faces) {
    const Faces& f = *faces;
    // From the vertex to the corners, and the doubled area vectors of the faces at the vertex.
    const Lanes ux = f.a.x - p.x, uy = f.a.y - p.y, uz = f.a.z - p.z;
    const Lanes vx = f.b.x - p.x, vy = f.b.y - p.y, vz = f.b.z - p.z;
    const Lanes wx = f.c.x - p.x, wy = f.c.y - p.y, wz = f.c.z - p.z;
    const Lanes ax = vy * wz - vz * wy, ay = vz * wx - vx * wz, az = vx * wy - vy * wx;
    const Lanes bx = wy * uz - wz * uy, by = wz * ux - wx * uz, bz = wx * uy - wy * ux;
    const Lanes cx = uy * vz - uz * vy, cy = uz * vx - ux * vz, cz = ux * vy - uy * vx;
    const Lanes volume = ux * f.area_vector.x + uy * f.area_vector.y + uz * f.area_vector.z;
    const Lanes pa = ux * ux + uy * uy + uz * uz;
    const Lanes pb = vx * vx + vy * vy + vz * vz;
    const Lanes pc = wx * wx + wy * wy + wz * wz;
    const Lanes area2_a = ax * ax + ay * ay + az * az;
    const Lanes area2_b = bx * bx + by * by + bz * bz;
    const Lanes area2_c = cx * cx + cy * cy + cz * cz;
    // As in `score_any_tet`, which has the reasons: for each edge, |e|^2 times the squared areas
    // of the two faces that it does not belong to.
    const Lanes x_pa = pa * f.area2 * area2_a, x_pb = pb * f.area2 * area2_b;
    const Lanes x_pc = pc * f.area2 * area2_c, x_ab = f.ab * area2_a * area2_b;
    const Lanes x_bc = f.bc * area2_b * area2_c, x_ca = f.ca * area2_c * area2_a;
    Lanes least = x_pa < x_pb ? x_pa : x_pb;
    least = x_pc < least ? x_pc : least;
    least = x_ab < least ? x_ab : least;
    least = x_bc < least ? x_bc : least;
    least = x_ca < least ? x_ca : least;
    const Lanes product = (f.area2 * area2_a) * (area2_b * area2_c);
    Lanes sine = least / product;
    take_root(sine);
    sine = product > 0 ? volume * sine : none - 1;
    const Lanes x = pa * f.bc, y = pb * f.ca, z = pc * f.ab;
    const Lanes heron = 2 * (x * y + y * z + z * x) - (x * x + y * y + z * z);
    Lanes area_a = area2_a, area_b = area2_b, area_c = area2_c, root_heron = heron;
    take_root(area_a);
    take_root(area_b);
    take_root(area_c);
    take_root(root_heron);
    const Lanes areas = f.root_area2 + area_a + area_b + area_c;
    const Lanes ratio =
        (sine > 0) & (heron > 0) ? 12 * volume * volume / (areas * root_heron) : none;
    const std::size_t lanes = std::min(kLanes, count - first);
    for (std::size_t l = 0; l < lanes; ++l)
      quality.add({sine[l], ratio[l]});
    if (!(quality.worst >= floor)) return quality;
  }
  return quality;
}

}  // namespace cvmesh
