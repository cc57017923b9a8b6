// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/params/parameters.h"

#include <array>
#include <limits>
#include <span>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

namespace cvmesh {

/// The value behind a key, inside a `Parameters` or one of the structs that its lists hold.
using ParameterField = std::variant<bool*,
                                    int*,
                                    std::size_t*,
                                    double*,
                                    std::optional<std::size_t>*,
                                    std::optional<double>*,
                                    std::optional<std::string>*,
                                    TargetSizes*,
                                    Seeding*,
                                    OnDegenerate*,
                                    Schedule*,
                                    SurfaceMethod*,
                                    VoxelBox*,
                                    std::optional<VoxelBox>*,
                                    std::optional<GridSpacing>*,
                                    std::vector<Label>*,
                                    std::array<Label, 2>*,
                                    std::map<Label, std::vector<Label>>*,
                                    std::map<Label, LabelParameters>*,
                                    std::vector<InterfaceParameters>*,
                                    std::vector<BoxParameters>*,
                                    std::vector<std::array<LabelReference, 2>>*,
                                    SampleParameters*,
                                    QualityGates*>;

/// One key of the parameter file. The parser, the JSON schema, the defaults and the messages all
/// read this; the default is what `field` holds in a fresh `Owner`.
template <typename Owner>
struct ParameterInfo {
  std::string_view key;
  std::string_view unit{};  ///< empty for pure numbers and choices
  std::string_view doc;     ///< one sentence: meaning, then what it costs
  ParameterField (*field)(Owner&);
  double min = -std::numeric_limits<double>::infinity();
  double max = std::numeric_limits<double>::infinity();
  bool min_is_exclusive = false;
  bool is_optional = false;  ///< `null` is allowed and means "not set"
  bool is_required = false;  ///< there is no default: an entry without it is refused
  std::span<const std::string_view> choices{};  ///< names of the enumerators, in their order
};

/// All keys of the parameter file, in the order in which files and reports list them.
const std::vector<ParameterInfo<Parameters>>& parameter_table();

/// The keys of one entry of "labels".
const std::vector<ParameterInfo<LabelParameters>>& label_parameter_table();

/// The keys of one entry of "interfaces".
const std::vector<ParameterInfo<InterfaceParameters>>& interface_parameter_table();

/// The keys of one entry of "boxes".
const std::vector<ParameterInfo<BoxParameters>>& box_parameter_table();

/// The keys of "sample".
const std::vector<ParameterInfo<SampleParameters>>& sample_parameter_table();
/// The keys of "gates".
const std::vector<ParameterInfo<QualityGates>>& gate_table();

}  // namespace cvmesh
