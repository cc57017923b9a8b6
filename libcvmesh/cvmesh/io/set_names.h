// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/labels/label_volume.h"
#include "cvmesh/mesh/interface_mesh.h"

#include <cstddef>
#include <string>
#include <vector>

// Names of the sets that solvers select by, told apart whatever the labels are called. Private to
// io.
namespace cvmesh {

/// Per material id, as Abaqus, CalculiX and FEBio take them: upper-case letters, digits and single
/// underscores, at most 28 characters, so that a set of two of them stays within 64.
///
/// @return  all different: EXTERIOR for the exterior, else the label's name with anything else
///          replaced by an underscore, LABEL without a name. Where names collide, or one has no
///          legal character, the label's value follows (M for a minus).
std::vector<std::string> plain_label_names(const LabelVolume& labels);

/// Per row of the interface table: INSIDE_OUTSIDE, with an end such as _XMIN for a box face; all
/// different, at most 62 characters.
std::vector<std::string> plain_interface_names(const std::vector<PatchKey>& patches,
                                               const std::vector<std::string>& name_of);

/// Per material id, for programs that take any text between double quotes: the label's name on one
/// line, a double quote made single, at most 60 bytes cut between characters, all different.
std::vector<std::string> quotable_label_names(const LabelVolume& labels);

/// Per row of the interface table: `inside | outside`, and `, x-` for a box face; all different, at
/// most 127 bytes.
std::vector<std::string> quotable_interface_names(const std::vector<PatchKey>& patches,
                                                  const std::vector<std::string>& name_of);

/// The first `max_bytes` of a UTF-8 text, less where a character would be cut.
std::string cut_between_characters(std::string text, std::size_t max_bytes);

}  // namespace cvmesh
