// SPDX-License-Identifier: AGPL-3.0-or-later
//
// The mesher that cvmesh is timed against: CGAL's Mesh_3 on a label image, then perturb and exude,
// with a wanted number of surface triangles.
//
//   bench_cgal_mesh3 VOLUME OUT.mesh --facets N [--parallel] [--threads N] [--facet-size MM]
//
// Facets and tetrahedra have the same size everywhere (facet_size and cell_size), facets deviate by
// at most a quarter of it; minimum angle 30 degrees and radius-edge ratio 3 as in CGAL's own
// examples. The size for N triangles is searched by meshing without the optimisers, outside
// of the measured time; --facet-size gives it instead. Prints one JSON line: the size, counts,
// seconds of the whole and of its parts, peak memory. OUT.mesh is Medit text in grid mm (index
// times spacing); tetrahedron references are the labels.
//
// No test: nothing here passes or fails. `scripts/bench.py` makes tables of it.
#include "cvmesh/core/error.h"
#include "cvmesh/core/timer.h"
#include "cvmesh/io/volume_reader.h"

#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Image_3.h>
#include <CGAL/Labeled_mesh_domain_3.h>
#include <CGAL/Mesh_complex_3_in_triangulation_3.h>
#include <CGAL/Mesh_criteria_3.h>
#include <CGAL/Mesh_triangulation_3.h>
#include <CGAL/make_mesh_3.h>
#include <nlohmann/json.hpp>
#include <tbb/global_control.h>
#include <tbb/info.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstring>
#include <fstream>
#include <string>

namespace {

using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
using Domain = CGAL::Labeled_mesh_domain_3<Kernel>;
namespace params = CGAL::parameters;

struct Options {
  std::string volume, mesh;
  std::size_t facets = 0;
  double facet_size_mm = 0;  // 0: search
  int threads = 0;           // 0: all
  bool is_parallel = false;
};

/// The volume as CGAL holds one, 32-bit labels.
CGAL::Image_3 to_image(const cvmesh::InputVolume& volume) {
  const auto& [dims, spacing, to_world, space] = volume.frame;
  _image* raw = _createImage(dims[0], dims[1], dims[2], 1, spacing.x, spacing.y, spacing.z,
                             sizeof(std::int32_t), WK_FIXED, SGN_SIGNED);
  auto* out = static_cast<std::int32_t*>(raw->data);
  std::copy(volume.values.begin(), volume.values.end(), out);
  return CGAL::Image_3(raw);  // owns it
}

template <typename Concurrency>
class Mesher {
  using Triangulation =
      typename CGAL::Mesh_triangulation_3<Domain, CGAL::Default, Concurrency>::type;
  using Complex = CGAL::Mesh_complex_3_in_triangulation_3<Triangulation>;
  using Criteria = CGAL::Mesh_criteria_3<Triangulation>;

 public:
  explicit Mesher(const CGAL::Image_3& image)
      : domain_(Domain::create_labeled_image_mesh_domain(image)) {}

  /// The facet size at which refinement makes `wanted` facets, within 1 %, or the nearest found.
  [[nodiscard]] double find_size(std::size_t wanted, double first_mm) const {
    double size = first_mm, best = first_mm, least = 1e300;
    for (int n = 0; n < 8; ++n) {
      const auto facets = static_cast<double>(refine(size).number_of_facets_in_complex());
      const double ratio = std::max(facets, 1.0) / static_cast<double>(wanted);
      if (std::abs(std::log(ratio)) < least) {
        least = std::abs(std::log(ratio));
        best = size;
      }
      if (least < 0.01) break;
      size *= std::sqrt(ratio);  // their number goes with the inverse square of the size
    }
    return best;
  }

