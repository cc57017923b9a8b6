// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/metrics/label_tets.h"

#include "cvmesh/core/disjoint_sets.h"
#include "cvmesh/core/parallel.h"
#include "cvmesh/mesh/tet_faces.h"
#include "cvmesh/mesh/tet_predicates.h"

#include <algorithm>
#include <cmath>
#include <tuple>
#include <utility>

namespace cvmesh {
namespace {

using Triangle = std::array<std::int32_t, 3>;
using Tet = std::array<std::int32_t, 4>;

constexpr double kOnWallVox = 1e-6;  // files round coordinates

struct FaceUse {
  Triangle key;  // vertices, ascending
  std::int32_t tet;
  std::int8_t corner;  // opposite to the face

  friend bool operator<(const FaceUse& a, const FaceUse& b) {
    return std::tie(a.key, a.tet, a.corner) < std::tie(b.key, b.tet, b.corner);
  }
};

class Builder {
 public:
  Builder(const std::vector<Vec3>& points,
          const std::vector<Tet>& tets,
          const std::vector<MaterialId>& material_of,
          std::size_t material_count,
          const GridFrame& frame)
      : points_(points), frame_(frame) {
    for (std::size_t t = 0; t < tets.size(); ++t) {
      Tet sorted = tets[t];
      std::sort(sorted.begin(), sorted.end());
      if (std::adjacent_find(sorted.begin(), sorted.end()) != sorted.end()) {
        ++result_.faults.repeated_vertex;
        continue;
      }
      tets_.push_back(tets[t]);
      result_.mesh.material_of.push_back(material_of[t]);
    }
    result_.solids.resize(material_count);
  }

  LabelledTets build() {
    orient();
    count_repeated();
    collect_faces();
    find_facets();
    find_solids();
    number_points();
    return std::move(result_);
  }

 private:
  [[nodiscard]] int sign_of(const Tet& t) const {
    return tet_orientation(points_[t[0]], points_[t[1]], points_[t[2]], points_[t[3]]);
  }

  void orient() {
    sign_.resize(tets_.size());
    parallel_for_each_index(0, tets_.size(), [&](std::size_t t) {
      sign_[t] = static_cast<std::int8_t>(sign_of(tets_[t]));
    });
    const auto negative = std::count(sign_.begin(), sign_.end(), std::int8_t{-1});
    const auto positive = std::count(sign_.begin(), sign_.end(), std::int8_t{1});
    result_.faults.inverted = static_cast<std::size_t>(std::min(negative, positive));
    result_.faults.flat = sign_.size() - static_cast<std::size_t>(negative + positive);
    if (negative <= positive) return;
    for (std::size_t t = 0; t < tets_.size(); ++t) {
      std::swap(tets_[t][2], tets_[t][3]);
      sign_[t] = static_cast<std::int8_t>(-sign_[t]);
    }
  }

  void count_repeated() {
    std::vector<Tet> sorted = tets_;
    for (Tet& t : sorted)
      std::sort(t.begin(), t.end());
    parallel_sort(sorted.begin(), sorted.end());
    for (std::size_t t = 1; t < sorted.size(); ++t)
      result_.faults.repeated_tets += sorted[t] == sorted[t - 1] ? 1 : 0;
  }

  void collect_faces() {
    faces_.resize(4 * tets_.size());
    parallel_for_each_index(0, tets_.size(), [&](std::size_t t) {
      for (std::size_t k = 0; k < 4; ++k) {
        FaceUse& use = faces_[4 * t + k];
        use.key = sorted(tet_face(tets_[t], k));
        use.tet = static_cast<std::int32_t>(t);
        use.corner = static_cast<std::int8_t>(k);
      }
    });
    parallel_sort(faces_.begin(), faces_.end());
  }

  // Calls visit(first, second) for each face; `second` is null where one tet has it. Of a face in
  // more than two tets the first two count.
  template <typename Visit>
  void for_each_face(const Visit& visit) {
    for (std::size_t i = 0; i < faces_.size();) {
      std::size_t end = i + 1;
      while (end < faces_.size() && faces_[end].key == faces_[i].key)
        ++end;
      visit(faces_[i], end - i > 1 ? &faces_[i + 1] : nullptr, end - i);
      i = end;
    }
  }

  // On which side of the sorted face the tet lies: the sign of its volume, turned by the parity of
  // the face's order.
  [[nodiscard]] int side_of(const FaceUse& use) const {
    const Tet& tet = tets_[use.tet];
    const Tet sorted{use.key[0], use.key[1], use.key[2], tet[use.corner]};
    return sign_of(sorted);
  }

