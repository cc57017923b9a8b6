// SPDX-License-Identifier: AGPL-3.0-or-later
#include "summary_command.h"

#include "cvmesh/core/error.h"
#include "cvmesh/io/atomic_file.h"
#include "cvmesh/io/json_io.h"
#include "cvmesh/report/summarize_reports.h"

#include <nlohmann/json.hpp>
#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <array>
#include <filesystem>
#include <iostream>
#include <set>
#include <string_view>
#include <system_error>

namespace cvmesh::app {

namespace fs = std::filesystem;

namespace {

constexpr std::array<std::string_view, 2> kSuffixes = {".metrics.json", ".failed.json"};

/// The path without the suffix of a report; empty if it has none.
std::string run_of(const fs::path& path) {
  const std::string text = path.string();
  for (const std::string_view suffix : kSuffixes)
    if (path.filename().string().size() > suffix.size() &&
        text.compare(text.size() - suffix.size(), suffix.size(), suffix) == 0)
      return text.substr(0, text.size() - suffix.size());
  return {};
}

/// What lies in a folder and below it, by path; folders that cannot be entered are told in
/// `faults`.
void collect(const fs::path& folder,
             std::vector<fs::path>& files,
             std::vector<std::pair<fs::path, std::string>>& faults) {
  std::error_code error;
  std::vector<fs::path> entries;
  for (fs::directory_iterator entry(folder, error), end; !error && entry != end;
       entry.increment(error))
    entries.push_back(entry->path());
  if (error) faults.emplace_back(folder, "the folder cannot be read: " + error.message());
  std::sort(entries.begin(), entries.end());
  for (const fs::path& path : entries) {
    std::error_code ignored;
    // Links to folders are not followed: they may lead in circles.
    if (fs::is_directory(fs::symlink_status(path, ignored)))
      collect(path, files, faults);
    else if (!run_of(path).empty())
      files.push_back(path);
  }
}

RunSummary summarize_file(const fs::path& path) {
  const std::string run = run_of(path);
  try {
    return summarize_report(read_json(path, ErrorCode::BadInput, "report"), run);
  } catch (const Error& error) {
    return unreadable_row(run, error.message());
  }
}

std::vector<RunSummary> summarize_folders(const std::vector<std::string>& folders) {
  std::vector<fs::path> files;
  std::vector<std::pair<fs::path, std::string>> faults;
  for (const std::string& folder : folders) {
    std::error_code ignored;
    require(fs::is_directory(folder, ignored), ErrorCode::BadInput, "summary",
            "'" + folder + "' is no folder; give the folders that hold the reports");
    collect(folder, files, faults);
  }
  std::vector<RunSummary> rows;
  std::set<fs::path> seen;  // a folder may be named twice, or with one inside it
  for (const fs::path& file : files)
    if (seen.insert(fs::weakly_canonical(file)).second) rows.push_back(summarize_file(file));
  for (const auto& [folder, reason] : faults)
    rows.push_back(unreadable_row(folder.string(), reason));
  require(!rows.empty(), ErrorCode::BadInput, "summary",
          fmt::format("there is no NAME.metrics.json and no NAME.failed.json in '{}'{}",
                      folders.front(), folders.size() > 1 ? " and the others" : ""));
  return rows;
}

std::string to_csv(const std::vector<RunSummary>& rows) {
  const auto& columns = summary_columns();
  std::string csv = csv_record({columns.begin(), columns.end()});
  for (const RunSummary& row : rows)
    csv += csv_record(row.cells);
  return csv;
}

}  // namespace

int run_summary(const SummaryCommand& command) {
  const std::vector<RunSummary> rows = summarize_folders(command.folders);
  const std::string csv = to_csv(rows);
  if (command.out_file.empty()) {
    std::cout << csv << std::flush;
    require(std::cout.good(), ErrorCode::Output, "write", "standard output cannot be written");
  } else {
    AtomicFile file(command.out_file);
    file.write(csv);
    file.commit();
  }
  const auto of_status = [&](RunStatus status) {
    return std::count_if(rows.begin(), rows.end(),
                         [&](const RunSummary& row) { return row.status == status; });
  };
  const auto succeeded = of_status(RunStatus::Success);
  std::cerr << fmt::format("{} runs: {} succeeded, {} missed gates, {} failed, {} unreadable\n",
                           rows.size(), succeeded, of_status(RunStatus::MissedGates),
                           of_status(RunStatus::Failed), of_status(RunStatus::Unreadable));
  return succeeded == static_cast<std::ptrdiff_t>(rows.size())
             ? 0
             : static_cast<int>(ErrorCode::QualityGate);
}

}  // namespace cvmesh::app
