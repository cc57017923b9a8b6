// SPDX-License-Identifier: AGPL-3.0-or-later
#include "console.h"

#include <spdlog/sinks/stdout_sinks.h>
#include <spdlog/spdlog.h>

#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <unistd.h>

namespace cvmesh::app {

namespace {

constexpr int kBarWidth = 30;
constexpr double kRedrawSeconds = 0.05;
/// Back to the line's start and clear it.
constexpr char kClearLine[] = "\r\033[K";

void print(const std::string& text) {
  std::fwrite(text.data(), 1, text.size(), stderr);
  std::fflush(stderr);
}

std::string row(const char* name, const std::string& value) {
  return fmt::format("  {:<22} {}\n", name, value);
}

std::string distance_row(const SurfaceDistance& distance) {
  return fmt::format("mean {:.3f}, max {:.2f} voxels (mean {:.3g}, max {:.3g} {})",
                     distance.voxels.mean_symmetric(), distance.voxels.hausdorff_lower_bound(),
                     distance.true_mm().mean_symmetric(),
                     distance.true_mm().hausdorff_lower_bound(),
                     distance.world_mm ? "mm in the world" : "mm");
}

}  // namespace

std::shared_ptr<spdlog::logger> make_log(bool is_quiet, bool is_verbose, bool has_bar) {
  auto log =
      std::make_shared<spdlog::logger>("cvmesh", std::make_shared<spdlog::sinks::stderr_sink_mt>());
  // what is said in the middle of a stage takes the place of its bar
  log->set_pattern(std::string(has_bar ? kClearLine : "") +
                   (is_verbose ? "%H:%M:%S.%e %^%l%$ %v" : "%H:%M:%S %^%l%$ %v"));
  log->set_level(is_verbose            ? spdlog::level::debug
                 : is_quiet || has_bar ? spdlog::level::warn
                                       : spdlog::level::info);
  log->flush_on(spdlog::level::debug);
  return log;
}

bool is_terminal() {
  const char* name = std::getenv("TERM");  // NOLINT(concurrency-mt-unsafe): before any thread
  return isatty(STDERR_FILENO) == 1 && name != nullptr && std::strcmp(name, "dumb") != 0;
}

void ProgressBar::begin(std::string_view stage) {
  drawn_percent_ = -1;
  advance(stage, 0);
}

void ProgressBar::advance(std::string_view stage, double fraction) {
  const int percent = static_cast<int>(std::lround(100 * std::min(1.0, std::max(0.0, fraction))));
  const bool is_first = drawn_percent_ < 0;
  if (percent <= drawn_percent_ || (!is_first && since_redraw_.seconds() < kRedrawSeconds)) return;
  drawn_percent_ = percent;
  since_redraw_ = Timer();
  const int filled = kBarWidth * percent / 100;
  print(fmt::format("{}{:<22} [{}{}] {:3} %", kClearLine, stage, std::string(filled, '#'),
                    std::string(kBarWidth - filled, ' '), percent));
}

void ProgressBar::end(std::string_view stage, double seconds, std::string_view summary) {
  print(fmt::format("{}{:<22} {} ({:.2f} s)\n", kClearLine, stage, summary, seconds));
  drawn_percent_ = -1;
}

void ProgressBar::clear() {
  if (drawn_percent_ >= 0) print(kClearLine);
}

std::string summary_table(const RunResult& result) {
  const Report& report = result.report;
  std::string table = "\n";
  if (report.parameters.surface == SurfaceMethod::Delaunay)
    table += row("baseline", "Delaunay reconstruction, with its faults");
  table += row("labels", std::to_string(report.label_of.size() - 1));
  if (report.mesh) {
    if (report.mesh->tets > 0) table += row("tets", std::to_string(report.mesh->tets));
    table += row("surface vertices", std::to_string(report.mesh->surface_vertices));
    table += row("surface triangles", std::to_string(report.mesh->surface_triangles));
  }
  if (report.distances) {
    if (report.distances->to_dense)
      table += row("to the dense surface", distance_row(report.distances->to_dense->overall));
    table += row("to the labels", distance_row(report.distances->to_labels.overall));
  }
  if (report.quality) {
    const Distribution& triangles = report.quality->triangles.radius_ratio;
    table += row("triangles 2r/R",
                 fmt::format("mean {:.3f}, min {:.3f}", triangles.mean, triangles.min));
    const TetQuality& tets = report.quality->tets;
    if (tets.radius_ratio.count > 0) {
      table += row("tets 3r/R", fmt::format("mean {:.3f}, min {:.3f}", tets.radius_ratio.mean,
                                            tets.radius_ratio.min));
      table += row("smallest dihedral", fmt::format("{:.2f} degrees", tets.min_dihedral_deg.min));
    }
  }
  for (const GateResult& gate : report.gates)
    table += row("gate", fmt::format("{} {}: {:.4g}, bound {:g}", gate.gate,
                                     gate.passed ? "kept" : "missed", gate.value, gate.bound));
  table += row("time", fmt::format("{:.1f} s on {} threads", report.total_seconds, report.threads));
  table += row("peak memory", fmt::format("{:.0f} MiB", report.peak_mb));
  for (const auto& file : result.files)
    table += row("file", file.string());
  return table;
}

}  // namespace cvmesh::app
