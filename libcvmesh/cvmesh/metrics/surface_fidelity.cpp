// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/metrics/surface_fidelity.h"

#include "cvmesh/core/error.h"
#include "cvmesh/core/parallel.h"
#include "cvmesh/mesh/shape_tree.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>

namespace cvmesh {
namespace {

constexpr char kStage[] = "metrics";
constexpr std::size_t kChunk = 256;  // facets that are measured one after the other
// Spacings that differ by less than the rounding of a header's floats count as equal.
constexpr double kSameSpacing = 1e-6;

// A point to measure from. Vertices count for the maximum only.
struct Sample {
  Vec3 point;
  bool is_vertex = false;
};

double fraction(double x) {
  return x - std::floor(x);
}

// --- surfaces ------------------------------------------------------------------------------------
// Both kinds have the same members: `size`, `box` and `squared_distance` for the search tree,
// `sides`, `area` and `samples` for the measurement. `scale` maps grid mm to the space in which
// distances are measured: 1 for mm, 1 / spacing for index space.

// The facets of an interface mesh.
class FacetSurface {
 public:
  FacetSurface(const InterfaceMesh& mesh, const Vec3& scale, const Vec3& spacing, double density)
      : mesh_(mesh), corners_(mesh.facets.size()), own_(mesh.facets.size(), 0) {
    parallel_for_each_index(0, size(), [&](std::size_t f) {
      for (int k = 0; k < 3; ++k) {
        corners_[f][k] = scaled_by(mesh.points[mesh.facets[f][k]], scale);
      }
    });
    count_samples(spacing, density);
    share_out_vertices();
  }

  [[nodiscard]] std::size_t size() const { return corners_.size(); }

  [[nodiscard]] Sides sides(std::size_t f) const { return mesh_.patch_of[f].sides; }

  [[nodiscard]] Box3 box(std::size_t f) const {
    Box3 result;
    for (const Vec3& corner : corners_[f])
      result.add(corner);
    return result;
  }

  [[nodiscard]] double squared_distance(std::size_t f, const Vec3& p) const {
    const auto& [a, b, c] = corners_[f];
    return squared_norm(p - nearest_on_triangle(p, a, b, c));
  }

  [[nodiscard]] double area(std::size_t f) const {
    const auto& [a, b, c] = corners_[f];
    return norm(area_vector2(a, b, c)) / 2;
  }

  // Low-discrepancy points that fill the facet, the R2 sequence [Roberts 2018] folded into the
  // triangle, started at another place for each facet; then the vertices that it owns.
  void samples(std::size_t f, std::vector<Sample>& result) const {
    constexpr double kPlastic = 1.32471795724474602596;
    constexpr double kStepU = 1 / kPlastic, kStepV = 1 / (kPlastic * kPlastic);
    constexpr double kGolden = 0.61803398874989484820;
    result.clear();
    const auto& [a, b, c] = corners_[f];
    const double start_u = fraction(static_cast<double>(f) * kGolden);
    const double start_v = fraction(static_cast<double>(f) * kStepU);
    for (std::uint32_t s = 0; s < sample_count_[f]; ++s) {
      double u = fraction(start_u + s * kStepU), v = fraction(start_v + s * kStepV);
      if (u + v > 1) {
        u = 1 - u;
        v = 1 - v;
      }
      result.push_back({a + u * (b - a) + v * (c - a), false});
    }
    for (int k = 0; k < 3; ++k) {
      if (own_[f] >> k & 1) result.push_back({corners_[f][k], true});
    }
  }

 private:
  void count_samples(const Vec3& spacing, double density) {
    sample_count_.resize(size());
    parallel_for_each_index(0, size(), [&](std::size_t f) {
      std::array<Vec3, 3> index;
      for (int k = 0; k < 3; ++k) {
        index[k] = divided_by(mesh_.points[mesh_.facets[f][k]], spacing);
      }
      const double area_vox = norm(area_vector2(index[0], index[1], index[2])) / 2;
      sample_count_[f] = static_cast<std::uint32_t>(std::max(1.0, std::ceil(density * area_vox)));
    });
  }

