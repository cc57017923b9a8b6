// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/labels/label_volume.h"
#include "cvmesh/mesh/tet_mesh.h"
#include "cvmesh/pipeline/run.h"

/// What a measured mesh of tets gets before it is written, where a run asks for it.
namespace cvmesh {

/// Looks up `sample.labels` and reads the image that `--sample` names: what is wrong with them ends
/// the run before the long work. The image is given back, so that it takes no memory meanwhile.
/// @throws Error BadParameter, BadInput
void check_sample(Run& run, const LabelVolume& labels);

/// Cuts the interfaces of `contact` open.
void cut_contacts(Run& run, const LabelVolume& labels, TetMesh& tets);

/// Samples the image onto the tets: the arrays `sample_mean` and `sample_median`, and where the
/// parameters give the laws, `density_g_cm3`, `modulus_mpa` (0 in other labels) and elastic bins.
/// @param labels  the frame that the mesh is in
/// @throws Error BadInput where tets lie outside the image
void add_samples(Run& run, const LabelVolume& labels, TetMesh& tets);

}  // namespace cvmesh
