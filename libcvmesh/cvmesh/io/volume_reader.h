// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/labels/label_volume.h"

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace cvmesh {

/// What a reader takes only when it is asked to.
struct ReadVolumeOptions {
  std::optional<int> volume{};  ///< of a 4-D file, from 0; without it such a file is refused
  bool allow_shear = false;     ///< axes that are more than 1 % off a right angle
  bool allow_detached = false;  ///< voxels in a file beside the header (.mhd, NRRD's `data file`)
};

/// The label volume in a file: `.nii`, `.nii.gz` (NIfTI-1 and -2), `.mha`, `.mhd`, `.nrrd`.
///
/// The frame's `index_to_world` is the file's own map, bit by bit, in the file's own space:
/// - NIfTI, RAS: the s-form if its code is set, else the q-form, else the voxel sizes alone;
///   metres and microns become millimetres.
/// - MetaImage, LPS: TransformMatrix, ElementSpacing and Offset (`AnatomicalOrientation` does not
///   matter, as in ITK).
/// - NRRD as its field `space` declares: RAS, LPS or LAS; otherwise the space is Unknown.
///
/// `spacing_mm` are the column norms of that map. Headers are parsed and data checked (length,
/// checksums) by our own code before any library sees the file, since damaged and hostile files
/// are read by ITK 5.2 without complaint. A one-slice volume (n x m x 1) is a volume; a
/// two-dimensional image is not.
///
/// @param warnings  if given, gets one sentence per oddity that the mesh depends on (q-form and
///                  s-form differ, no orientation stored, units converted)
/// @throws Error BadInput for anything that is no three-dimensional scalar label volume: missing,
///         damaged or truncated file, other dimensions, vector or colour voxels, values that are
///         no integers (tolerance 1e-3, then rounded) or leave Int32, scaled values, degenerate
///         geometry; for several volumes in one file, sheared axes and voxels in a file of their
///         own, unless `options` allow them, and then for data elsewhere than in a plain sibling
/// @note   4 bytes per voxel, plus the size of the file's voxels for MetaImage and NRRD
InputVolume read_label_volume(const std::filesystem::path& path,
                              std::vector<std::string>* warnings = nullptr,
                              const ReadVolumeOptions& options = {});

/// The files that hold a volume: its own, and the one beside it that a header may name.
/// @throws Error BadInput where the header cannot be read
std::vector<std::filesystem::path> volume_files(const std::filesystem::path& path);

/// An image of any values from a file of the same kinds, scaled as a NIfTI header says.
/// @throws Error BadInput as `read_label_volume`, but for the values: these must be finite
Grid<float> read_image(const std::filesystem::path& path,
                       std::vector<std::string>* warnings = nullptr,
                       const ReadVolumeOptions& options = {});

}  // namespace cvmesh