  void find_facets() {
    const auto& material_of = result_.mesh.material_of;
    for_each_face([&](const FaceUse& first, const FaceUse* second, std::size_t uses) {
      if (uses > 2) ++result_.faults.crowded_faces;
      if (second != nullptr && side_of(first) * side_of(*second) > 0) ++result_.faults.folded_faces;
      const MaterialId a = material_of[first.tet],
                       b = second != nullptr ? material_of[second->tet] : kExterior;
      if (a == b) return;
      const FaceUse& inside = a > b ? first : *second;
      const Triangle facet = tet_face(tets_[inside.tet], static_cast<std::size_t>(inside.corner));
      result_.mesh.surface.facets.push_back(facet);
      result_.mesh.surface.patch_of.push_back(
          {{std::max(a, b), std::min(a, b)},
           second != nullptr ? std::uint16_t{0} : wall_of(facet)});
    });
  }

  [[nodiscard]] std::uint16_t wall_of(const Triangle& facet) const {
    for (int axis = 0; axis < 3; ++axis)
      for (int side = 0; side < 2; ++side) {
        const double plane = side == 0 ? -0.5 : frame_.dims[axis] - 0.5;
        if (std::all_of(facet.begin(), facet.end(), [&](std::int32_t v) {
              return std::abs(points_[v][axis] / frame_.spacing_mm[axis] - plane) <= kOnWallVox;
            }))
          return static_cast<std::uint16_t>(1 + 2 * axis + side);
      }
    return 0;
  }

  void find_solids() {
    const auto& material_of = result_.mesh.material_of;
    DisjointSets parts(tets_.size());
    for_each_face([&](const FaceUse& first, const FaceUse* second, std::size_t) {
      const MaterialId a = material_of[first.tet];
      ++result_.solids[a].euler;
      if (second == nullptr) return;
      if (material_of[second->tet] == a)
        parts.join(first.tet, second->tet);
      else
        ++result_.solids[material_of[second->tet]].euler;
    });
    using Simplex = std::tuple<MaterialId, std::int32_t, std::int32_t>;
    std::vector<Simplex> vertices, edges;
    for (std::size_t t = 0; t < tets_.size(); ++t) {
      const MaterialId m = material_of[t];
      --result_.solids[m].euler;
      if (parts.is_root(static_cast<std::uint32_t>(t))) ++result_.solids[m].components;
      for (std::size_t i = 0; i < 4; ++i) {
        vertices.emplace_back(m, tets_[t][i], 0);
        for (std::size_t j = i + 1; j < 4; ++j)
          edges.emplace_back(m, std::min(tets_[t][i], tets_[t][j]),
                             std::max(tets_[t][i], tets_[t][j]));
      }
    }
    count_distinct(std::move(vertices), 1);
    count_distinct(std::move(edges), -1);
  }

  template <typename Simplices>
  void count_distinct(Simplices simplices, int sign) {
    parallel_sort(simplices.begin(), simplices.end());
    simplices.erase(std::unique(simplices.begin(), simplices.end()), simplices.end());
    for (const auto& simplex : simplices)
      result_.solids[std::get<0>(simplex)].euler += sign;
  }

  // The points of the surface come first, each group in the order of the file.
  void number_points() {
    enum : std::uint8_t { Unused, Interior, Surface };

    std::vector<std::uint8_t> use(points_.size(), Unused);
    for (const Tet& tet : tets_)
      for (const std::int32_t v : tet)
        use[v] = Interior;
    for (const Triangle& facet : result_.mesh.surface.facets)
      for (const std::int32_t v : facet)
        use[v] = Surface;
    std::vector<std::int32_t> new_index(points_.size(), -1);
    TetMesh& mesh = result_.mesh;
    for (const std::uint8_t wanted : {Surface, Interior}) {
      for (std::size_t v = 0; v < points_.size(); ++v) {
        if (use[v] != wanted) continue;
        new_index[v] = static_cast<std::int32_t>(mesh.points.size());
        mesh.points.push_back(points_[v]);
      }
      if (wanted == Surface) mesh.surface.points = mesh.points;
    }
    result_.unused_points = points_.size() - mesh.points.size();
    for (Triangle& facet : mesh.surface.facets)
      for (std::int32_t& v : facet)
        v = new_index[v];
    mesh.tets = std::move(tets_);
    for (Tet& tet : mesh.tets)
      for (std::int32_t& v : tet)
        v = new_index[v];
  }

  const std::vector<Vec3>& points_;
  const GridFrame& frame_;
  std::vector<Tet> tets_;
  std::vector<std::int8_t> sign_;
  std::vector<FaceUse> faces_;
  LabelledTets result_;
};

}  // namespace

LabelledTets build_label_tets(const std::vector<Vec3>& points,
                              const std::vector<std::array<std::int32_t, 4>>& tets,
                              const std::vector<MaterialId>& material_of,
                              std::size_t material_count,
                              const GridFrame& frame) {
  return Builder(points, tets, material_of, material_count, frame).build();
}

}  // namespace cvmesh