  // A vertex is measured by the first facet at it and by each one with other materials than the
  // first: once for most vertices, and for every material that meets there.
  void share_out_vertices() {
    std::vector<std::int32_t> first(mesh_.points.size(), -1);
    for (std::size_t f = 0; f < size(); ++f) {
      for (int k = 0; k < 3; ++k) {
        std::int32_t& owner = first[mesh_.facets[f][k]];
        if (owner >= 0 && sides(owner) == sides(f)) continue;
        own_[f] |= static_cast<std::uint8_t>(1U << k);
        if (owner < 0) owner = static_cast<std::int32_t>(f);
      }
    }
  }

  const InterfaceMesh& mesh_;
  std::vector<std::array<Vec3, 3>> corners_;
  std::vector<std::uint8_t> own_;  // bit k: corner k is measured with this facet
  std::vector<std::uint32_t> sample_count_;
};

// One voxel face: between voxel (i, j, k) and its predecessor along `axis`.
struct VoxelFace {
  std::array<std::int32_t, 3> voxel;
  Sides sides;
  std::uint8_t axis;
};

MaterialId material_at(const Grid<MaterialId>& ids, std::array<std::int32_t, 3> v) {
  return ids.frame.contains(v[0], v[1], v[2]) ? ids(v[0], v[1], v[2]) : kExterior;
}

Sides sides_of_face(const Grid<MaterialId>& ids, std::array<std::int32_t, 3> voxel, int axis) {
  const MaterialId a = material_at(ids, voxel);
  --voxel[axis];
  const MaterialId b = material_at(ids, voxel);
  return {std::max(a, b), std::min(a, b)};
}

// All voxel faces between unequal materials, those on the box among them, in scan order.
std::vector<VoxelFace> find_voxel_faces(const Grid<MaterialId>& ids) {
  const auto [nx, ny, nz] = ids.frame.dims;
  const auto scan_slice = [&, nx = nx, ny = ny](std::size_t slice, const auto& found) {
    const auto k = static_cast<std::int32_t>(slice);
    for (std::int32_t j = 0; j <= ny; ++j) {
      for (std::int32_t i = 0; i <= nx; ++i) {
        const std::array<std::int32_t, 3> voxel{i, j, k};
        const MaterialId own = material_at(ids, voxel);
        for (std::uint8_t axis = 0; axis < 3; ++axis) {
          std::array<std::int32_t, 3> before = voxel;
          --before[axis];
          const MaterialId other = material_at(ids, before);
          if (own != other) {
            found(VoxelFace{voxel, {std::max(own, other), std::min(own, other)}, axis});
          }
        }
      }
    }
  };
  const auto slices = static_cast<std::size_t>(nz) + 1;
  std::vector<std::size_t> first(slices + 1, 0);
  parallel_for_each_index(
      0, slices, [&](std::size_t k) { scan_slice(k, [&](const VoxelFace&) { ++first[k + 1]; }); },
      4);
  std::partial_sum(first.begin(), first.end(), first.begin());
  std::vector<VoxelFace> faces(first.back());
  parallel_for_each_index(
      0, slices,
      [&](std::size_t k) {
        std::size_t next = first[k];
        scan_slice(k, [&](const VoxelFace& face) { faces[next++] = face; });
      },
      4);
  return faces;
}

// The raw boundary of a label volume: rectangles, whose distance is that of their flat box.
class VoxelFaceSurface {
 public:
  VoxelFaceSurface(const Grid<MaterialId>& ids,
                   const std::vector<VoxelFace>& faces,
                   const Vec3& scale,
                   double density)
      : ids_(ids),
        faces_(faces),
        step_(scaled_by(ids.frame.spacing_mm, scale)),
        per_side_(std::max(1, static_cast<int>(std::ceil(std::sqrt(density))))) {}

