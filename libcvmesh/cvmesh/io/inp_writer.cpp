// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/io/inp_writer.h"

#include "cvmesh/core/error.h"
#include "cvmesh/io/atomic_file.h"
#include "cvmesh/io/output_tables.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <map>
#include <string_view>

namespace cvmesh {
namespace {

/// The longest set name: Abaqus and CalculiX allow 80 characters, older readers 64.
constexpr std::size_t kMaxSetName = 64;
/// "N_", two of them, an underscore and "_XMIN" are kMaxSetName.
constexpr std::size_t kMaxLabelName = 28;
/// Characters of a number that CalculiX reads (format f20.0); the rest, with it an exponent, is
/// dropped without a word.
constexpr std::size_t kMaxNumber = 20;
constexpr std::size_t kEntriesPerLine = 16;
/// Abaqus reads lines of 256 characters.
constexpr std::size_t kMaxComment = 200;
constexpr std::array<const char*, 7> kWallSuffixes = {"",      "_XMIN", "_XMAX", "_YMIN",
                                                      "_YMAX", "_ZMIN", "_ZMAX"};

/// A face of a tet as both programs number them: S1 to S4.
struct TetFace {
  std::array<std::size_t, 3> corners;  ///< of the tet
  std::array<std::size_t, 3> edges;    ///< of `TetMesh::mid_of`, between those corners
};

constexpr std::array<TetFace, 4> kFaces = {{{{0, 1, 2}, {0, 1, 2}},
                                            {{0, 3, 1}, {3, 4, 0}},
                                            {{1, 3, 2}, {4, 5, 1}},
                                            {{2, 3, 0}, {5, 3, 2}}}};

// ---- names -------------------------------------------------------------------------------------

std::string legal_name(const std::string& name) {
  std::string legal;
  for (const char c : name) {
    // Not std::toupper: the locale must not decide.
    if (c >= 'a' && c <= 'z')
      legal += static_cast<char>(c - 'a' + 'A');
    else if ((c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9'))
      legal += c;
    else if (!legal.empty() && legal.back() != '_')
      legal += '_';
  }
  legal.resize(std::min(legal.size(), kMaxLabelName));
  while (!legal.empty() && legal.back() == '_')
    legal.pop_back();
  return legal;
}

std::string with_suffix(std::string name, const std::string& suffix, std::size_t max_size) {
  name.resize(std::min(name.size(), max_size - suffix.size()));
  if (name.back() == '_') name.pop_back();
  return name + suffix;
}

/// Gives every name that is not alone its suffix. Suffixes are an underscore and characters that
/// are none, and all different, so names that have theirs are different, and every round gives one
/// to names that had none: it ends. Names with an empty suffix stay as they are.
void make_unique(std::vector<std::string>& names,
                 const std::vector<std::string>& suffixes,
                 std::size_t max_size) {
  for (bool is_unique = false; !is_unique;) {
    is_unique = true;
    std::map<std::string, int> uses;
    for (const std::string& name : names)
      ++uses[name];
    for (std::size_t i = 0; i < names.size(); ++i) {
      if (uses[names[i]] == 1 || suffixes[i].empty()) continue;
      names[i] = with_suffix(names[i], suffixes[i], max_size);
      is_unique = false;
    }
  }
}

std::string suffix_of(Label label) {
  std::string text = "_" + std::to_string(label);
  std::replace(text.begin(), text.end(), '-', 'M');
  return text;
}

/// What follows N_ and S_ in the names of an interface's sets, per row of the table.
std::vector<std::string> interface_names(const std::vector<PatchKey>& patches,
                                         const std::vector<std::string>& name_of) {
  std::vector<std::string> names, suffixes;
  for (const PatchKey& patch : patches) {
    names.push_back(name_of[patch.sides.inside] + "_" + name_of[patch.sides.outside] +
                    kWallSuffixes.at(patch.wall));
    suffixes.push_back("_" + std::to_string(names.size()));
  }
  make_unique(names, suffixes, kMaxSetName - 2);
  return names;
}

// ---- lines -------------------------------------------------------------------------------------

/// One comment line whatever the text holds, cut where it is too long, but not inside a character.
std::string comment(const std::string& text) {
  std::string line = "** " + one_line(text);
  if (line.size() > kMaxComment) {
    std::size_t end = kMaxComment;
    while ((static_cast<unsigned char>(line[end]) & 0xC0U) == 0x80U)
      --end;
    line.resize(end);
  }
  return line + "\n";
}

void append_coordinate(std::string& text, double value) {
  std::array<char, 32> digits{};
  char* const end = digits.data() + digits.size();
  auto result = std::to_chars(digits.data(), end, value);
  for (int precision = 17; result.ptr - digits.data() > static_cast<int>(kMaxNumber); --precision)
    result = std::to_chars(digits.data(), end, value, std::chars_format::general, precision);
  text.append(digits.data(), result.ptr);
}

/// The entries of a set, some on each line.
class EntryLines {
 public:
  EntryLines(AtomicFile& file, std::size_t per_line) : file_(file), per_line_(per_line) {}

  void add(std::string_view entry) {
    if (count_ > 0) file_.write(count_ % per_line_ == 0 ? "\n" : ", ");
    file_.write(entry);
    ++count_;
  }

  void end() { file_.write("\n"); }

 private:
  AtomicFile& file_;
  std::size_t per_line_;
  std::size_t count_ = 0;
};

// ---- the mesh as the file has it ---------------------------------------------------------------

/// One face of an element, 0-based.
struct ElementFace {
  std::int32_t tet = -1;
  std::size_t face = 0;
};

struct InpMesh {
  const TetMesh& mesh;
  Placement place;

  [[nodiscard]] bool is_second_order() const { return !mesh.mid_of.empty(); }

  [[nodiscard]] std::array<std::int32_t, 4> corners(std::size_t tet) const {
    return place(mesh.tets[tet]);
  }

  /// Of a mesh of second order: the nodes on the edges, which come after all others.
  [[nodiscard]] std::array<std::int32_t, 6> mid_nodes(std::size_t tet) const {
    std::array<std::int32_t, 6> nodes = place(mesh.mid_of[tet]);
    for (std::int32_t& node : nodes)
      node += static_cast<std::int32_t>(mesh.points.size());
    return nodes;
  }

  /// Per facet of the surface, the face on its inside.
  [[nodiscard]] std::vector<ElementFace> inside_faces() const;

  /// Nodes on the faces, ascending.
  [[nodiscard]] std::vector<std::int32_t> nodes_of(const std::vector<ElementFace>& faces) const;
};

std::vector<ElementFace> InpMesh::inside_faces() const {
  using Key = std::array<std::int32_t, 3>;
  const InterfaceMesh& surface = mesh.surface;
  std::vector<std::pair<Key, std::size_t>> facets;
  facets.reserve(surface.facets.size());
  for (std::size_t i = 0; i < surface.facets.size(); ++i) {
    facets.emplace_back(surface.facets[i], i);
    std::sort(facets.back().first.begin(), facets.back().first.end());
  }
  std::sort(facets.begin(), facets.end());

  std::vector<ElementFace> faces(surface.facets.size());
  for (std::size_t tet = 0; tet < mesh.tets.size(); ++tet) {
    const std::array<std::int32_t, 4> nodes = corners(tet);
    for (std::size_t face = 0; face < kFaces.size(); ++face) {
      const auto& [a, b, c] = kFaces[face].corners;
      Key key = {nodes[a], nodes[b], nodes[c]};
      std::sort(key.begin(), key.end());
      // The surface's points come first: most faces have another one.
      if (key[2] >= static_cast<std::int32_t>(surface.points.size())) continue;
      const auto facet =
          std::lower_bound(facets.begin(), facets.end(), std::pair(key, std::size_t{0}));
      if (facet == facets.end() || facet->first != key) continue;
      if (surface.patch_of[facet->second].sides.inside == mesh.material_of[tet])
        faces[facet->second] = {static_cast<std::int32_t>(tet), face};
    }
  }
  for (const ElementFace& face : faces)
    require(face.tet >= 0, ErrorCode::Internal, "write", "a facet has no tet on its inside");
  return faces;
}

std::vector<std::int32_t> InpMesh::nodes_of(const std::vector<ElementFace>& faces) const {
  std::vector<std::int32_t> nodes;
  for (const ElementFace& element : faces) {
    const auto tet = static_cast<std::size_t>(element.tet);
    for (const std::size_t corner : kFaces[element.face].corners)
      nodes.push_back(corners(tet)[corner]);
    if (!is_second_order()) continue;
    for (const std::size_t edge : kFaces[element.face].edges)
      nodes.push_back(mid_nodes(tet)[edge]);
  }
  std::sort(nodes.begin(), nodes.end());
  nodes.erase(std::unique(nodes.begin(), nodes.end()), nodes.end());
  return nodes;
}

// ---- sections ----------------------------------------------------------------------------------

void write_header(AtomicFile& file,
                  const LabelVolume& labels,
                  Space space,
                  const std::vector<std::string>& name_of,
                  const std::vector<PatchKey>& patches,
                  const std::vector<std::string>& patch_names) {
  file.write(kInpFirstLine);
  file.write("\n");
  file.write(comment(std::string("coordinates: mm, SPACE=") + space_name(space)));
  for (std::size_t id = 1; id < labels.material_count(); ++id)
    file.write(comment("ELSET E_" + name_of[id] + ": label " + std::to_string(labels.label_of[id]) +
                       " \"" + labels.name_of[id] + "\""));
  for (std::size_t row = 0; row < patches.size(); ++row)
    file.write(comment("NSET N_" + patch_names[row] + ", SURFACE S_" + patch_names[row] + ": " +
                       describe_interface(patches[row], labels)));
}

void write_nodes(AtomicFile& file, const InpMesh& placed) {
  file.write("*NODE, NSET=NALL\n");
  std::int64_t number = 0;
  std::string text;
  for (const std::vector<Vec3>* points : {&placed.mesh.points, &placed.mesh.mid_points})
    for (const Vec3& point : *points) {
      const Vec3 p = placed.place(point);
      text.clear();
      append_number(text, ++number);
      for (int axis = 0; axis < 3; ++axis) {
        text += ", ";
        append_coordinate(text, p[axis]);
      }
      text += '\n';
      file.write(text);
    }
}

void write_elements(AtomicFile& file,
                    const InpMesh& placed,
                    const std::vector<std::string>& name_of) {
  const TetMesh& mesh = placed.mesh;
  std::vector<std::vector<std::size_t>> tets_of(name_of.size());
  for (std::size_t tet = 0; tet < mesh.tets.size(); ++tet)
    tets_of[mesh.material_of[tet]].push_back(tet);
  const std::string type = placed.is_second_order() ? "C3D10" : "C3D4";
  std::string text;
  const auto append_nodes = [&](const auto& nodes) {
    for (const std::int32_t node : nodes) {
      text += ", ";
      append_number(text, std::int64_t{node} + 1);
    }
  };
  for (std::size_t id = 1; id < tets_of.size(); ++id) {
    if (tets_of[id].empty()) continue;
    file.write("*ELEMENT, TYPE=" + type + ", ELSET=E_" + name_of[id] + "\n");
    for (const std::size_t tet : tets_of[id]) {
      text.clear();
      append_number(text, static_cast<std::int64_t>(tet + 1));
      append_nodes(placed.corners(tet));
      if (placed.is_second_order()) append_nodes(placed.mid_nodes(tet));
      text += '\n';
      file.write(text);
    }
  }
}

void write_interfaces(AtomicFile& file,
                      const InpMesh& placed,
                      const InterfaceTable& table,
                      const std::vector<std::string>& patch_names) {
  const std::vector<ElementFace> all = placed.inside_faces();
  std::vector<std::vector<ElementFace>> faces_of(table.patches.size());
  for (std::size_t i = 0; i < all.size(); ++i)
    faces_of[static_cast<std::size_t>(table.index_of[i] - 1)].push_back(all[i]);
  std::string text;
  for (std::size_t row = 0; row < faces_of.size(); ++row) {
    file.write("*NSET, NSET=N_" + patch_names[row] + "\n");
    EntryLines nodes(file, kEntriesPerLine);
    for (const std::int32_t node : placed.nodes_of(faces_of[row]))
      nodes.add(std::to_string(std::int64_t{node} + 1));
    nodes.end();
    file.write("*SURFACE, NAME=S_" + patch_names[row] + ", TYPE=ELEMENT\n");
    for (const ElementFace& element : faces_of[row]) {
      text.clear();
      append_number(text, std::int64_t{element.tet} + 1);
      text += ", S";
      append_number(text, static_cast<std::int64_t>(element.face + 1));
      text += '\n';
      file.write(text);
    }
  }
}

}  // namespace

std::vector<std::string> inp_set_names(const LabelVolume& labels) {
  std::vector<std::string> names, suffixes;
  for (std::size_t id = 0; id < labels.material_count(); ++id) {
    const bool is_exterior = id == kExterior;
    suffixes.push_back(is_exterior ? "" : suffix_of(labels.label_of[id]));
    names.push_back(is_exterior ? "EXTERIOR" : legal_name(labels.name_of[id]));
    if (names.back().empty()) names.back() = "LABEL" + suffixes.back();
  }
  make_unique(names, suffixes, kMaxLabelName);
  return names;
}

void write_inp(const std::filesystem::path& path,
               const TetMesh& mesh,
               const LabelVolume& labels,
               const Affine& mm_to_out,
               Space space) {
  const InterfaceTable table = interface_table(mesh.surface);
  const std::vector<std::string> name_of = inp_set_names(labels);
  const std::vector<std::string> patch_names = interface_names(table.patches, name_of);
  const InpMesh placed{mesh, Placement(mm_to_out)};
  AtomicFile file(path);
  write_header(file, labels, space, name_of, table.patches, patch_names);
  write_nodes(file, placed);
  write_elements(file, placed, name_of);
  write_interfaces(file, placed, table, patch_names);
  file.commit();
}

}  // namespace cvmesh
