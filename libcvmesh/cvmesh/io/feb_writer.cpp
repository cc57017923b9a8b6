// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/io/feb_writer.h"

#include "cvmesh/io/atomic_file.h"
#include "cvmesh/io/placed_tets.h"
#include "cvmesh/io/set_names.h"
#include "cvmesh/io/vtk_xml.h"

#include <algorithm>

namespace cvmesh {
namespace {

/// One comment, whatever the text holds: XML has no two hyphens in it.
std::string comment(const std::string& text) {
  std::string inner = detail::escape_xml(one_line(text));
  for (std::size_t at = inner.find("--"); at != std::string::npos; at = inner.find("--"))
    inner.replace(at, 2, "- -");
  return "  <!-- " + inner + " -->\n";
}

/// `<tag id="7">1,2,3</tag>`.
void write_item(AtomicFile& file,
                std::string& text,
                const char* tag,
                std::size_t id,
                const std::string& value) {
  text = "      <";
  text += tag;
  text += " id=\"" + std::to_string(id) + "\">" + value + "</" + tag + ">\n";
  file.write(text);
}

template <typename Nodes>
std::string node_list(const Nodes& nodes) {
  std::string text;
  for (const std::int32_t node : nodes) {
    if (!text.empty()) text += ',';
    append_number(text, std::int64_t{node} + 1);
  }
  return text;
}

void write_head(AtomicFile& file,
                const LabelVolume& labels,
                Space space,
                const std::vector<std::string>& name_of,
                const InterfaceTable& table,
                const std::vector<std::string>& patch_names) {
  std::string text = "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<febio_spec version=\"4.0\">\n" +
                     comment(kFebMark) +
                     comment(std::string("coordinates: mm, SPACE=") + space_name(space));
  for (std::size_t id = 1; id < labels.material_count(); ++id)
    text += comment(name_of[id] + ": label " + std::to_string(labels.label_of[id]) + " '" +
                    labels.name_of[id] + "'");
  for (std::size_t row = 0; row < patch_names.size(); ++row)
    text += comment(patch_names[row] + ": " + describe_interface(table.patches[row], labels));
  text += "  <Module type=\"solid\"/>\n" +
          comment("materials are placeholders: FEBio opens no part without one") + "  <Material>\n";
  for (std::size_t id = 1; id < labels.material_count(); ++id)
    text += "    <material id=\"" + std::to_string(id) + "\" name=\"" + name_of[id] +
            "\" type=\"neo-Hookean\">\n      <density>1</density>\n      <E>1</E>\n"
            "      <v>0.3</v>\n    </material>\n";
  file.write(text + "  </Material>\n");
}

void write_nodes(AtomicFile& file, const PlacedTets& placed) {
  file.write("    <Nodes name=\"ALL_NODES\">\n");
  std::string text, point;
  for (std::size_t node = 0; node < placed.node_count(); ++node) {
    point.clear();
    append_point(point, placed.node(node), ',');
    write_item(file, text, "node", node + 1, point);
  }
  file.write("    </Nodes>\n");
}

void write_parts(AtomicFile& file,
                 const PlacedTets& placed,
                 const std::vector<std::string>& name_of) {
  const auto tets_of = placed.tets_by_material(name_of.size());
  const bool is_second_order = placed.is_second_order();
  std::string text;
  for (std::size_t id = 1; id < tets_of.size(); ++id) {
    if (tets_of[id].empty()) continue;
    file.write(std::string("    <Elements type=\"") + (is_second_order ? "tet10" : "tet4") +
               "\" name=\"" + name_of[id] + "\">\n");
    for (const std::size_t tet : tets_of[id]) {
      std::string nodes = node_list(placed.corners(tet));
      if (is_second_order) nodes += "," + node_list(placed.mid_nodes(tet));
      write_item(file, text, "elem", tet + 1, nodes);
    }
    file.write("    </Elements>\n");
  }
}

void write_interfaces(AtomicFile& file,
                      const PlacedTets& placed,
                      const InterfaceTable& table,
                      const std::vector<std::string>& patch_names) {
  const auto faces_of = placed.inside_faces_by_row(table);
  std::string text;
  for (std::size_t row = 0; row < faces_of.size(); ++row)
    file.write("    <NodeSet name=\"" + patch_names[row] + "\">" +
               node_list(placed.nodes_of_patch(table.patches[row], faces_of[row])) +
               "</NodeSet>\n");
  for (std::size_t row = 0; row < faces_of.size(); ++row) {
    file.write("    <Surface name=\"" + patch_names[row] + "\">\n");
    for (std::size_t i = 0; i < faces_of[row].size(); ++i)
      write_item(file, text, placed.is_second_order() ? "tri6" : "tri3", i + 1,
                 node_list(placed.nodes_of(faces_of[row][i])));
    file.write("    </Surface>\n");
  }
  const auto row_of = [&](const Sides& sides) {
    const auto row = std::lower_bound(table.patches.begin(), table.patches.end(), PatchKey{sides});
    return static_cast<std::size_t>(row - table.patches.begin());
  };
  for (const Contact& contact : placed.mesh.contacts) {
    const std::string& primary = patch_names[row_of(contact.sides)];
    const std::string& secondary =
        patch_names[row_of({contact.sides.outside, contact.sides.inside})];
    file.write("    <SurfacePair name=\"CONTACT_" + primary + "\">\n      <primary>" + primary +
               "</primary>\n      <secondary>" + secondary + "</secondary>\n    </SurfacePair>\n");
  }
}

}  // namespace

void write_feb(const std::filesystem::path& path,
               const TetMesh& mesh,
               const LabelVolume& labels,
               const Affine& mm_to_out,
               Space space) {
  const InterfaceTable table = interface_table(mesh.surface);
  const std::vector<std::string> name_of = plain_label_names(labels);
  const std::vector<std::string> patch_names = plain_interface_names(table.patches, name_of);
  const PlacedTets placed{mesh, Placement(mm_to_out)};
  AtomicFile file(path);
  write_head(file, labels, space, name_of, table, patch_names);
  file.write("  <Mesh>\n");
  write_nodes(file, placed);
  write_parts(file, placed, name_of);
  write_interfaces(file, placed, table, patch_names);
  file.write("  </Mesh>\n  <MeshDomains>\n");
  for (std::size_t id = 1; id < name_of.size(); ++id)
    file.write("    <SolidDomain name=\"" + name_of[id] + "\" mat=\"" + name_of[id] + "\"/>\n");
  file.write("  </MeshDomains>\n</febio_spec>\n");
  file.commit();
}

}  // namespace cvmesh