  [[nodiscard]] std::size_t size() const { return faces_.size(); }

  [[nodiscard]] Sides sides(std::size_t f) const { return faces_[f].sides; }

  [[nodiscard]] Box3 box(std::size_t f) const {
    const VoxelFace& face = faces_[f];
    Box3 result;
    for (int axis = 0; axis < 3; ++axis) {
      result.lo[axis] = (face.voxel[axis] - 0.5) * step_[axis];
      result.hi[axis] =
          axis == face.axis ? result.lo[axis] : (face.voxel[axis] + 0.5) * step_[axis];
    }
    return result;
  }

  [[nodiscard]] double squared_distance(std::size_t f, const Vec3& p) const {
    const Box3 b = box(f);
    double sum = 0;
    for (int axis = 0; axis < 3; ++axis) {
      const double d = std::max(0.0, std::max(b.lo[axis] - p[axis], p[axis] - b.hi[axis]));
      sum += d * d;
    }
    return sum;
  }

  [[nodiscard]] double area(std::size_t f) const {
    const int axis = faces_[f].axis;
    return step_[(axis + 1) % 3] * step_[(axis + 2) % 3];
  }

  // A regular pattern on the face, then the corners that no coplanar neighbour with the same
  // materials owns: its upper corner, and the lower ones where that neighbour is missing.
  void samples(std::size_t f, std::vector<Sample>& result) const {
    result.clear();
    const VoxelFace& face = faces_[f];
    const int u = (face.axis + 1) % 3, v = (face.axis + 2) % 3;
    const Box3 b = box(f);
    const auto at = [&](double s, double t) {
      Vec3 p = b.lo;
      p[u] += s * step_[u];
      p[v] += t * step_[v];
      return p;
    };
    for (int s = 0; s < per_side_; ++s) {
      for (int t = 0; t < per_side_; ++t) {
        result.push_back({at((s + 0.5) / per_side_, (t + 0.5) / per_side_), false});
      }
    }
    const bool has_before_u = continues(face, u), has_before_v = continues(face, v);
    result.push_back({at(1, 1), true});
    if (!has_before_u) result.push_back({at(0, 1), true});
    if (!has_before_v) result.push_back({at(1, 0), true});
    if (!has_before_u && !has_before_v) result.push_back({at(0, 0), true});
  }

 private:
  [[nodiscard]] bool continues(const VoxelFace& face, int axis) const {
    std::array<std::int32_t, 3> before = face.voxel;
    --before[axis];
    return sides_of_face(ids_, before, face.axis) == face.sides;
  }

  const Grid<MaterialId>& ids_;
  const std::vector<VoxelFace>& faces_;
  Vec3 step_;
  int per_side_;
};

// --- measurement ---------------------------------------------------------------------------------

struct DirectedDistances {
  DistanceStats overall;
  std::vector<DistanceStats> of_material;
};

// Distances of one sample: to the nearest facet of all, and to the nearest of the boundaries of
// the two materials of its own facet. Infinite where the target has no such boundary.
struct Measured {
  float overall = 0, inside = 0, outside = 0;
};

struct Weighted {
  float distance = 0, weight = 0;

