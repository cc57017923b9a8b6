// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/io/byte_source.h"
#include "cvmesh/io/tet_reader.h"
#include "cvmesh/io/text_scanner.h"

#include <algorithm>
#include <array>
#include <cstring>
#include <limits>
#include <map>
#include <unordered_map>

namespace cvmesh::detail {
namespace {

constexpr std::int64_t kMostInt = std::numeric_limits<std::int32_t>::max();
constexpr int kTet = 4, kTet10 = 11;
// What binary files of 4.1 take for a size_t, and all for a double.
constexpr std::int64_t kWordBytes = 8;

/// The words and numbers of a Gmsh file. In text all numbers are alike; in binary (little endian)
/// each kind has its width, data begin behind the line break after the section's name, and words
/// stand between sections only.
class GmshScanner {
 public:
  GmshScanner(const std::filesystem::path& path, std::string_view content)
      : path_(path), content_(content), text_(path, content) {}

  [[nodiscard]] bool is_binary() const { return is_binary_; }

  std::string_view word() {
    in_data_ = false;
    return text_.word();
  }

  void expect(const std::string& word) {
    if (this->word() != word) refuse("expected " + word);
  }

  /// The rest of the section $MeshFormat, from the file type on.
  void read_storage() {
    is_binary_ = text_.integer("the file type", 0, 1) == 1;
    const std::int64_t word_bytes = text_.integer("the data size");
    if (is_binary_) {
      if (word_bytes != kWordBytes)
        refuse("the data size " + std::to_string(word_bytes) + " is not supported; save with 8");
      begin_data();
      if (integer("the byte order") != 1)
        refuse("is stored in big endian; save it on a machine of little endian, or as text");
    }
    expect("$EndMeshFormat");
  }

  /// From here on numbers are binary, where the file is.
  void begin_data() {
    if (!is_binary_) return;
    const std::size_t at = text_.position();
    if (at >= content_.size() || content_[at] != '\n')
      refuse("expected a line break before binary data");
    text_.seek(at + 1);
    in_data_ = true;
  }

  std::int64_t integer(const char* what) {
    return in_data_ ? take<std::int32_t>(what) : text_.integer(what);
  }

  std::int64_t integer(const char* what, std::int64_t least, std::int64_t most) {
    return in_range(what, integer(what), least, most);
  }

  /// An integer that the format calls a size_t.
  std::int64_t size(const char* what) {
    return in_data_ ? take<std::int64_t>(what) : text_.integer(what);
  }

  double real(const char* what) { return in_data_ ? take<double>(what) : text_.real(what); }

  /// A number of things that take `least_bytes` or more each, in text as in binary, so that they
  /// may be allocated; as a size_t and as an int.
  std::size_t count(const char* what, std::size_t least_bytes) {
    if (!in_data_) return text_.count(what, least_bytes);
    return count_of(what, size(what), least_bytes);
  }

  std::size_t int_count(const char* what, std::size_t least_bytes) {
    if (!in_data_) return text_.count(what, least_bytes);
    return count_of(what, integer(what), least_bytes);
  }

  /// To behind the end of a section that has nothing for us; its content may be anything.
  void skip_section(std::string_view section) {
    const std::string end = "$End" + std::string(section.substr(1));
    if (is_binary_) {
      const std::size_t found = content_.find("\n" + end, text_.position());
      if (found == std::string_view::npos) refuse_open(section);
      text_.seek(found + 1);
      expect(end);
      return;
    }
    for (std::string_view word = this->word(); word != end; word = this->word())
      if (word.empty()) refuse_open(section);
  }

  [[noreturn]] void refuse(const std::string& what) const {
    if (in_data_) refuse_file(path_, "byte " + std::to_string(text_.position()) + ": " + what);
    text_.refuse(what);
  }

 private:
  template <typename T>
  T take(const char* what) {
    const std::size_t at = text_.position();
    if (content_.size() - at < sizeof(T))
      refuse("expected " + std::string(what) + ", found the end of the file");
    T value;
    std::memcpy(&value, content_.data() + at, sizeof(T));
    text_.seek(at + sizeof(T));
    return value;
  }

  [[nodiscard]] std::int64_t in_range(const char* what,
                                      std::int64_t value,
                                      std::int64_t least,
                                      std::int64_t most) const {
    if (value < least || value > most)
      refuse(std::string(what) + " (" + std::to_string(value) + ") must be " +
             std::to_string(least) + " to " + std::to_string(most));
    return value;
  }

  [[nodiscard]] std::size_t count_of(const char* what,
                                     std::int64_t value,
                                     std::size_t least_bytes) const {
    const std::size_t room = (content_.size() - text_.position()) / least_bytes;
    return static_cast<std::size_t>(in_range(
        what, value, 0, std::min<std::int64_t>(static_cast<std::int64_t>(room), kMostInt)));
  }

  [[noreturn]] void refuse_open(std::string_view section) const {
    refuse("the section " + std::string(section.substr(0, 40)) + " does not end");
  }

