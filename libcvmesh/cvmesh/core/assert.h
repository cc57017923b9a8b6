// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/core/error.h"

#include <string>

/// Checks what only cvmesh itself can cause: debug and sanitizer builds throw `Error{Internal}`.
#ifdef CVMESH_ENABLE_ASSERTS
#define CVMESH_ASSERT(condition)                                                   \
  do {                                                                             \
    if (!(condition))                                                              \
      throw ::cvmesh::Error(                                                       \
          ::cvmesh::ErrorCode::Internal, "assertion",                              \
          std::string(#condition " at " __FILE__ ":") + std::to_string(__LINE__)); \
  } while (false)
#else
#define CVMESH_ASSERT(condition) static_cast<void>(0)
#endif
