// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/io/msh_writer.h"

#include "cvmesh/core/box3.h"
#include "cvmesh/io/atomic_file.h"
#include "cvmesh/io/placed_tets.h"
#include "cvmesh/io/set_names.h"

#include <algorithm>
#include <map>

namespace cvmesh {
namespace {

/// Element types of Gmsh, by order.
constexpr std::array<int, 2> kTriangle = {2, 9}, kTetrahedron = {4, 11};

/// Everything the sections of one file share.
struct MshMesh {
  PlacedTets placed;
  const LabelVolume& labels;
  InterfaceTable table;
  std::vector<std::vector<ElementFace>> faces_of;  ///< per row of the table
  std::vector<std::vector<std::size_t>> tets_of;   ///< per material
  std::vector<std::int64_t> tag_of;                ///< per material: of its physical volume

  [[nodiscard]] int type(const std::array<int, 2>& types) const {
    return types[placed.is_second_order() ? 1 : 0];
  }

  /// Tag of the physical surface of a row. Some readers put equal tags of volumes and surfaces
  /// together, so these follow the tags of the volumes.
  [[nodiscard]] std::int64_t surface_tag(std::size_t row) const {
    return *std::max_element(tag_of.begin(), tag_of.end()) + static_cast<std::int64_t>(row + 1);
  }

