# SPDX-License-Identifier: AGPL-3.0-or-later
# Finds three.js, which draws the mesh in the HTML report, and its camera control, as Debian's
# package libjs-three installs them: CVMESH_THREE_JS, CVMESH_ORBIT_CONTROLS_JS.
set(three_folders /usr/share/javascript/three /usr/local/share/javascript/three)
find_file(CVMESH_THREE_JS three.min.js PATHS ${three_folders}
          DOC "three.js, minified, as a script that defines THREE")
find_file(CVMESH_ORBIT_CONTROLS_JS OrbitControls.js PATHS ${three_folders}
          PATH_SUFFIXES examples/js/controls DOC "OrbitControls of the same release of three.js")
mark_as_advanced(CVMESH_THREE_JS CVMESH_ORBIT_CONTROLS_JS)
foreach(file IN ITEMS CVMESH_THREE_JS CVMESH_ORBIT_CONTROLS_JS)
  if(NOT ${file})
    message(FATAL_ERROR "${file} was not found: install the package libjs-three "
      "(scripts/install_dependencies.sh does), or set it to the file of three.js 111")
  endif()
endforeach()
