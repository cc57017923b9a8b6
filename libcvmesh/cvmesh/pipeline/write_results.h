// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/labels/label_volume.h"
#include "cvmesh/mesh/tet_mesh.h"
#include "cvmesh/pipeline/run.h"

#include <string>
#include <vector>

namespace cvmesh {

/// Suffixes of the mesh's files, but for those of single labels and interfaces, whose names are
/// known only later.
std::vector<std::string> mesh_suffixes(const RunRequest& request);

/// Writes the finished mesh, in the frame of `labels`, in every format that the run asks for, and
/// NAME.surface.vtp.
/// @throws Error StageFailed where the file's coordinates turn a tet over; Output
void write_results(Run& run, const LabelVolume& labels, const TetMesh& tets);

}  // namespace cvmesh
