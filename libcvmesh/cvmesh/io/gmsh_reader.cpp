// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/io/byte_source.h"
#include "cvmesh/io/tet_reader.h"
#include "cvmesh/io/text_scanner.h"

#include <algorithm>
#include <limits>
#include <map>
#include <unordered_map>

namespace cvmesh::detail {
namespace {

constexpr std::int64_t kMostInt = std::numeric_limits<std::int32_t>::max();
constexpr int kTet = 4, kTet10 = 11;

/// Nodes of the element types that Gmsh knows by number.
std::size_t nodes_of(TextScanner& scanner, std::int64_t type) {
  static const std::map<std::int64_t, std::size_t> nodes = {
      {1, 2},   {2, 3},   {3, 4},   {4, 4},   {5, 8},   {6, 6},   {7, 5},   {8, 3},
      {9, 6},   {10, 9},  {11, 10}, {12, 27}, {13, 18}, {14, 14}, {15, 1},  {16, 8},
      {17, 20}, {18, 15}, {19, 13}, {20, 9},  {21, 10}, {22, 12}, {23, 15}, {24, 15},
      {25, 21}, {26, 4},  {27, 5},  {28, 6},  {29, 20}, {30, 35}, {31, 56}};
  const auto found = nodes.find(type);
  if (found == nodes.end())
    scanner.refuse("the element type " + std::to_string(type) + " is not known");
  return found->second;
}

class GmshFile {
 public:
  GmshFile(const std::filesystem::path& path, const std::string& content)
      : path_(path), scanner_(path, content) {}

  TetFile read() {
    read_format();
    for (std::string_view section = scanner_.word(); !section.empty(); section = scanner_.word()) {
      if (section == "$Nodes")
        is_4_ ? read_nodes_4() : read_nodes_2();
      else if (section == "$Elements")
        is_4_ ? read_elements_4() : read_elements_2();
      else if (section == "$Entities" && is_4_)
        read_entities();
      else
        skip_section(section);
    }
    file_.label_source = has_physical_ ? "gmsh:physical" : "gmsh:geometrical";
    return std::move(file_);
  }

 private:
  void read_format() {
    if (scanner_.word() != "$MeshFormat") scanner_.refuse("a Gmsh file starts with $MeshFormat");
    const std::string version(scanner_.word());
    if (version != "2.2" && version != "4.1")
      scanner_.refuse("the format version '" + version.substr(0, 20) +
                      "' is not supported; save as 2.2 or 4.1");
    is_4_ = version == "4.1";
    if (scanner_.integer("the file type") != 0)
      scanner_.refuse("binary Gmsh files are not supported; save as text (Mesh.Binary = 0)");
    scanner_.integer("the data size");
    expect("$EndMeshFormat");
  }

  void expect(const std::string& word) {
    if (scanner_.word() != word) scanner_.refuse("expected " + word);
  }

  // To the end of a section that has nothing for us; its text may hold anything.
  void skip_section(std::string_view section) {
    if (section.substr(0, 1) != "$")
      scanner_.refuse("expected a section ($...), found '" + std::string(section.substr(0, 40)) +
                      "'");
    const std::string end = "$End" + std::string(section.substr(1));
    for (std::string_view word = scanner_.word(); word != end; word = scanner_.word())
      if (word.empty()) scanner_.refuse("the section " + std::string(section) + " does not end");
  }

  void add_node(std::int64_t tag, const Vec3& p) {
    if (!index_of_.emplace(tag, static_cast<std::int32_t>(file_.points.size())).second)
      scanner_.refuse("the node " + std::to_string(tag) + " comes twice");
    file_.points.push_back(p);
  }

  Vec3 read_point() {
    const double x = scanner_.real("x"), y = scanner_.real("y"), z = scanner_.real("z");
    return {x, y, z};
  }

  void read_nodes_2() {
    const std::size_t count = scanner_.count("the number of nodes", 8);  // "1 0 0 0\n"
    for (std::size_t i = 0; i < count; ++i) {
      const std::int64_t tag = scanner_.integer("the number of a node");
      add_node(tag, read_point());
    }
    expect("$EndNodes");
  }

  void read_nodes_4() {
    const std::size_t blocks = scanner_.count("the number of node blocks", 8);
    for (int i = 0; i < 3; ++i)
      scanner_.integer("the numbers of nodes");
    for (std::size_t b = 0; b < blocks; ++b) {
      scanner_.integer("the dimension of an entity");
      scanner_.integer("the number of an entity");
      if (scanner_.integer("parametric", 0, 1) != 0)
        scanner_.refuse("nodes with parametric coordinates are not supported");
      const std::size_t count = scanner_.count("the number of nodes", 8);
      std::vector<std::int64_t> tags(count);
      for (std::int64_t& tag : tags)
        tag = scanner_.integer("the number of a node");
      for (const std::int64_t tag : tags)
        add_node(tag, read_point());
    }
    expect("$EndNodes");
  }

