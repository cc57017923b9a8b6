// SPDX-License-Identifier: AGPL-3.0-or-later
//
// Measures the first stages: level sets, tightening, dense surfaces.
//
//   bench_level_sets shapes [--r R]
//       analytic shapes: distances, volumes and normals of the dense surface against the truth
//   bench_level_sets volume FILE [--r R] [--threads N] [--sweeps N] [--dense OUT.off]
//       one label volume: seconds, peak memory, what topology and volumes became; one JSON line
//
// No test: nothing here passes or fails. `scripts/bench_level_sets.py` runs it over a folder.
#include "cvmesh/core/timer.h"
#include "cvmesh/interfaces/extract_interfaces.h"
#include "cvmesh/io/surface_writer.h"
#include "cvmesh/io/volume_reader.h"
#include "cvmesh/labels/clean_labels.h"
#include "cvmesh/labels/lattice_topology.h"
#include "cvmesh/levelset/build_level_sets.h"
#include "cvmesh/levelset/tighten.h"
#include "cvmesh/mesh/validate.h"

#include <nlohmann/json.hpp>
#include <tbb/global_control.h>

#include "levelset/label_grids.h"
#include "levelset/surface_error.h"
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

using namespace cvmesh;
using label_grids::Labels;
using label_grids::Smooth;
using label_grids::SurfaceError;
using label_grids::TruthAt;
using label_grids::volume_inside;