  friend bool operator<(const Weighted& a, const Weighted& b) {
    return a.distance != b.distance ? a.distance < b.distance : a.weight < b.weight;
  }
};

// Statistics of weighted distances; those of weight 0 count for the maximum only.
DistanceStats summarise(std::vector<Weighted> values) {
  DistanceStats stats;
  stats.samples = values.size();
  if (values.empty()) return stats;
  // Sorted, so that neither the sums nor the percentile depend on the order of the samples.
  parallel_sort(values.begin(), values.end());
  stats.max = values.back().distance;

  struct Sums {
    double weight = 0, first = 0, second = 0;
  };

  const Sums sums = deterministic_reduce(
      0, values.size(), Sums{},
      [&](std::size_t i) {
        const double d = values[i].distance, w = values[i].weight;
        return Sums{w, w * d, w * d * d};
      },
      [](const Sums& a, const Sums& b) {
        return Sums{a.weight + b.weight, a.first + b.first, a.second + b.second};
      });
  if (!(sums.weight > 0)) return stats;
  stats.mean = sums.first / sums.weight;
  stats.rms = std::sqrt(sums.second / sums.weight);
  double above = 0;
  std::size_t i = values.size();
  while (i > 1 && above + values[i - 1].weight <= 0.05 * sums.weight)
    above += values[--i].weight;
  stats.p95 = values[i - 1].distance;
  return stats;
}

// Measures every sample of one surface against another and sums up per material.
template <typename From, typename To>
class Direction {
 public:
  Direction(const From& from, const To& to, const ShapeTree<To>& tree, std::size_t materials)
      : from_(from), to_(to), tree_(tree), is_in_target_(materials, false) {
    for (std::size_t f = 0; f < to.size(); ++f) {
      is_in_target_[to.sides(f).inside] = true;
      is_in_target_[to.sides(f).outside] = true;
    }
  }

  DirectedDistances measure() {
    DirectedDistances result;
    result.of_material.resize(is_in_target_.size());
    if (from_.size() == 0 || to_.size() == 0) return result;
    const std::size_t chunks = (from_.size() + kChunk - 1) / kChunk;
    chunks_.resize(chunks);
    parallel_for_each_index(
        0, chunks, [&](std::size_t c) { measure_chunk(c); }, 1);
    result.overall = summarise(collect(kAll));
    const std::vector<std::size_t> facets_of = count_facets();
    for (std::size_t m = 1; m < result.of_material.size(); ++m) {
      if (facets_of[m] == 0 || !is_in_target_[m]) continue;
      result.of_material[m] = is_only_material(m, facets_of[m])
                                  ? result.overall
                                  : summarise(collect(static_cast<std::int32_t>(m)));
    }
    return result;
  }

 private:
  static constexpr std::int32_t kAll = -1;

  struct Chunk {
    std::vector<Measured> distances;
    std::vector<float> weights;
    std::vector<std::uint32_t> first_of_facet;
  };

  // The last answers of a chunk: neighbouring facets mostly have neighbours as their nearest.
  struct Guesses {
    std::int64_t overall = -1, inside = -1, outside = -1;
    Sides sides;
  };

  void measure_chunk(std::size_t c) {
    Chunk& chunk = chunks_[c];
    Guesses guesses;
    std::vector<Sample> samples;
    const std::size_t end = std::min(from_.size(), (c + 1) * kChunk);
    for (std::size_t f = c * kChunk; f < end; ++f) {
      chunk.first_of_facet.push_back(static_cast<std::uint32_t>(chunk.distances.size()));
      from_.samples(f, samples);
      const auto inner = std::count_if(samples.begin(), samples.end(),
                                       [](const Sample& s) { return !s.is_vertex; });
      const auto weight = static_cast<float>(from_.area(f) / static_cast<double>(inner));
      if (!(guesses.sides == from_.sides(f))) {
        guesses = {guesses.overall, -1, -1, from_.sides(f)};
      }
      for (const Sample& sample : samples) {
        chunk.distances.push_back(measure_sample(sample.point, guesses));
        chunk.weights.push_back(sample.is_vertex ? 0 : weight);
      }
    }
    chunk.first_of_facet.push_back(static_cast<std::uint32_t>(chunk.distances.size()));
  }

  Measured measure_sample(const Vec3& p, Guesses& guesses) const {
    const auto hit = tree_.nearest(p, guesses.overall, [](std::size_t) { return true; });
    guesses.overall = hit.shape;
    Measured result;
    result.overall = static_cast<float>(std::sqrt(hit.squared_distance));
    const Sides hit_sides = to_.sides(static_cast<std::size_t>(hit.shape));
    result.inside = to_boundary_of(guesses.sides.inside, p, hit, hit_sides, guesses.inside);
    result.outside = to_boundary_of(guesses.sides.outside, p, hit, hit_sides, guesses.outside);
    return result;
  }