  // Physical groups of the volumes.
  void read_entities() {
    std::array<std::size_t, 4> count;
    for (std::size_t& c : count)
      c = scanner_.count("the number of entities", 8);
    for (std::size_t dim = 0; dim < 4; ++dim) {
      for (std::size_t e = 0; e < count[dim]; ++e) {
        const std::int64_t tag = scanner_.integer("the number of an entity");
        for (int i = 0; i < (dim == 0 ? 3 : 6); ++i)
          scanner_.real("the box of an entity");
        const std::size_t groups = scanner_.count("the number of physical groups", 2);
        for (std::size_t g = 0; g < groups; ++g) {
          const std::int64_t group = scanner_.integer("a physical group");
          if (dim == 3 && g == 0) physical_of_[tag] = group;
        }
        if (dim == 0) continue;
        const std::size_t bounding = scanner_.count("the number of bounding entities", 2);
        for (std::size_t i = 0; i < bounding; ++i)
          scanner_.integer("a bounding entity");
      }
    }
    expect("$EndEntities");
  }

  void read_element(std::int64_t type, std::int64_t label) {
    const std::size_t nodes = nodes_of(scanner_, type);
    std::array<std::int32_t, 4> tet{};
    for (std::size_t k = 0; k < nodes; ++k) {
      const std::int64_t tag = scanner_.integer("the node of an element");
      if (k >= 4 || (type != kTet && type != kTet10)) continue;
      const auto found = index_of_.find(tag);
      if (found == index_of_.end())
        scanner_.refuse("the node " + std::to_string(tag) +
                        " of an element is not among the nodes");
      tet[k] = found->second;
    }
    if (type != kTet && type != kTet10) {
      ++file_.other_elements;
      return;
    }
    if (label < std::numeric_limits<Label>::min() || label > kMostInt)
      scanner_.refuse("the label " + std::to_string(label) + " of an element is out of range");
    file_.tets.push_back(tet);
    file_.label_of.push_back(static_cast<Label>(label));
  }

  void read_elements_2() {
    const std::size_t count = scanner_.count("the number of elements", 6);  // "1 15 0 1\n"
    for (std::size_t i = 0; i < count; ++i) {
      scanner_.integer("the number of an element");
      const std::int64_t type = scanner_.integer("the type of an element");
      const std::size_t tags = scanner_.count("the number of tags", 2);
      std::int64_t physical = 0, entity = 0;
      for (std::size_t t = 0; t < tags; ++t) {
        const std::int64_t tag = scanner_.integer("a tag");
        if (t == 0) physical = tag;
        if (t == 1) entity = tag;
      }
      has_physical_ = has_physical_ || physical != 0;
      read_element(type, physical != 0 ? physical : entity);
    }
    expect("$EndElements");
  }

  void read_elements_4() {
    const std::size_t blocks = scanner_.count("the number of element blocks", 8);
    for (int i = 0; i < 3; ++i)
      scanner_.integer("the numbers of elements");
    for (std::size_t b = 0; b < blocks; ++b) {
      const std::int64_t dimension = scanner_.integer("the dimension of an entity", 0, 3);
      const std::int64_t entity = scanner_.integer("the number of an entity");
      const std::int64_t type = scanner_.integer("the type of an element");
      const std::size_t count = scanner_.count("the number of elements", 4);
      const auto group = dimension == 3 ? physical_of_.find(entity) : physical_of_.end();
      has_physical_ = has_physical_ || group != physical_of_.end();
      for (std::size_t i = 0; i < count; ++i) {
        scanner_.integer("the number of an element");
        read_element(type, group != physical_of_.end() ? group->second : entity);
      }
    }
    expect("$EndElements");
  }

  const std::filesystem::path& path_;
  TextScanner scanner_;
  TetFile file_;
  bool is_4_ = false, has_physical_ = false;
  std::unordered_map<std::int64_t, std::int32_t> index_of_;  // node number -> index
  std::map<std::int64_t, std::int64_t> physical_of_;         // volume -> its first physical group
};

}  // namespace

TetFile read_gmsh(const std::filesystem::path& path, const std::string& content) {
  return GmshFile(path, content).read();
}

}  // namespace cvmesh::detail
