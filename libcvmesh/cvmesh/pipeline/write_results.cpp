// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/pipeline/write_results.h"

#include "cvmesh/core/error.h"
#include "cvmesh/core/parallel.h"
#include "cvmesh/io/feb_writer.h"
#include "cvmesh/io/inp_writer.h"
#include "cvmesh/io/msh_writer.h"
#include "cvmesh/io/surface_parts.h"
#include "cvmesh/io/surface_writer.h"
#include "cvmesh/io/tet_writer.h"
#include "cvmesh/pipeline/stage_names.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <array>
#include <set>

namespace cvmesh {
namespace {

/// Tets may be so flat that the rounding of the file's coordinates turns them over; those of a
/// baseline may be flat to begin with.
void require_positive(Run& run, const TetMesh& tets) {
  const auto corner = [&](std::size_t t, std::size_t k) {
    return run.mm_to_out(tets.points[static_cast<std::size_t>(tets.tets[t][k])]);
  };
  const double sign = run.mm_to_out.determinant() < 0 ? -1 : 1;
  const std::size_t turned = deterministic_reduce(
      0, tets.tets.size(), std::size_t{0},
      [&](std::size_t t) {
        const double volume = volume6(corner(t, 0), corner(t, 1), corner(t, 2), corner(t, 3));
        return std::size_t{sign * volume > 0 ? 0U : 1U};
      },
      std::plus<>());
  require(turned == 0 || is_baseline(run), ErrorCode::StageFailed, stage_names::kWrite,
          fmt::format("{} tets are so flat that they turn over in {} coordinates; make the surface "
                      "finer (smaller epsilon), or use --space grid",
                      turned, space_name(run.space)));
}

/// A format of the whole mesh of tets.
struct TetFormat {
  MeshFormat format;
  const char* suffix;
  decltype(&write_vtu) write;
};

constexpr std::array<TetFormat, 6> kTetFormats = {{{MeshFormat::Vtu, ".vtu", &write_vtu},
                                                   {MeshFormat::Mesh, ".mesh", &write_medit},
                                                   {MeshFormat::Inp, ".inp", &write_inp},
                                                   {MeshFormat::Msh, ".msh", &write_msh},
                                                   {MeshFormat::Msh22, ".v22.msh", &write_msh22},
                                                   {MeshFormat::Feb, ".feb", &write_feb}}};

/// Label boundaries and interfaces, each in a file of its own.
void write_surface_parts(Run& run, const LabelVolume& labels, const InterfaceMesh& surface) {
  const std::set<MeshFormat>& formats = run.request.formats;
  if (std::none_of(formats.begin(), formats.end(), is_surface_format)) return;
  for (const SurfacePart& part : surface_parts(surface, labels)) {
    const auto file = [&](const char* suffix) { return run.outputs.add("." + part.name + suffix); };
    if (formats.contains(MeshFormat::Stl)) write_stl(file(".stl"), part, run.mm_to_out, run.space);
    if (formats.contains(MeshFormat::Ply)) write_ply(file(".ply"), part, run.mm_to_out, run.space);
    if (formats.contains(MeshFormat::Vtp))
      write_surface_vtp(file(".vtp"), part.mesh, labels, run.mm_to_out, run.space);
  }
}

void write_files(Run& run, const LabelVolume& labels, const TetMesh& tets) {
  std::size_t written = 0;
  const auto files = static_cast<double>(kTetFormats.size() + 2);
  const auto report_file = [&] {
    report_progress(run.context, stage_names::kWrite, static_cast<double>(++written) / files);
  };
  for (const TetFormat& entry : kTetFormats) {
    if (!run.request.surface_only && run.request.formats.contains(entry.format))
      entry.write(run.outputs.add(entry.suffix), tets, labels, run.mm_to_out, run.space);
    report_file();
  }
  write_surface_parts(run, labels, tets.surface);
  report_file();
  write_surface_vtp(run.outputs.add(".surface.vtp"), tets.surface, labels, run.mm_to_out,
                    run.space);
}

}  // namespace

std::vector<std::string> mesh_suffixes(const RunRequest& request) {
  std::vector<std::string> suffixes = {".surface.vtp"};
  for (const TetFormat& entry : kTetFormats)
    if (!request.surface_only && request.formats.contains(entry.format))
      suffixes.emplace_back(entry.suffix);
  return suffixes;
}

void write_results(Run& run, const LabelVolume& labels, const TetMesh& tets) {
  require_positive(run, tets);
  run.stage.run(
      stage_names::kWrite,
      [&] {
        write_files(run, labels, tets);
        return run.outputs.files().size();
      },
      [](std::size_t files) { return fmt::format("{} files", files); });
}

}  // namespace cvmesh
