// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include <filesystem>
#include <map>
#include <string>
#include <sys/types.h>
#include <vector>

namespace cvmesh::run_cli {

/// How a command ended.
struct Outcome {
  int exit_code = -1;  ///< 128+n when signal n killed it
  std::string out, err;
};

/// A running cvmesh executable whose output goes into a folder of its own.
class Process {
 public:
  /// @param environment  variables to set besides the caller's own
  explicit Process(const std::vector<std::string>& arguments,
                   const std::map<std::string, std::string>& environment = {});
  ~Process();
  Process(const Process&) = delete;
  Process& operator=(const Process&) = delete;

  void send_signal(int signal) const;
  Outcome wait();

 private:
  std::filesystem::path folder_;
  pid_t pid_ = -1;
};

/// Runs `cvmesh arguments...` to its end.
Outcome cvmesh(const std::vector<std::string>& arguments,
               const std::map<std::string, std::string>& environment = {});

}  // namespace cvmesh::run_cli
