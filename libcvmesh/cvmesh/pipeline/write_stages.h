// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/grid/grid_frame.h"
#include "cvmesh/labels/label_volume.h"
#include "cvmesh/medial/medial_axis.h"
#include "cvmesh/mesh/interface_mesh.h"
#include "cvmesh/particles/particle_set.h"
#include "cvmesh/sizing/sizing_field.h"

#include <filesystem>

/// Results of single stages as files to look at: what they hold, as VTK point arrays.
namespace cvmesh {

/// Points of the medial axis with `radius_mm` and the `label` they lie in.
void write_medial_axis(const std::filesystem::path& path,
                       const MedialAxis& medial_axis,
                       const LabelVolume& labels,
                       const Affine& mm_to_out,
                       Space space);

/// The dense surface with `lfs_mm` and `h_mm` at its vertices.
void write_sizing_field(const std::filesystem::path& path,
                        const SizingField& sizing_field,
                        const InterfaceMesh& dense,
                        const Affine& mm_to_out,
                        Space space);

/// The particles with `h_mm`, `dimension` (0 corner, 1 curve, 2 interface), `stratum` and
/// `is_guard`.
void write_particles(const std::filesystem::path& path,
                     const ParticleSet& particles,
                     const Affine& mm_to_out,
                     Space space);

}  // namespace cvmesh