  nlohmann::ordered_json run(double size, const std::string& file) const {
    nlohmann::ordered_json row;
    row["facet_size_mm"] = size;
    const cvmesh::Timer all, refining;
    Complex complex = refine(size);
    row["refine_s"] = refining.seconds();
    const cvmesh::Timer perturbing;
    CGAL::perturb_mesh_3(complex, domain_);
    row["perturb_s"] = perturbing.seconds();
    const cvmesh::Timer exuding;
    CGAL::exude_mesh_3(complex);
    row["exude_s"] = exuding.seconds();
    row["seconds"] = all.seconds();
    row["facets"] = complex.number_of_facets_in_complex();
    row["tets"] = complex.number_of_cells_in_complex();
    std::ofstream out(file);
    out.precision(17);
    complex.output_to_medit(out, false, false);
    out.close();
    cvmesh::require(out.good(), cvmesh::ErrorCode::Output, "bench", "cannot write " + file);
    return row;
  }

 private:
  [[nodiscard]] Complex refine(double size) const {
    const Criteria criteria(params::facet_angle = 30, params::facet_size = size,
                            params::facet_distance = size / 4, params::cell_radius_edge_ratio = 3,
                            params::cell_size = size);
    return CGAL::make_mesh_3<Complex>(domain_, criteria, params::no_perturb(), params::no_exude());
  }

  Domain domain_;
};

Options parse(int argc, char** argv) {
  Options options;
  for (int n = 1; n < argc; ++n) {
    const std::string word = argv[n];
    const auto value = [&]() -> std::string { return n + 1 < argc ? argv[++n] : ""; };
    if (word == "--facets")
      options.facets = std::stoul(value());
    else if (word == "--facet-size")
      options.facet_size_mm = std::stod(value());
    else if (word == "--threads")
      options.threads = std::stoi(value());
    else if (word == "--parallel")
      options.is_parallel = true;
    else
      (options.volume.empty() ? options.volume : options.mesh) = word;
  }
  cvmesh::require(!options.mesh.empty() && (options.facets > 0 || options.facet_size_mm > 0),
                  cvmesh::ErrorCode::BadParameter, "bench",
                  "usage: bench_cgal_mesh3 VOLUME OUT.mesh --facets N [--parallel] [--threads N] "
                  "[--facet-size MM]");
  return options;
}

/// A first guess of the facet size: the box's surface shared out to twice as many equilateral
/// triangles.
double first_size(const cvmesh::GridFrame& frame, std::size_t facets) {
  const cvmesh::Vec3 box =
      frame.index_to_mm({double(frame.dims[0]), double(frame.dims[1]), double(frame.dims[2])});
  const double area = 2 * (box.x * box.y + box.y * box.z + box.z * box.x);
  return std::max(std::sqrt(area / static_cast<double>(facets)), 0.2 * frame.voxel_mm());
}

template <typename Concurrency>
nlohmann::ordered_json bench(const cvmesh::InputVolume& volume, const Options& options) {
  const CGAL::Image_3 image = to_image(volume);
  const Mesher<Concurrency> mesher(image);
  const double size =
      options.facet_size_mm > 0
          ? options.facet_size_mm
          : mesher.find_size(options.facets, first_size(volume.frame, options.facets));
  return mesher.run(size, options.mesh);
}

}  // namespace

int main(int argc, char** argv) {
  try {
    const Options options = parse(argc, argv);
    const cvmesh::InputVolume volume = cvmesh::read_label_volume(options.volume);
    const auto threads = static_cast<std::size_t>(
        options.threads > 0 ? options.threads : tbb::info::default_concurrency());
    const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
    nlohmann::ordered_json row = options.is_parallel ? bench<CGAL::Parallel_tag>(volume, options)
                                                     : bench<CGAL::Sequential_tag>(volume, options);
    row["peak_mb"] = cvmesh::peak_memory_mb();
    std::puts(row.dump().c_str());
  } catch (const std::exception& error) {
    std::fprintf(stderr, "bench_cgal_mesh3: %s\n", error.what());
    return 1;
  }
  return 0;
}
