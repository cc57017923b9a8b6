# SPDX-License-Identifier: AGPL-3.0-or-later
# cvmesh_build_flags: warnings, sanitizers and floating-point rules of every target of this project.
add_library(cvmesh_build_flags INTERFACE)

target_compile_options(cvmesh_build_flags INTERFACE
  -Wall -Wextra -Wpedantic -Wshadow
  # No fused multiply-add: equal input gives equal bytes on every machine.
  -ffp-contract=off
  $<$<BOOL:${CVMESH_WERROR}>:-Werror>)

if(CVMESH_SANITIZE)
  target_compile_options(cvmesh_build_flags INTERFACE
    -fsanitize=${CVMESH_SANITIZE} -fno-omit-frame-pointer -fno-sanitize-recover=all
    -Wno-maybe-uninitialized)  # GCC 12 warns of <regex> where a sanitizer is on
  target_link_options(cvmesh_build_flags INTERFACE -fsanitize=${CVMESH_SANITIZE})
endif()
if(CVMESH_ENABLE_ASSERTS)
  target_compile_definitions(cvmesh_build_flags INTERFACE CVMESH_ENABLE_ASSERTS)
endif()
