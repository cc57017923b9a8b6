// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/pipeline/write_results.h"

#include "cvmesh/io/feb_writer.h"
#include "cvmesh/io/inp_writer.h"
#include "cvmesh/io/msh_writer.h"
#include "cvmesh/io/surface_parts.h"
#include "cvmesh/io/surface_writer.h"
#include "cvmesh/io/tet_writer.h"
#include "cvmesh/pipeline/check_mesh.h"
#include "cvmesh/pipeline/stage_names.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <array>
#include <set>

namespace cvmesh {
namespace {

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
  if (!is_baseline(run)) require_positive(tets, run.mm_to_out, run.space);
  run.stage.run(
      stage_names::kWrite,
      [&] {
        write_files(run, labels, tets);
        return run.outputs.files().size();
      },
      [](std::size_t files) { return fmt::format("{} files", files); });
}

}  // namespace cvmesh
