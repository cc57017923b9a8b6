// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/io/inp_writer.h"

#include "cvmesh/io/atomic_file.h"
#include "cvmesh/io/output_tables.h"
#include "cvmesh/io/placed_tets.h"
#include "cvmesh/io/set_names.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <string_view>

namespace cvmesh {
namespace {

/// Characters of a number that CalculiX reads (format f20.0); the rest, with it an exponent, is
/// dropped without a word.
constexpr std::size_t kMaxNumber = 20;
constexpr std::size_t kEntriesPerLine = 16;
/// Abaqus reads lines of 256 characters.
constexpr std::size_t kMaxComment = 200;

// ---- lines -------------------------------------------------------------------------------------

/// One comment line whatever the text holds, cut where it is too long, but not inside a character.
std::string comment(const std::string& text) {
  return cut_between_characters("** " + one_line(text), kMaxComment) + "\n";
}

void append_short_number(std::string& text, double value) {
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

// ---- sections ----------------------------------------------------------------------------------

/// `B_001`, as many digits as the last one needs.
std::string bin_name(std::size_t bin, std::size_t count) {
  const std::string number = std::to_string(bin + 1);
  const std::size_t digits = std::max<std::size_t>(3, std::to_string(count).size());
  return "B_" + std::string(digits - number.size(), '0') + number;
}

void write_header(AtomicFile& file,
                  const LabelVolume& labels,
                  Space space,
                  const std::vector<std::string>& name_of,
                  const std::vector<PatchKey>& patches,
                  const std::vector<std::string>& patch_names,
                  const std::vector<ElasticBin>& bins) {
  file.write(kInpFirstLine);
  file.write("\n");
  file.write(comment(std::string("coordinates: mm, SPACE=") + space_name(space)));
  for (std::size_t id = 1; id < labels.material_count(); ++id)
    file.write(comment("ELSET E_" + name_of[id] + ": label " + std::to_string(labels.label_of[id]) +
                       " \"" + labels.name_of[id] + "\""));
  for (std::size_t row = 0; row < patches.size(); ++row)
    file.write(comment("NSET N_" + patch_names[row] + ", SURFACE S_" + patch_names[row] + ": " +
                       describe_interface(patches[row], labels)));
  for (std::size_t bin = 0; bin < bins.size(); ++bin)
    file.write(comment("ELSET " + bin_name(bin, bins.size()) + ": modulus in MPa " +
                       std::to_string(bins[bin].modulus_mpa)));
}

void write_nodes(AtomicFile& file, const PlacedTets& placed) {
  file.write("*NODE, NSET=NALL\n");
  std::string text;
  for (std::size_t i = 0; i < placed.node_count(); ++i) {
    const Vec3 p = placed.node(i);
    text.clear();
    append_number(text, static_cast<std::int64_t>(i + 1));
    for (int axis = 0; axis < 3; ++axis) {
      text += ", ";
      append_short_number(text, p[axis]);
    }
    text += '\n';
    file.write(text);
  }
}

void write_elements(AtomicFile& file,
                    const PlacedTets& placed,
                    const std::vector<std::string>& name_of) {
  const std::vector<std::vector<std::size_t>> tets_of = placed.tets_by_material(name_of.size());
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
                      const PlacedTets& placed,
                      const InterfaceTable& table,
                      const std::vector<std::string>& patch_names) {
  const std::vector<std::vector<ElementFace>> faces_of = placed.inside_faces_by_row(table);
  std::string text;
  for (std::size_t row = 0; row < faces_of.size(); ++row) {
    file.write("*NSET, NSET=N_" + patch_names[row] + "\n");
    EntryLines nodes(file, kEntriesPerLine);
    for (const std::int32_t node : placed.nodes_of_patch(table.patches[row], faces_of[row]))
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

void write_bins(AtomicFile& file, const std::vector<ElasticBin>& bins) {
  for (std::size_t bin = 0; bin < bins.size(); ++bin) {
    const std::string name = bin_name(bin, bins.size());
    file.write("*ELSET, ELSET=" + name + "\n");
    EntryLines tets(file, kEntriesPerLine);
    for (const std::int32_t tet : bins[bin].tets)
      tets.add(std::to_string(std::int64_t{tet} + 1));
    tets.end();
    std::string card = "*MATERIAL, NAME=M_" + name + "\n*ELASTIC\n";
    append_short_number(card, bins[bin].modulus_mpa);
    card += ", ";
    append_short_number(card, bins[bin].poisson_ratio);
    file.write(card + "\n*SOLID SECTION, ELSET=" + name + ", MATERIAL=M_" + name + "\n");
  }
}

}  // namespace

void write_inp(const std::filesystem::path& path,
               const TetMesh& mesh,
               const LabelVolume& labels,
               const Affine& mm_to_out,
               Space space) {
  const InterfaceTable table = interface_table(mesh.surface);
  const std::vector<std::string> name_of = plain_label_names(labels);
  const std::vector<std::string> patch_names = plain_interface_names(table.patches, name_of);
  const PlacedTets placed{mesh, Placement(mm_to_out)};
  AtomicFile file(path);
  write_header(file, labels, space, name_of, table.patches, patch_names, mesh.bins);
  write_nodes(file, placed);
  write_elements(file, placed, name_of);
  write_interfaces(file, placed, table, patch_names);
  write_bins(file, mesh.bins);
  file.commit();
}

}  // namespace cvmesh
