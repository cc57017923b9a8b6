// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/params/parse_parameters.h"

#include "cvmesh/core/error.h"
#include "cvmesh/core/utf8.h"
#include "cvmesh/params/parameter_table.h"

#include <nlohmann/json.hpp>
#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <limits>
#include <numeric>
#include <span>
#include <type_traits>
#include <utility>

namespace cvmesh {

namespace {

using Json = nlohmann::ordered_json;

constexpr char kCommentKey[] = "comment";
constexpr char kGatesKey[] = "gates";

[[noreturn]] void refuse(const std::string& source, const std::string& message) {
  throw Error(ErrorCode::BadParameter, "parameters", source + ": " + message);
}

/// Levenshtein distance: insertions, deletions and replacements that turn one word into the other.
std::size_t edit_distance(std::string_view a, std::string_view b) {
  std::vector<std::size_t> row(b.size() + 1);
  std::iota(row.begin(), row.end(), std::size_t{0});
  for (std::size_t i = 1; i <= a.size(); ++i) {
    std::size_t diagonal = row[0];
    row[0] = i;
    for (std::size_t j = 1; j <= b.size(); ++j) {
      const std::size_t replaced = diagonal + (a[i - 1] == b[j - 1] ? 0 : 1);
      diagonal = row[j];
      row[j] = std::min({row[j] + 1, row[j - 1] + 1, replaced});
    }
  }
  return row.back();
}

template <typename Owner>
const ParameterInfo<Owner>& find_info(const std::vector<ParameterInfo<Owner>>& table,
                                      const std::string& key,
                                      const std::string& prefix,
                                      const std::string& source) {
  for (const ParameterInfo<Owner>& info : table)
    if (info.key == key) return info;
  const auto nearest =
      std::min_element(table.begin(), table.end(), [&](const auto& a, const auto& b) {
        return edit_distance(a.key, key) < edit_distance(b.key, key);
      });
  refuse(source, fmt::format("unknown key \"{}{}\"; did you mean \"{}{}\"? `cvmesh schema` lists "
                             "all keys",
                             prefix, key, prefix, nearest->key));
}

const char* type_word(const Json& value) {
  switch (value.type()) {
    case Json::value_t::null:
      return "null";
    case Json::value_t::boolean:
      return "a boolean";
    case Json::value_t::string:
      return "a string";
    case Json::value_t::array:
      return "an array";
    case Json::value_t::object:
      return "an object";
    default:
      return "a number";
  }
}

/// What a message needs to know about the value that is being read.
struct Place {
  std::string source, path;  ///< file name; "epsilon" or "labels.2.epsilon"
  double min, max;
  bool min_is_exclusive, is_optional;
};

/// A value for a message; bytes that are no UTF-8 (settings come from the command line as they are)
/// are replaced.
std::string text_of(const Json& value) {
  return value.dump(-1, ' ', false, Json::error_handler_t::replace);
}

[[noreturn]] void refuse_type(const Place& place, const Json& value, const std::string& wanted) {
  refuse(place.source,
         fmt::format("{} ({}) is {}; give {}{}", place.path, text_of(value), type_word(value),
                     wanted, place.is_optional ? ", or null for \"not set\"" : ""));
}

void check_bounds(const Place& place, const Json& value, double number) {
  const bool is_low = place.min_is_exclusive ? number <= place.min : number < place.min;
  if (is_low)
    refuse(place.source,
           fmt::format("{} ({}) must be {} {}; raise it, or leave it out for the "
                       "default",
                       place.path, text_of(value),
                       place.min_is_exclusive ? "greater than" : "at least", place.min));
  if (number > place.max)
    refuse(place.source,
           fmt::format("{} ({}) must be at most {}; lower it, or leave it out for the default",
                       place.path, text_of(value), place.max));
}

double read_number(const Place& place, const Json& value) {
  if (!value.is_number()) refuse_type(place, value, "a number");
  const double number = value.get<double>();
  check_bounds(place, value, number);
  return number;
}

/// Whole numbers may be written 1000, 1000.0 or 1e3.
template <typename Integer>
Integer read_integer(const Place& place, const Json& value) {
  if (!value.is_number()) refuse_type(place, value, "a whole number");
  const double number = value.get<double>();
  if (number != std::floor(number))
    refuse(place.source,
           fmt::format("{} ({}) must be a whole number; round it", place.path, text_of(value)));
  check_bounds(place, value, number);
  return value.is_number_integer() ? value.get<Integer>() : static_cast<Integer>(number);
}

template <typename Enum>
Enum read_choice(const Place& place, const Json& value, std::span<const std::string_view> choices) {
  std::string list;
  for (const std::string_view choice : choices)
    list += fmt::format("{}\"{}\"", list.empty() ? "" : " or ", choice);
  if (!value.is_string()) refuse_type(place, value, list);
  const auto found = std::find(choices.begin(), choices.end(), value.get<std::string>());
  if (found == choices.end())
    refuse(place.source, fmt::format("{} ({}) is not one of its values; give {}", place.path,
                                     text_of(value), list));
  return static_cast<Enum>(found - choices.begin());
}

Label read_label_value(const Place& place, const Json& value) {
  Place bounds = place;
  bounds.min = std::numeric_limits<Label>::min();
  bounds.max = std::numeric_limits<Label>::max();
  bounds.min_is_exclusive = false;
  return read_integer<Label>(bounds, value);
}

std::vector<Label> read_label_list(const Place& place, const Json& value) {
  if (!value.is_array()) refuse_type(place, value, "an array of label values, like [1, 2]");
  std::vector<Label> labels;
  for (const Json& item : value)
    labels.push_back(read_label_value(place, item));
  std::sort(labels.begin(), labels.end());
  labels.erase(std::unique(labels.begin(), labels.end()), labels.end());
  return labels;
}

std::array<Label, 2> read_label_pair(const Place& place, const Json& value) {
  constexpr char kWanted[] = "the two labels that meet, like [1, 2]";
  if (!value.is_array()) refuse_type(place, value, kWanted);
  if (value.size() != 2)
    refuse(place.source, fmt::format("{} ({}) has {} labels rather than 2; give {}", place.path,
                                     text_of(value), value.size(), kWanted));
  return {read_label_value(place, value[0]), read_label_value(place, value[1])};
}

/// Six numbers: the first voxel, then the last. Their order is checked against the volume.
VoxelBox read_voxel_box(const Place& place, const Json& value) {
  constexpr char kWanted[] = "the first and the last voxel, like [0, 0, 0, 63, 63, 31]";
  if (!value.is_array()) refuse_type(place, value, kWanted);
  if (value.size() != 6)
    refuse(place.source, fmt::format("{} ({}) has {} numbers rather than 6; give {}", place.path,
                                     text_of(value), value.size(), kWanted));
  Place bounds = place;
  bounds.min = 0;
  bounds.max = std::numeric_limits<int>::max();
  bounds.is_optional = false;
  VoxelBox box;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    box.lo[axis] = read_integer<int>(bounds, value[axis]);
    box.hi[axis] = read_integer<int>(bounds, value[axis + 3]);
  }
  return box;
}

constexpr char kAuto[] = "auto";

GridSpacing read_grid_spacing(const Place& place, const Json& value) {
  if (value == kAuto) return {.is_auto = true};
  if (!value.is_number()) refuse_type(place, value, "a number, or \"auto\"");
  return {.is_auto = false, .mm = read_number(place, value)};
}

std::map<Label, std::vector<Label>> read_label_merges(const Place& place, const Json& value);
std::map<Label, LabelParameters> read_label_table(const Place& place, const Json& value);
std::vector<InterfaceParameters> read_interfaces(const Place& place, const Json& value);
std::vector<BoxParameters> read_boxes(const Place& place, const Json& value);
std::vector<std::array<LabelReference, 2>> read_contacts(const Place& place, const Json& value);
SampleParameters read_sample(const Place& place, const Json& value);
QualityGates read_gates(const Place& place, const Json& value);

/// Reads `value` into the field of `owner` that `info` describes.
template <typename Owner>
void read_parameter(const ParameterInfo<Owner>& info,
                    const std::string& prefix,
                    const Json& value,
                    const std::string& source,
                    Owner& owner) {
  const Place place{source,   prefix + std::string(info.key), info.min,
                    info.max, info.min_is_exclusive,          info.is_optional};
  if (value.is_null() && info.is_optional) return;
  std::visit(
      [&](auto* field) {
        using Value = std::remove_pointer_t<decltype(field)>;
        if constexpr (std::is_same_v<Value, bool>) {
          if (!value.is_boolean()) refuse_type(place, value, "true or false");
          *field = value.get<bool>();
        } else if constexpr (std::is_same_v<Value, int> || std::is_same_v<Value, std::size_t>) {
          *field = read_integer<Value>(place, value);
        } else if constexpr (std::is_same_v<Value, std::optional<std::size_t>>) {
          *field = read_integer<std::size_t>(place, value);
        } else if constexpr (std::is_same_v<Value, double> ||
                             std::is_same_v<Value, std::optional<double>>) {
          *field = read_number(place, value);
        } else if constexpr (std::is_same_v<Value, std::optional<std::string>>) {
          if (!value.is_string() || value.get<std::string>().empty())
            refuse_type(place, value, "a non-empty string");
          *field = value.get<std::string>();
        } else if constexpr (std::is_enum_v<Value>) {
          *field = read_choice<Value>(place, value, info.choices);
        } else if constexpr (std::is_same_v<Value, std::vector<Label>>) {
          *field = read_label_list(place, value);
        } else if constexpr (std::is_same_v<Value, std::array<Label, 2>>) {
          *field = read_label_pair(place, value);
        } else if constexpr (std::is_same_v<Value, std::vector<InterfaceParameters>>) {
          *field = read_interfaces(place, value);
        } else if constexpr (std::is_same_v<Value, std::vector<BoxParameters>>) {
          *field = read_boxes(place, value);
        } else if constexpr (std::is_same_v<Value, std::vector<std::array<LabelReference, 2>>>) {
          *field = read_contacts(place, value);
        } else if constexpr (std::is_same_v<Value, SampleParameters>) {
          *field = read_sample(place, value);
        } else if constexpr (std::is_same_v<Value, QualityGates>) {
          *field = read_gates(place, value);
        } else if constexpr (std::is_same_v<Value, VoxelBox> ||
                             std::is_same_v<Value, std::optional<VoxelBox>>) {
          *field = read_voxel_box(place, value);
        } else if constexpr (std::is_same_v<Value, std::optional<GridSpacing>>) {
          *field = read_grid_spacing(place, value);
        } else if constexpr (std::is_same_v<Value, std::map<Label, std::vector<Label>>>) {
          *field = read_label_merges(place, value);
        } else {
          *field = read_label_table(place, value);
        }
      },
      info.field(owner));
}

/// The label that a key names, as a JSON integer or null.
Json label_of_key(const std::string& key) {
  Label label = 0;
  const auto [end, error] = std::from_chars(key.data(), key.data() + key.size(), label);
  return error == std::errc() && end == key.data() + key.size() ? Json(label) : Json();
}

/// Calls read_entry(label, place of the entry, entry) for each entry of an object keyed by label.
template <typename ReadEntry>
void read_by_label(const Place& place, const Json& value, const ReadEntry& read_entry) {
  if (!value.is_object()) refuse_type(place, value, "an object keyed by label value");
  for (const auto& [key, entry] : value.items()) {
    if (key == kCommentKey) continue;
    const Json label = label_of_key(key);
    if (label.is_null())
      refuse(place.source,
             fmt::format("{} key \"{}\" is not a label value; use the whole number that the label "
                         "has in the volume, like \"2\"",
                         place.path, key));
    read_entry(label.get<Label>(), Place{place.source, place.path + "." + key, 0, 0, false, false},
               entry);
  }
}

std::map<Label, std::vector<Label>> read_label_merges(const Place& place, const Json& value) {
  std::map<Label, std::vector<Label>> merges;
  read_by_label(place, value, [&](Label label, const Place& entry_place, const Json& entry) {
    // Two spellings of one label, "2" and "02", add up.
    std::vector<Label>& sources = merges[label];
    for (const Label source : read_label_list(entry_place, entry))
      sources.push_back(source);
  });
  return merges;
}

/// An object whose keys `table` lists; `example` is one for messages.
template <typename Owner>
Owner read_entry(const std::vector<ParameterInfo<Owner>>& table,
                 const Place& place,
                 const Json& value,
                 const char* example) {
  if (!value.is_object()) refuse_type(place, value, fmt::format("an object like {}", example));
  const std::string prefix = place.path + ".";
  Owner owner;
  for (const auto& [key, item] : value.items())
    if (key != kCommentKey)
      read_parameter(find_info(table, key, prefix, place.source), prefix, item, place.source,
                     owner);
  for (const ParameterInfo<Owner>& info : table)
    if (info.is_required && !value.contains(info.key))
      refuse(place.source, fmt::format("{} ({}) has no key \"{}\"; write it like {}", place.path,
                                       text_of(value), info.key, example));
  return owner;
}

std::map<Label, LabelParameters> read_label_table(const Place& place, const Json& value) {
  std::map<Label, LabelParameters> labels;
  read_by_label(place, value, [&](Label label, const Place& entry_place, const Json& entry) {
    labels[label] = read_entry(label_parameter_table(), entry_place, entry, "{\"epsilon\": 0.5}");
  });
  return labels;
}

/// A list of such objects.
template <typename Owner>
std::vector<Owner> read_entries(const std::vector<ParameterInfo<Owner>>& table,
                                const Place& place,
                                const Json& value,
                                const char* example) {
  if (!value.is_array())
    refuse_type(place, value, fmt::format("an array of objects like {}", example));
  std::vector<Owner> entries;
  for (const Json& item : value) {
    const std::string path = fmt::format("{}[{}]", place.path, entries.size());
    entries.push_back(
        read_entry(table, Place{place.source, path, 0, 0, false, false}, item, example));
  }
  return entries;
}

std::vector<InterfaceParameters> read_interfaces(const Place& place, const Json& value) {
  return read_entries(interface_parameter_table(), place, value,
                      "{\"labels\": [1, 2], \"epsilon\": 0.5}");
}

std::vector<BoxParameters> read_boxes(const Place& place, const Json& value) {
  return read_entries(box_parameter_table(), place, value,
                      "{\"box\": [0, 0, 0, 9, 9, 9], \"epsilon\": 0.5}");
}

std::vector<std::array<LabelReference, 2>> read_contacts(const Place& place, const Json& value) {
  constexpr char kWanted[] =
      "an array of pairs of labels, by name or value, like [[\"stem\", \"cement\"], [3, 4]]";
  if (!value.is_array()) refuse_type(place, value, kWanted);
  std::vector<std::array<LabelReference, 2>> contacts;
  for (const Json& pair : value) {
    const Place pair_place{
        place.source, fmt::format("{}[{}]", place.path, contacts.size()), 0, 0, false, false};
    if (!pair.is_array() || pair.size() != 2)
      refuse(place.source,
             fmt::format("{} ({}) is no pair; give {}", pair_place.path, pair.dump(), kWanted));
    std::array<LabelReference, 2>& contact = contacts.emplace_back();
    for (std::size_t n = 0; n < 2; ++n)
      if (pair[n].is_string())
        contact[n] = pair[n].get<std::string>();
      else
        contact[n] = read_label_value(pair_place, pair[n]);
    if (contact[0] == contact[1])
      refuse(place.source, fmt::format("{} ({}) names one label twice; give the two that meet",
                                       pair_place.path, pair.dump()));
  }
  return contacts;
}

SampleParameters read_sample(const Place& place, const Json& value) {
  const SampleParameters sample =
      read_entry(sample_parameter_table(), place, value,
                 "{\"density_slope\": 0.0008, \"density_intercept\": 1}");
  if (sample.modulus_factor && !sample.density_slope)
    refuse(place.source, fmt::format("{0}.modulus_factor ({1}) needs a density; give "
                                     "{0}.density_slope, too",
                                     place.path, *sample.modulus_factor));
  if (sample.bins > 0 && !sample.modulus_factor)
    refuse(place.source, fmt::format("{0}.bins ({1}) needs a modulus; give {0}.modulus_factor, too",
                                     place.path, sample.bins));
  return sample;
}

QualityGates read_gates(const Place& place, const Json& value) {
  return read_entry(gate_table(), place, value, "{\"min_dihedral_deg\": 10}");
}

bool is_set(const Json& object, const char* key) {
  return object.contains(key) && !object[key].is_null();
}

/// Keys that say how sparse the mesh is, each in its own way: one at a time.
constexpr std::array<const char*, 5> kScaleKeys = {"epsilon", "target_vertices", "target_tets",
                                                   "max_distance_mm", "max_distance_vox"};

void refuse_two_scales(const Json& object, const std::string& source) {
  const char* first = nullptr;
  for (const char* key : kScaleKeys) {
    if (!is_set(object, key)) continue;
    if (first != nullptr)
      refuse(source, fmt::format("{} ({}) and {} ({}) exclude each other; set one of them to null",
                                 first, text_of(object[first]), key, text_of(object[key])));
    first = key;
  }
}

/// The value that the setting `path` goes to, in `parent`. An earlier setting may have given that
/// something else than an object.
Json& entry_of(Json& parent,
               const std::string& key,
               const std::string& path,
               const std::string& source) {
  if (!parent.is_object() && !parent.is_null())
    refuse(source,
           fmt::format("\"{}\" cannot be set in {}, which an earlier setting gave; leave out "
                       "one of the two",
                       path, text_of(parent)));
  return parent[key];
}

/// The settings "a=1", "labels.2.name=bone" as one JSON object.
Json parse_settings(const std::vector<std::string>& settings, const std::string& source) {
  Json object = Json::object();
  for (const std::string& setting : settings) {
    const std::size_t equals = setting.find('=');
    if (equals == std::string::npos || equals == 0)
      refuse(source, fmt::format("\"{}\" is not of the form key=value", setting));
    if (!is_utf8(setting))
      refuse(source, fmt::format("{} is no UTF-8; names of labels go into files that hold nothing "
                                 "else",
                                 text_of(setting)));
    const std::string path = setting.substr(0, equals), text = setting.substr(equals + 1);
    Json value = Json::parse(text, nullptr, false);
    if (value.is_discarded()) value = text;

    const std::size_t first = path.find('.');
    const std::size_t last = path.rfind('.');
    if (first == std::string::npos) {
      object[path] = value;
    } else if (path.substr(0, first) == kGatesKey && first == last) {
      entry_of(object[kGatesKey], path.substr(first + 1), path, source) = value;
    } else {
      if (path.substr(0, first) != "labels" || first == last)
        refuse(source, fmt::format("\"{}\" names no key; nested keys are labels.<label>.<key> and "
                                   "gates.<key>",
                                   path));
      Json& label =
          entry_of(object["labels"], path.substr(first + 1, last - first - 1), path, source);
      entry_of(label, path.substr(last + 1), path, source) = value;
    }
  }
  return object;
}

/// `settings` over `file`: whole keys, except that entries of "labels" and of "gates" are merged
/// key by key.
Json merged(Json file, const Json& settings) {
  for (const char* asked : kScaleKeys)
    if (is_set(settings, asked))
      for (const char* other : kScaleKeys)
        if (other != asked) file.erase(other);
  for (const auto& [key, value] : settings.items()) {
    if ((key == "labels" || key == kGatesKey) && value.is_object() && file.contains(key) &&
        file[key].is_object())
      file[key].merge_patch(value);
    else
      file[key] = value;
  }
  return file;
}

void check_edge_bounds(const std::optional<double>& lowest,
                       const std::optional<double>& highest,
                       const std::string& prefix,
                       const std::string& source) {
  if (lowest && highest && *lowest > *highest)
    refuse(source, fmt::format("{0}min_edge_mm ({1}) exceeds {0}max_edge_mm ({2}); lower "
                               "{0}min_edge_mm",
                               prefix, *lowest, *highest));
}

/// Each pair of two labels once, and bounds that do not cross where the interface sets only one of
/// them.
void check_interfaces(const Parameters& parameters, const std::string& source) {
  std::map<std::pair<Label, Label>, std::size_t> index_of;
  for (std::size_t n = 0; n < parameters.interfaces.size(); ++n) {
    const InterfaceParameters& own = parameters.interfaces[n];
    const auto [low, high] = std::minmax(own.labels[0], own.labels[1]);
    if (low == high)
      refuse(source, fmt::format("interfaces[{}].labels ([{}, {}]) names one label twice; give the "
                                 "two labels that meet",
                                 n, own.labels[0], own.labels[1]));
    const auto [first, is_new] = index_of.try_emplace({low, high}, n);
    if (!is_new)
      refuse(source, fmt::format("interfaces[{}].labels ([{}, {}]) names the labels of "
                                 "interfaces[{}] again; make one entry of the two",
                                 n, own.labels[0], own.labels[1], first->second));
    for (const Label label : own.labels) {
      if (label == 0 && !parameters.clean_labels.mesh_background) continue;  // it has no say
      const auto found = parameters.labels.find(label);
      const LabelParameters around =
          found != parameters.labels.end() ? found->second : LabelParameters{};
      const auto ruling = [](const auto& inner, const auto& middle, const auto& outer) {
        return inner ? inner : middle ? middle : outer;
      };
      check_edge_bounds(ruling(own.min_edge_mm, around.min_edge_mm, parameters.sizing.min_edge_mm),
                        ruling(own.max_edge_mm, around.max_edge_mm, parameters.sizing.max_edge_mm),
                        fmt::format("interfaces[{}].", n), source);
    }
  }
}

/// Boxes that hold a voxel, and bounds of one box that do not cross.
void check_boxes(const Parameters& parameters, const std::string& source) {
  for (std::size_t n = 0; n < parameters.boxes.size(); ++n) {
    const BoxParameters& own = parameters.boxes[n];
    for (std::size_t axis = 0; axis < 3; ++axis)
      if (own.box.lo[axis] > own.box.hi[axis])
        refuse(source, fmt::format("boxes[{0}].box begins at {1} = {2} and ends at {1} = {3}; give "
                                   "the first voxel, then the last",
                                   n, "ijk"[axis], own.box.lo[axis], own.box.hi[axis]));
    check_edge_bounds(own.min_edge_mm, own.max_edge_mm, fmt::format("boxes[{}].", n), source);
  }
}

/// The Delaunay baseline has no surface that could be refined or lifted onto the dense one.
void check_surface_method(const Parameters& parameters, const std::string& source) {
  if (parameters.surface != SurfaceMethod::Delaunay) return;
  const auto refuse_with = [&](const std::string& key) {
    refuse(
        source,
        fmt::format("surface (\"delaunay\") does not go with {}; leave one of the two out", key));
  };
  if (parameters.max_distance_mm) refuse_with("max_distance_mm");
  if (parameters.max_distance_vox) refuse_with("max_distance_vox");
  if (parameters.element_order > 1) refuse_with("element_order 2");
  if (parameters.schedule == Schedule::Sequential) refuse_with("schedule (\"sequential\")");
}

/// Checks that need more than one key.
void finish(Parameters& parameters, const std::string& source) {
  const SizingOptions& sizing = parameters.sizing;
  check_edge_bounds(sizing.min_edge_mm, sizing.max_edge_mm, "", source);
  for (const auto& [label, own] : parameters.labels) {
    const std::string prefix = fmt::format("labels.{}.", label);
    check_edge_bounds(own.min_edge_mm ? own.min_edge_mm : sizing.min_edge_mm,
                      own.max_edge_mm ? own.max_edge_mm : sizing.max_edge_mm, prefix, source);
    if (own.name) parameters.clean_labels.names[label] = *own.name;
  }
  if (parameters.curved_elements && parameters.element_order < 2)
    refuse(source,
           "curved_elements needs nodes on the edges, which element_order 1 does not have; "
           "set element_order to 2, or leave curved_elements out");
  check_interfaces(parameters, source);
  check_boxes(parameters, source);
  check_surface_method(parameters, source);
}

template <typename Owner>
Json to_json_object(const std::vector<ParameterInfo<Owner>>& table, Owner owner);

Json to_json_array(const VoxelBox& box) {
  return {box.lo[0], box.lo[1], box.lo[2], box.hi[0], box.hi[1], box.hi[2]};
}

Json to_json_array(const std::vector<std::array<LabelReference, 2>>& contacts) {
  Json list = Json::array();
  for (const std::array<LabelReference, 2>& contact : contacts) {
    Json pair = Json::array();
    for (const LabelReference& label : contact)
      std::visit([&](const auto& reference) { pair.push_back(reference); }, label);
    list.push_back(pair);
  }
  return list;
}

template <typename Owner>
Json to_json_list(const std::vector<ParameterInfo<Owner>>& table,
                  const std::vector<Owner>& owners) {
  Json list = Json::array();
  for (const Owner& owner : owners)
    list.push_back(to_json_object(table, owner));
  return list;
}

template <typename Owner>
Json to_json_value(const ParameterInfo<Owner>& info, Owner& owner) {
  return std::visit(
      [&](auto* field) -> Json {
        using Value = std::remove_pointer_t<decltype(field)>;
        if constexpr (std::is_enum_v<Value>) {
          return info.choices[static_cast<std::size_t>(*field)];
        } else if constexpr (std::is_same_v<Value, std::map<Label, LabelParameters>>) {
          Json labels = Json::object();
          for (const auto& [label, own] : *field)
            labels[std::to_string(label)] = to_json_object(label_parameter_table(), own);
          return labels;
        } else if constexpr (std::is_same_v<Value, std::vector<InterfaceParameters>>) {
          return to_json_list(interface_parameter_table(), *field);
        } else if constexpr (std::is_same_v<Value, std::vector<BoxParameters>>) {
          return to_json_list(box_parameter_table(), *field);
        } else if constexpr (std::is_same_v<Value, std::vector<std::array<LabelReference, 2>>>) {
          return to_json_array(*field);
        } else if constexpr (std::is_same_v<Value, SampleParameters>) {
          return to_json_object(sample_parameter_table(), *field);
        } else if constexpr (std::is_same_v<Value, QualityGates>) {
          return to_json_object(gate_table(), *field);
        } else if constexpr (std::is_same_v<Value, std::optional<double>> ||
                             std::is_same_v<Value, std::optional<std::size_t>> ||
                             std::is_same_v<Value, std::optional<std::string>>) {
          return *field ? Json(**field) : Json();
        } else if constexpr (std::is_same_v<Value, std::optional<VoxelBox>>) {
          return *field ? to_json_array(**field) : Json();
        } else if constexpr (std::is_same_v<Value, VoxelBox>) {
          return to_json_array(*field);
        } else if constexpr (std::is_same_v<Value, std::optional<GridSpacing>>) {
          if (!*field) return {};
          return (*field)->is_auto ? Json(kAuto) : Json((*field)->mm);
        } else if constexpr (std::is_same_v<Value, std::map<Label, std::vector<Label>>>) {
          Json merges = Json::object();
          for (const auto& [label, sources] : *field)
            merges[std::to_string(label)] = sources;
          return merges;
        } else {
          return *field;
        }
      },
      info.field(owner));
}

template <typename Owner>
Json to_json_object(const std::vector<ParameterInfo<Owner>>& table, Owner owner) {
  Json object;
  for (const ParameterInfo<Owner>& info : table)
    object[std::string(info.key)] = to_json_value(info, owner);
  return object;
}

}  // namespace

Parameters parse_parameters(const Json& file,
                            const std::string& source,
                            const std::vector<std::string>& settings) {
  if (!file.is_object())
    refuse(source, fmt::format("holds {}; a parameter file is one JSON object, like "
                               "{{\"epsilon\": 2}}",
                               type_word(file)));
  const std::string settings_source = "--set";
  const Json overrides = parse_settings(settings, settings_source);
  refuse_two_scales(file, source);
  refuse_two_scales(overrides, settings_source);

  Parameters parameters;
  const Json all = merged(file, overrides);
  for (const auto& [key, value] : all.items()) {
    if (key == kCommentKey) continue;
    const std::string& origin = overrides.contains(key) ? settings_source : source;
    read_parameter(find_info(parameter_table(), key, "", origin), "", value, origin, parameters);
  }
  finish(parameters, source);
  return parameters;
}

Json parameters_to_json(const Parameters& parameters) {
  Json object = to_json_object(parameter_table(), parameters);
  for (const char* key : kScaleKeys)
    if (key != kScaleKeys.front() && is_set(object, key)) object[kScaleKeys.front()] = nullptr;
  return object;
}

}  // namespace cvmesh
