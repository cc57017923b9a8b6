// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/levelset/level_sets.h"
#include "cvmesh/medial/medial_axis.h"
#include "cvmesh/mesh/tet_mesh.h"
#include "cvmesh/pipeline/run.h"

namespace cvmesh {

/// From the dense surfaces to the tets, at the scale that the parameters ask for: epsilon, or the
/// one that gives the wanted vertices, tets or distance. Stats of the stages, of the round that
/// counts, go into the report, and so does how the scale was found; a goal that was missed is a
/// warning.
TetMesh mesh_at_scale(Run& run,
                      const LabelVolume& labels,
                      LevelSets level_sets,
                      const Dense& dense,
                      MedialAxis medial_axis);

}  // namespace cvmesh