  // Distance to the boundary of one material. Mostly the nearest facet of all belongs to it, and
  // no second search is needed.
  float to_boundary_of(MaterialId material,
                       const Vec3& p,
                       const typename ShapeTree<To>::Hit& overall,
                       const Sides& overall_sides,
                       std::int64_t& guess) const {
    if (material == kExterior || !is_in_target_[material]) return 0;
    if (overall_sides.inside == material || overall_sides.outside == material) {
      guess = overall.shape;
      return static_cast<float>(std::sqrt(overall.squared_distance));
    }
    const auto hit = tree_.nearest(p, guess, [&](std::size_t shape) {
      const Sides s = to_.sides(shape);
      return s.inside == material || s.outside == material;
    });
    guess = hit.shape;
    return static_cast<float>(std::sqrt(hit.squared_distance));
  }

  // All samples, or those on the boundary of one material with their distance to it.
  [[nodiscard]] std::vector<Weighted> collect(std::int32_t material) const {
    std::vector<Weighted> result;
    for (std::size_t c = 0; c < chunks_.size(); ++c) {
      const Chunk& chunk = chunks_[c];
      for (std::size_t n = 0; n + 1 < chunk.first_of_facet.size(); ++n) {
        const Sides s = from_.sides(c * kChunk + n);
        float Measured::*member = &Measured::overall;
        if (material != kAll) {
          if (s.inside != material && s.outside != material) continue;
          member = s.inside == material ? &Measured::inside : &Measured::outside;
        }
        for (std::uint32_t i = chunk.first_of_facet[n]; i < chunk.first_of_facet[n + 1]; ++i) {
          result.push_back({chunk.distances[i].*member, chunk.weights[i]});
        }
      }
    }
    return result;
  }

  [[nodiscard]] std::vector<std::size_t> count_facets() const {
    std::vector<std::size_t> count(is_in_target_.size(), 0);
    for (std::size_t f = 0; f < from_.size(); ++f) {
      ++count[from_.sides(f).inside];
      ++count[from_.sides(f).outside];
    }
    return count;
  }

  // Whether the material is on every facet of both surfaces: its distances are the overall ones.
  [[nodiscard]] bool is_only_material(std::size_t material, std::size_t facets) const {
    if (facets != from_.size()) return false;
    for (std::size_t f = 0; f < to_.size(); ++f) {
      if (to_.sides(f).inside != material && to_.sides(f).outside != material) return false;
    }
    return true;
  }