  const std::filesystem::path& path_;
  std::string_view content_;
  TextScanner text_;
  bool is_binary_ = false, in_data_ = false;
};

/// Nodes of the element types that Gmsh knows by number.
std::size_t nodes_of(const GmshScanner& scanner, std::int64_t type) {
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
      : scanner_(path, content) {}

  TetFile read() {
    read_format();
    for (std::string_view section = scanner_.word(); !section.empty(); section = scanner_.word()) {
      if (section == "$Nodes")
        is_4_ ? read_nodes_4() : read_nodes_2();
      else if (section == "$Elements")
        is_4_ ? read_elements_4() : read_elements_2();
      else if (section == "$Entities" && is_4_)
        read_entities();
      else if (section == "$Comments")
        read_comments();
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
    scanner_.read_storage();
  }

  void skip_section(std::string_view section) {
    if (section.substr(0, 1) != "$")
      scanner_.refuse("expected a section ($...), found '" + std::string(section.substr(0, 40)) +
                      "'");
    scanner_.skip_section(section);
  }

  /// The space, as cvmesh states it before anything else; names of labels follow.
  void read_comments() {
    constexpr std::string_view kKey = "SPACE=";
    bool is_told = false;
    for (std::string_view word = scanner_.word(); word != "$EndComments"; word = scanner_.word()) {
      if (word.empty()) scanner_.refuse("the section $Comments does not end");
      if (is_told || word.substr(0, kKey.size()) != kKey) continue;
      file_.space = space_of_name(std::string(word.substr(kKey.size())));
      is_told = true;
    }
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
    scanner_.begin_data();
    for (std::size_t i = 0; i < count; ++i) {
      const std::int64_t tag = read_number("the number of a node");
      add_node(tag, read_point());
    }
    scanner_.expect("$EndNodes");
  }

  void read_nodes_4() {
    scanner_.begin_data();
    const std::size_t blocks = scanner_.count("the number of node blocks", 8);
    for (int i = 0; i < 3; ++i)
      scanner_.size("the numbers of nodes");
    for (std::size_t b = 0; b < blocks; ++b) {
      scanner_.integer("the dimension of an entity");
      scanner_.integer("the number of an entity");
      if (scanner_.integer("parametric", 0, 1) != 0)
        scanner_.refuse("nodes with parametric coordinates are not supported");
      const std::size_t count = scanner_.count("the number of nodes", 8);
      std::vector<std::int64_t> tags(count);
      for (std::int64_t& tag : tags)
        tag = read_number("the number of a node");
      for (const std::int64_t tag : tags)
        add_node(tag, read_point());
    }
    scanner_.expect("$EndNodes");
  }

  // Physical groups of the volumes.
  void read_entities() {
    scanner_.begin_data();
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
    scanner_.expect("$EndEntities");
  }

  /// The number of a node or an element.
  std::int64_t read_number(const char* what) {
    return is_4_ ? scanner_.size(what) : scanner_.integer(what);
  }

  void read_element(std::int64_t type, std::int64_t label) {
    const std::size_t nodes = nodes_of(scanner_, type);
    std::array<std::int32_t, 4> tet{};
    for (std::size_t k = 0; k < nodes; ++k) {
      const std::int64_t tag = read_number("the node of an element");
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

  /// Text has type and number of tags in each element; binary files have runs of elements with one
  /// type and one number of tags.
  void read_elements_2() {
    const std::size_t count = scanner_.count("the number of elements", 6);  // "1 15 0 1\n"
    scanner_.begin_data();
    for (std::size_t left = count; left > 0;) {
      std::int64_t type = 0;
      std::size_t run = 1, tags = 0;
      const auto read_tag_count = [&] { return scanner_.int_count("the number of tags", 2); };
      if (scanner_.is_binary()) {
        type = scanner_.integer("the type of elements");
        run = static_cast<std::size_t>(scanner_.integer("the length of a run of elements", 1,
                                                        static_cast<std::int64_t>(left)));
        tags = read_tag_count();
      }
      for (std::size_t i = 0; i < run; ++i) {
        read_number("the number of an element");
        if (!scanner_.is_binary()) {
          type = scanner_.integer("the type of an element");
          tags = read_tag_count();
        }
        read_tagged_element(type, tags);
      }
      left -= run;
    }
    scanner_.expect("$EndElements");
  }

  void read_tagged_element(std::int64_t type, std::size_t tags) {
    std::int64_t physical = 0, entity = 0;
    for (std::size_t t = 0; t < tags; ++t) {
      const std::int64_t tag = scanner_.integer("a tag");
      if (t == 0) physical = tag;
      if (t == 1) entity = tag;
    }
    has_physical_ = has_physical_ || physical != 0;
    read_element(type, physical != 0 ? physical : entity);
  }

  void read_elements_4() {
    scanner_.begin_data();
    const std::size_t blocks = scanner_.count("the number of element blocks", 8);
    for (int i = 0; i < 3; ++i)
      scanner_.size("the numbers of elements");
    for (std::size_t b = 0; b < blocks; ++b) {
      const std::int64_t dimension = scanner_.integer("the dimension of an entity", 0, 3);
      const std::int64_t entity = scanner_.integer("the number of an entity");
      const std::int64_t type = scanner_.integer("the type of an element");
      const std::size_t count = scanner_.count("the number of elements", 4);
      const auto group = dimension == 3 ? physical_of_.find(entity) : physical_of_.end();
      has_physical_ = has_physical_ || group != physical_of_.end();
      for (std::size_t i = 0; i < count; ++i) {
        read_number("the number of an element");
        read_element(type, group != physical_of_.end() ? group->second : entity);
      }
    }
    scanner_.expect("$EndElements");
  }

  GmshScanner scanner_;
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