namespace {

struct Options {
  std::string command, file, dense;
  double r_vox = TightenOptions{}.r_vox;
  int threads = 0;
  int sweeps = TightenOptions{}.smoothing_sweeps;
};

Smooth smooth(const Labels& labels, const Options& options) {
  TightenOptions tighten_options;
  tighten_options.r_vox = options.r_vox;
  tighten_options.smoothing_sweeps = options.sweeps;
  Smooth result;
  result.level_sets =
      tighten(build_level_sets(label_grids::shared(labels), label_grids::material_count(labels),
                               silent_context())
                  .level_sets,
              tighten_options, silent_context())
          .level_sets;
  result.mesh = extract_interfaces(result.level_sets, silent_context());
  return result;
}

void print(const std::string& name, const SurfaceError& error) {
  std::printf("| %-28s | %7.4f | %7.4f | %6.2f |\n", name.c_str(), error.rms(), error.bias(),
              error.normal_deg());
}

const std::vector<Vec3>& shifts() {
  static const std::vector<Vec3> list = {
      {}, {0.37, -0.21, 0.11}, {0.5, 0.25, -0.4}, {-0.13, 0.49, 0.3}};
  return list;
}

void measure_shapes(const Options& options) {
  std::printf("| %-28s | rms     | bias    | normal |\n|---|---|---|---|\n", "shape, voxels");
  for (const double radius : {20.0, 10.0, 5.0, 3.0}) {
    SurfaceError errors;
    for (const Vec3& shift : shifts()) {
      const Vec3 centre = label_grids::ball_centre(radius, shift);
      errors.add(smooth(label_grids::ball(radius, shift), options),
                 [&](const Vec3& p) -> std::optional<TruthAt> {
                   return TruthAt{distance(p, centre) - radius, normalized(p - centre)};
                 });
    }
    print("ball, R = " + std::to_string(static_cast<int>(radius)), errors);
  }
  for (const Vec3& direction : {Vec3{1, 2, 5}, Vec3{1, 1, 1}, Vec3{0.1, 0.07, 1}, Vec3{3, 1, 4}}) {
    const Vec3 n = normalized(direction);
    const Vec3 middle{24, 24, 24};
    SurfaceError errors;
    errors.add(smooth(label_grids::sample({49, 49, 49},
                                          [&](const Vec3& p) -> MaterialId {
                                            return dot(p - middle, n) < 0.2 ? 1 : 0;
                                          }),
                      options),
               [&](const Vec3& p) -> std::optional<TruthAt> {
                 for (int axis = 0; axis < 3; ++axis)
                   if (p[axis] < 8 || p[axis] > 40) return std::nullopt;
                 return TruthAt{dot(p - middle, n) - 0.2, n};
               });
    char name[64];
    std::snprintf(name, sizeof name, "plane, normal %g %g %g", direction.x, direction.y,
                  direction.z);
    print(name, errors);
  }
  std::printf("\n| %-28s | volume / voxels | components / of voxels |\n|---|---|---|\n",
              "thin part, voxels");

  struct Thin {
    const char* name;
    Labels labels;
  };

  const std::vector<Thin> thin = {
      {"disc 1.8 thick, R 12, (1 2 5)", label_grids::disc(12, 0.9, {1, 2, 5})},
      {"disc 1.8 thick, R 12, (1 1 1)", label_grids::disc(12, 0.9, {1, 1, 1})},
      {"disc 1.8 thick, R 12, (0 1 3)", label_grids::disc(12, 0.9, {0, 1, 3})},
      {"rod R 1, (1 2 4)", label_grids::rod(1, 12, {1, 2, 4})},
      {"rod R 1, (1 1 1)", label_grids::rod(1, 12, {1, 1, 1})},
      {"rod R 1, (3 1 1)", label_grids::rod(1, 12, {3, 1, 1})},
      {"rod R 1.5, (1 2 4)", label_grids::rod(1.5, 12, {1, 2, 4})},
      {"rod R 2, (3 1 4)", label_grids::rod(2, 12, {3, 1, 4})},
      {"plate of one voxel", label_grids::disc(12, 0.5, {0, 0, 1})}};
  for (const Thin& part : thin) {
    const Smooth s = smooth(part.labels, options);
    const auto before = label_grids::topology(part.labels);
    const auto after = label_grids::topology(*s.level_sets.labels);
    std::printf("| %-28s | %6.3f | %zu / %zu |\n", part.name,
                volume_inside(s.mesh, 1) / static_cast<double>(label_grids::count(part.labels, 1)),
                after[1].components, before[1].components);
  }
}

// Voxel faces between two different labels.
std::size_t count_interface_faces(const Grid<MaterialId>& ids) {
  const auto [nx, ny, nz] = ids.frame.dims;
  std::size_t faces = 0;
  for (int k = 0; k < nz; ++k)
    for (int j = 0; j < ny; ++j)
      for (int i = 0; i < nx; ++i) {
        const MaterialId m = ids(i, j, k);
        faces += i + 1 < nx && ids(i + 1, j, k) != m;
        faces += j + 1 < ny && ids(i, j + 1, k) != m;
        faces += k + 1 < nz && ids(i, j, k + 1) != m;
      }
  return faces;
}

void measure_volume(const Options& options) {
  CleanLabelsResult cleaned;
  {
    const InputVolume input = read_label_volume(options.file);
    cleaned = clean_labels(input, {}, silent_context());
  }
  const LabelVolume labels = std::move(cleaned.labels);
  const std::size_t materials = labels.material_count();
  auto ids = std::make_shared<const Grid<MaterialId>>(labels.ids);
  nlohmann::ordered_json row;
  row["file"] = options.file;
  row["r"] = options.r_vox;
  row["labels"] = materials - 1;
  row["voxels"] = ids->values.size();
  const std::size_t faces = count_interface_faces(*ids);
  row["interface_faces"] = faces;

  reset_peak_memory();
  const Timer build_timer;
  BuildLevelSetsResult built = build_level_sets(ids, materials, silent_context());
  row["build_s"] = build_timer.seconds();
  row["build_peak_mb"] = peak_memory_mb();
  reset_peak_memory();
  TightenOptions tighten_options;
  tighten_options.r_vox = options.r_vox;
  tighten_options.smoothing_sweeps = options.sweeps;
  const Timer tighten_timer;
  TightenResult tightened = tighten(std::move(built.level_sets), tighten_options, silent_context());
  row["tighten_s"] = tighten_timer.seconds();
  row["tighten_peak_mb"] = peak_memory_mb();
  reset_peak_memory();
  const Timer extract_timer;
  const InterfaceMesh mesh = extract_interfaces(tightened.level_sets, silent_context());
  row["extract_s"] = extract_timer.seconds();
  row["extract_peak_mb"] = peak_memory_mb();
  row["seconds"] = row["build_s"].get<double>() + row["tighten_s"].get<double>() +
                   row["extract_s"].get<double>();
  row["peak_mb"] =
      std::max({row["build_peak_mb"].get<double>(), row["tighten_peak_mb"].get<double>(),
                row["extract_peak_mb"].get<double>()});
  row["bound_mb"] =
      300 + (6.0 * static_cast<double>(ids->values.size()) + 600.0 * static_cast<double>(faces)) /
                1048576;
  row["vertices"] = mesh.points.size();
  row["facets"] = mesh.facets.size();
  row["nodes_changed"] = tightened.stats.nodes_changed;
  row["nodes_guarded"] = tightened.stats.nodes_guarded;

  const Validation validation = validate(mesh, materials);
  row["is_valid"] = validation.is_valid();
  const auto boundary = boundary_topology(mesh, materials);
  const auto topology = lattice_topology(labels.ids, materials);
  const auto after = lattice_topology(*tightened.level_sets.labels, materials);
  std::size_t wrong = 0;
  double worst = 0;
  Label worst_label = 0;
  std::vector<double> six(materials);
  for (std::size_t f = 0; f < mesh.facets.size(); ++f) {
    const auto& [a, b, c] = mesh.facets[f];
    const double v = volume6({}, mesh.points[a], mesh.points[b], mesh.points[c]);
    six[mesh.patch_of[f].sides.inside] += v;
    six[mesh.patch_of[f].sides.outside] -= v;
  }
  const Vec3& h = labels.frame().spacing_mm;
  for (std::size_t m = 1; m < materials; ++m) {
    if (topology[m].components != after[m].components || topology[m].euler != after[m].euler ||
        boundary[m].euler != 2 * topology[m].euler)
      ++wrong;
    const double voxels = static_cast<double>(topology[m].voxels) * h.x * h.y * h.z;
    const double error = six[m] / 6 / voxels - 1;
    if (std::abs(error) > std::abs(worst)) {
      worst = error;
      worst_label = labels.label_of[m];
    }
  }
  row["labels_with_other_topology"] = wrong;
  row["worst_volume_error"] = worst;
  row["worst_volume_label"] = worst_label;
  if (!options.dense.empty())
    write_off(options.dense, mesh, mm_to_space(labels.frame(), labels.frame().space));
  std::printf("%s\n", row.dump().c_str());
}

Options parse(int argc, char** argv) {
  Options options;
  for (int a = 1; a < argc; ++a) {
    const std::string word = argv[a];
    const auto value = [&] { return std::string(a + 1 < argc ? argv[++a] : ""); };
    if (word == "--r")
      options.r_vox = std::stod(value());
    else if (word == "--threads")
      options.threads = std::stoi(value());
    else if (word == "--sweeps")
      options.sweeps = std::stoi(value());
    else if (word == "--dense")
      options.dense = value();
    else if (options.command.empty())
      options.command = word;
    else
      options.file = word;
  }
  return options;
}

}  // namespace

int main(int argc, char** argv) {
  const Options options = parse(argc, argv);
  std::optional<tbb::global_control> limit;
  if (options.threads > 0)
    limit.emplace(tbb::global_control::max_allowed_parallelism,
                  static_cast<std::size_t>(options.threads));
  if (options.command == "shapes")
    measure_shapes(options);
  else if (options.command == "volume" && !options.file.empty())
    measure_volume(options);
  else {
    std::fprintf(stderr,
                 "usage: bench_level_sets shapes | volume FILE  [--r R] [--threads N] "
                 "[--sweeps N] [--dense OUT.off]\n");
    return 2;
  }
  return 0;
}