  const From& from_;
  const To& to_;
  const ShapeTree<To>& tree_;
  std::vector<bool> is_in_target_;
  std::vector<Chunk> chunks_;
};

template <typename Mesh, typename Reference>
void measure_both(const Mesh& mesh,
                  const Reference& reference,
                  std::size_t materials,
                  TwoSidedDistance SurfaceDistance::*space,
                  SurfaceDistances& result) {
  const ShapeTree<Mesh> mesh_tree(mesh);
  const ShapeTree<Reference> reference_tree(reference);
  const DirectedDistances forward =
      Direction<Mesh, Reference>(mesh, reference, reference_tree, materials).measure();
  const DirectedDistances back =
      Direction<Reference, Mesh>(reference, mesh, mesh_tree, materials).measure();
  result.overall.*space = {forward.overall, back.overall};
  for (std::size_t m = 0; m < materials; ++m) {
    result.of_material[m].*space = {forward.of_material[m], back.of_material[m]};
  }
}

DistanceStats rescaled(DistanceStats stats, double factor) {
  stats.max *= factor;
  stats.p95 *= factor;
  stats.mean *= factor;
  stats.rms *= factor;
  return stats;
}

void mm_from_voxels(SurfaceDistance& distance, double spacing_mm) {
  distance.mm = {rescaled(distance.voxels.mesh_to_reference, spacing_mm),
                 rescaled(distance.voxels.reference_to_mesh, spacing_mm)};
}

// Measures in index space and, where the voxels are not cubes, once more in mm.
// `make_reference(scale)` gives the reference surface in a space.
template <typename MakeReference>
SurfaceDistances measure(const InterfaceMesh& surface,
                         const GridFrame& frame,
                         std::size_t materials,
                         const SurfaceFidelityOptions& options,
                         const MakeReference& make_reference) {
  require(options.samples_per_square_voxel > 0 && options.samples_per_square_voxel <= 1e4,
          ErrorCode::BadParameter, kStage,
          "samples_per_square_voxel (" + std::to_string(options.samples_per_square_voxel) +
              ") must be above 0 and at most 10000");
  SurfaceDistances result;
  result.of_material.resize(materials);
  const Vec3& spacing = frame.spacing_mm;
  const auto run = [&](const Vec3& scale, TwoSidedDistance SurfaceDistance::*space) {
    const FacetSurface mesh(surface, scale, spacing, options.samples_per_square_voxel);
    measure_both(mesh, make_reference(scale), materials, space, result);
  };
  run(divided_by({1, 1, 1}, spacing), &SurfaceDistance::voxels);
  if (std::abs(spacing.y - spacing.x) <= kSameSpacing * spacing.x &&
      std::abs(spacing.z - spacing.x) <= kSameSpacing * spacing.x) {
    mm_from_voxels(result.overall, spacing.x);
    for (SurfaceDistance& distance : result.of_material)
      mm_from_voxels(distance, spacing.x);
  } else {
    run({1, 1, 1}, &SurfaceDistance::mm);
  }
  return result;
}

}  // namespace

double TwoSidedDistance::hausdorff_lower_bound() const {
  return std::max(mesh_to_reference.max, reference_to_mesh.max);
}

double TwoSidedDistance::mean_symmetric() const {
  return (mesh_to_reference.mean + reference_to_mesh.mean) / 2;
}

double TwoSidedDistance::rms_symmetric() const {
  return std::sqrt((mesh_to_reference.rms * mesh_to_reference.rms +
                    reference_to_mesh.rms * reference_to_mesh.rms) /
                   2);
}

SurfaceDistances measure_distances(const InterfaceMesh& surface,
                                   const InterfaceMesh& reference,
                                   const GridFrame& frame,
                                   std::size_t material_count,
                                   const SurfaceFidelityOptions& options) {
  return measure(surface, frame, material_count, options, [&](const Vec3& scale) {
    return FacetSurface(reference, scale, frame.spacing_mm, options.samples_per_square_voxel);
  });
}

SurfaceDistances measure_distances(const InterfaceMesh& surface,
                                   const Grid<MaterialId>& ids,
                                   std::size_t material_count,
                                   const SurfaceFidelityOptions& options) {
  const std::vector<VoxelFace> faces = find_voxel_faces(ids);
  return measure(surface, ids.frame, material_count, options, [&](const Vec3& scale) {
    return VoxelFaceSurface(ids, faces, scale, options.samples_per_square_voxel);
  });
}

SurfaceFidelity measure_surface_fidelity(const InterfaceMesh& surface,
                                         const InterfaceMesh& dense,
                                         const LabelVolume& labels,
                                         const SurfaceFidelityOptions& options,
                                         const StageContext& context) {
  SurfaceFidelity result;
  result.samples_per_square_voxel = options.samples_per_square_voxel;
  result.to_dense =
      measure_distances(surface, dense, labels.frame(), labels.material_count(), options);
  report_progress(context, kStage, 0.75);  // the other metrics were the first half
  result.to_labels = measure_distances(surface, labels.ids, labels.material_count(), options);
  report_progress(context, kStage, 1);
  return result;
}

}  // namespace cvmesh