  /// Triangles come first: a tet's number follows theirs.
  [[nodiscard]] std::size_t number_of_tet(std::size_t tet) const {
    return placed.mesh.surface.facets.size() + tet + 1;
  }
};

std::vector<std::int64_t> volume_tags(const LabelVolume& labels) {
  std::vector<std::int64_t> tags(labels.label_of.begin(), labels.label_of.end());
  std::int64_t next = std::max<std::int64_t>(0, *std::max_element(tags.begin(), tags.end()));
  for (std::size_t id = 1; id < tags.size(); ++id)
    if (tags[id] <= 0) tags[id] = ++next;
  return tags;
}

MshMesh arrange(const TetMesh& mesh, const LabelVolume& labels, const Affine& mm_to_out) {
  const PlacedTets placed{mesh, Placement(mm_to_out)};
  InterfaceTable table = interface_table(mesh.surface);
  auto faces_of = placed.inside_faces_by_row(table);
  return {placed,
          labels,
          std::move(table),
          std::move(faces_of),
          placed.tets_by_material(labels.material_count()),
          volume_tags(labels)};
}

void append_nodes(std::string& text, const std::vector<std::int32_t>& nodes) {
  for (const std::int32_t node : nodes) {
    text += ' ';
    append_number(text, std::int64_t{node} + 1);
  }
}

std::vector<std::int32_t> nodes_of_tet(const PlacedTets& placed, std::size_t tet) {
  const auto corners = placed.corners(tet);
  std::vector<std::int32_t> nodes(corners.begin(), corners.end());
  if (!placed.is_second_order()) return nodes;
  const auto mids = placed.mid_nodes(tet);
  nodes.insert(nodes.end(), mids.begin(), mids.end());
  std::swap(nodes[8], nodes[9]);  // Gmsh: edge 23 before edge 13
  return nodes;
}

// ---- sections of both versions -----------------------------------------------------------------

void write_head(AtomicFile& file, const MshMesh& msh, const char* version, Space space) {
  std::string text = std::string("$MeshFormat\n") + version + " 0 8\n$EndMeshFormat\n$Comments\n" +
                     kMshMark + "\ncoordinates: mm, SPACE=" + space_name(space) + "\n";
  const std::vector<std::string> names = quotable_label_names(msh.labels);
  const std::vector<std::string> interfaces = quotable_interface_names(msh.table.patches, names);
  for (std::size_t id = 1; id < names.size(); ++id)
    text += "physical volume " + std::to_string(msh.tag_of[id]) + ": label " +
            std::to_string(msh.labels.label_of[id]) + " \"" + names[id] + "\"\n";
  for (std::size_t row = 0; row < interfaces.size(); ++row)
    text += "physical surface " + std::to_string(msh.surface_tag(row)) + ": " +
            describe_interface(msh.table.patches[row], msh.labels) + "\n";
  text += "$EndComments\n$PhysicalNames\n" + std::to_string(interfaces.size() + names.size() - 1) +
          "\n";
  for (std::size_t row = 0; row < interfaces.size(); ++row)
    text += "2 " + std::to_string(msh.surface_tag(row)) + " \"" + interfaces[row] + "\"\n";
  for (std::size_t id = 1; id < names.size(); ++id)
    text += "3 " + std::to_string(msh.tag_of[id]) + " \"" + names[id] + "\"\n";
  file.write(text + "$EndPhysicalNames\n");
}

/// One number per node or element; `section` is NodeData or ElementData.
template <typename NumberOf, typename ValueOf>
void write_data(AtomicFile& file,
                const std::string& section,
                const std::string& name,
                std::size_t count,
                const NumberOf& number_of,
                const ValueOf& value_of) {
  file.write("$" + section + "\n1\n\"" + name + "\"\n1\n0\n3\n0\n1\n" + std::to_string(count) +
             "\n");
  std::string text;
  for (std::size_t i = 0; i < count; ++i) {
    text.clear();
    append_number(text, static_cast<std::int64_t>(number_of(i)));
    text += ' ';
    append_number(text, value_of(i));
    text += '\n';
    file.write(text);
  }
  file.write("$End" + section + "\n");
}

void write_arrays(AtomicFile& file, const MshMesh& msh) {
  const TetMesh& mesh = msh.placed.mesh;
  if (!mesh.original_of.empty())
    write_data(
        file, "NodeData", "original_point", mesh.original_of.size(),
        [](std::size_t i) { return i + 1; },
        [&](std::size_t i) { return std::int64_t{mesh.original_of[i]} + 1; });
  for (const TetArray& array : mesh.arrays)
    write_data(
        file, "ElementData", array.name, array.values.size(),
        [&](std::size_t i) { return msh.number_of_tet(i); },
        [&](std::size_t i) { return array.values[i]; });
}

// ---- version 4.1 -------------------------------------------------------------------------------

/// A surface (tag: row of the interface table) or a volume (tag: material id) of the model.
struct Entity {
  int dimension = 3;
  std::size_t tag = 0;
  friend auto operator<=>(const Entity&, const Entity&) = default;
};

/// Each node belongs to one entity: the first interface that it lies on, else its material.
std::vector<Entity> entities_of_nodes(const MshMesh& msh) {
  std::vector<Entity> entity_of(msh.placed.node_count());
  for (std::size_t row = 0; row < msh.faces_of.size(); ++row)
    for (const ElementFace& face : msh.faces_of[row])
      for (const std::int32_t node : msh.placed.nodes_of(face)) {
        Entity& entity = entity_of[static_cast<std::size_t>(node)];
        if (entity.tag == 0) entity = {2, row + 1};
      }
  for (std::size_t id = 1; id < msh.tets_of.size(); ++id)
    for (const std::size_t tet : msh.tets_of[id])
      for (const std::int32_t node : nodes_of_tet(msh.placed, tet)) {
        Entity& entity = entity_of[static_cast<std::size_t>(node)];
        if (entity.tag == 0) entity = {3, id};
      }
  return entity_of;
}

void append_box(std::string& text, const Box3& box) {
  text += ' ';
  append_point(text, box.lo, ' ');
  text += ' ';
  append_point(text, box.hi, ' ');
}

void write_entities(AtomicFile& file, const MshMesh& msh) {
  std::vector<Box3> surfaces(msh.faces_of.size()), volumes(msh.tets_of.size());
  const auto extend = [&](Box3& box, const std::vector<std::int32_t>& nodes) {
    for (const std::int32_t node : nodes)
      box.add(msh.placed.node(static_cast<std::size_t>(node)));
  };
  for (std::size_t row = 0; row < surfaces.size(); ++row)
    for (const ElementFace& face : msh.faces_of[row])
      extend(surfaces[row], msh.placed.nodes_of(face));
  std::string text;
  std::size_t count = 0;
  for (std::size_t id = 1; id < volumes.size(); ++id) {
    if (msh.tets_of[id].empty()) continue;
    ++count;
    for (const std::size_t tet : msh.tets_of[id])
      extend(volumes[id], nodes_of_tet(msh.placed, tet));
    append_number(text, static_cast<std::int64_t>(id));
    append_box(text, volumes[id]);
    text += " 1 ";
    append_number(text, msh.tag_of[id]);
    // Surfaces around it; the sign tells the side.
    std::vector<std::string> around;
    for (std::size_t row = 0; row < msh.table.patches.size(); ++row) {
      const Sides& sides = msh.table.patches[row].sides;
      if (sides.inside == id) around.push_back(std::to_string(row + 1));
      if (sides.outside == id) around.push_back("-" + std::to_string(row + 1));
    }
    text += ' ' + std::to_string(around.size());
    for (const std::string& tag : around)
      text += ' ' + tag;
    text += '\n';
  }
  std::string head =
      "$Entities\n0 0 " + std::to_string(surfaces.size()) + " " + std::to_string(count) + "\n";
  for (std::size_t row = 0; row < surfaces.size(); ++row) {
    head += std::to_string(row + 1);
    append_box(head, surfaces[row]);
    head += " 1 " + std::to_string(msh.surface_tag(row)) + " 0\n";
  }
  file.write(head + text + "$EndEntities\n");
}

void write_nodes(AtomicFile& file, const MshMesh& msh) {
  std::map<Entity, std::vector<std::size_t>> blocks;
  const std::vector<Entity> entity_of = entities_of_nodes(msh);
  for (std::size_t node = 0; node < entity_of.size(); ++node)
    blocks[entity_of[node]].push_back(node);
  const std::string count = std::to_string(entity_of.size());
  file.write("$Nodes\n" + std::to_string(blocks.size()) + " " + count + " 1 " + count + "\n");
  std::string text;
  for (const auto& [entity, nodes] : blocks) {
    file.write(std::to_string(entity.dimension) + " " + std::to_string(entity.tag) + " 0 " +
               std::to_string(nodes.size()) + "\n");
    for (const std::size_t node : nodes)
      file.write(std::to_string(node + 1) + "\n");
    for (const std::size_t node : nodes) {
      text.clear();
      append_point(text, msh.placed.node(node), ' ');
      text += '\n';
      file.write(text);
    }
  }
  file.write("$EndNodes\n");
}

void write_elements(AtomicFile& file, const MshMesh& msh) {
  const auto is_used = [](const auto& elements) { return !elements.empty(); };
  const auto volumes = std::count_if(msh.tets_of.begin(), msh.tets_of.end(), is_used);
  const std::string count = std::to_string(msh.number_of_tet(msh.placed.mesh.tets.size()) - 1);
  file.write("$Elements\n" +
             std::to_string(msh.faces_of.size() + static_cast<std::size_t>(volumes)) + " " + count +
             " 1 " + count + "\n");
  std::string text;
  std::int64_t number = 0;
  const auto write_element = [&](std::int64_t tag, const std::vector<std::int32_t>& nodes) {
    text.clear();
    append_number(text, tag);
    append_nodes(text, nodes);
    text += '\n';
    file.write(text);
  };
  for (std::size_t row = 0; row < msh.faces_of.size(); ++row) {
    file.write("2 " + std::to_string(row + 1) + " " + std::to_string(msh.type(kTriangle)) + " " +
               std::to_string(msh.faces_of[row].size()) + "\n");
    for (const ElementFace& face : msh.faces_of[row])
      write_element(++number, msh.placed.nodes_of(face));
  }
  for (std::size_t id = 1; id < msh.tets_of.size(); ++id) {
    if (msh.tets_of[id].empty()) continue;
    file.write("3 " + std::to_string(id) + " " + std::to_string(msh.type(kTetrahedron)) + " " +
               std::to_string(msh.tets_of[id].size()) + "\n");
    for (const std::size_t tet : msh.tets_of[id])
      write_element(static_cast<std::int64_t>(msh.number_of_tet(tet)),
                    nodes_of_tet(msh.placed, tet));
  }
  file.write("$EndElements\n");
}

// ---- version 2.2 -------------------------------------------------------------------------------

void write_nodes_22(AtomicFile& file, const MshMesh& msh) {
  file.write("$Nodes\n" + std::to_string(msh.placed.node_count()) + "\n");
  std::string text;
  for (std::size_t node = 0; node < msh.placed.node_count(); ++node) {
    text.clear();
    append_number(text, static_cast<std::int64_t>(node + 1));
    text += ' ';
    append_point(text, msh.placed.node(node), ' ');
    text += '\n';
    file.write(text);
  }
  file.write("$EndNodes\n");
}

void write_elements_22(AtomicFile& file, const MshMesh& msh) {
  const TetMesh& mesh = msh.placed.mesh;
  file.write("$Elements\n" + std::to_string(msh.number_of_tet(mesh.tets.size()) - 1) + "\n");
  std::string text;
  std::int64_t number = 0;
  const auto write_element = [&](int type, std::int64_t physical, std::int64_t entity,
                                 const std::vector<std::int32_t>& nodes) {
    text.clear();
    append_number(text, ++number);
    for (const std::int64_t word : {std::int64_t{type}, std::int64_t{2}, physical, entity}) {
      text += ' ';
      append_number(text, word);
    }
    append_nodes(text, nodes);
    text += '\n';
    file.write(text);
  };
  for (std::size_t row = 0; row < msh.faces_of.size(); ++row) {
    const auto tag = static_cast<std::int64_t>(row + 1);
    for (const ElementFace& face : msh.faces_of[row])
      write_element(msh.type(kTriangle), msh.surface_tag(row), tag, msh.placed.nodes_of(face));
  }
  for (std::size_t tet = 0; tet < mesh.tets.size(); ++tet) {
    const MaterialId id = mesh.material_of[tet];
    write_element(msh.type(kTetrahedron), msh.tag_of[id], id, nodes_of_tet(msh.placed, tet));
  }
  file.write("$EndElements\n");
}

}  // namespace

void write_msh(const std::filesystem::path& path,
               const TetMesh& mesh,
               const LabelVolume& labels,
               const Affine& mm_to_out,
               Space space) {
  const MshMesh msh = arrange(mesh, labels, mm_to_out);
  AtomicFile file(path);
  write_head(file, msh, "4.1", space);
  write_entities(file, msh);
  write_nodes(file, msh);
  write_elements(file, msh);
  write_arrays(file, msh);
  file.commit();
}

void write_msh22(const std::filesystem::path& path,
                 const TetMesh& mesh,
                 const LabelVolume& labels,
                 const Affine& mm_to_out,
                 Space space) {
  const MshMesh msh = arrange(mesh, labels, mm_to_out);
  AtomicFile file(path);
  write_head(file, msh, "2.2", space);
  write_nodes_22(file, msh);
  write_elements_22(file, msh);
  write_arrays(file, msh);
  file.commit();
}

}  // namespace cvmesh
