// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/core/context.h"
#include "cvmesh/tet/tetgen_protocol.h"

#include <cstdint>
#include <string>

namespace cvmesh {

/// How one run of the helper program cvmesh-tetgen ended.
enum class TetgenOutcome {
  Meshed,       ///< `reply` holds at least one tet
  NoTets,       ///< it returned nothing: the surface is not closed
  Refused,      ///< TetGen gave up with an error number
  Crashed,      ///< ended by a signal or with an unexpected exit code
  OutOfMemory,  ///< its memory limit was reached, or the system killed it
  TimedOut,     ///< the time limit was reached; the helper was killed
  BrokenReply,  ///< its reply was cut short or does not match its checksum
};

struct TetgenLimits {
  double time_s = 0;     ///< 0: none
  double memory_mb = 0;  ///< address space; 0: none
};

/// What a run gave, and, unless `outcome` is `Meshed`, one sentence for the user: what happened
/// and what to change.
struct TetgenRun {
  TetgenOutcome outcome = TetgenOutcome::Meshed;
  std::string description;
  tetgen_protocol::Reply reply;
  double seconds = 0;
  double peak_mb = 0;  ///< of the helper
};

/// Path of the helper program: the environment variable CVMESH_TETGEN_HELPER; else, seen from the
/// file that holds this code and from the running executable, `../libexec/cvmesh/cvmesh-tetgen`,
/// the same folder, and the folder where a build tree puts it.
///
/// @throws Error StageFailed when there is none, or the variable names no executable file
std::string find_tetgen_helper();

/// Runs TetGen on `request` in the helper program, without any check of the input.
///
/// TetGen 1.5.0 is not thread-safe, crashes on intersecting facets and does not return on some
/// input, so it never runs in this process. The helper dies with this process, and is killed when
/// the time limit passes or `context.cancel` is set. Safe to call from several threads.
///
/// @throws Error Limit when cancelled, StageFailed when the helper cannot be found or started
TetgenRun run_tetgen(const tetgen_protocol::Request& request,
                     const TetgenLimits& limits,
                     const StageContext& context);

}  // namespace cvmesh
