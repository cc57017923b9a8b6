// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/interfaces/extract_interfaces.h"

#include "cvmesh/core/assert.h"
#include "cvmesh/core/parallel.h"
#include "cvmesh/mesh/sort_along_curve.h"
#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <utility>

// The lattice. Nodes are the voxel centres plus one ghost layer on each side of the grid, half a
// voxel out, on the faces of the box; ghosts repeat the label and values of the nearest border
// node. Each cube is split into six tets around its diagonal (1,1,1); every simplex is a chain
// p < p + m1 < p + m2 < p + 7 of 0/1 offset masks, named by its lowest node p and its masks.
//
// A dense vertex sits in a lattice element: on an edge (two labels), in a triangle (three), in a
// tet (four), or at a ghost node of the box faces. Its key is 32 * node + element type; sorting the
// keys numbers the vertices independently of the number of threads.

namespace cvmesh {
namespace {

using Key = std::uint64_t;

// Least distance of a cut point from the ends of its lattice edge, in edge lengths: keeps every
// facet's area positive and costs at most 5 % of an edge.
constexpr double kEdgeClamp = 0.05;
// The same for points in triangles and tets, in barycentric coordinates.
constexpr double kBarycentricClamp = 0.05;

constexpr int kNodeType = 25;
constexpr int kFirstFaceType = 7, kFirstTetType = 19;

// The twelve triangle chains (m1, m2) and six tet chains (m1, m2, 7) at a node.
struct Chains {
  std::array<std::array<int, 2>, 12> face{};
  std::array<std::array<int, 2>, 6> tet{};
  std::array<std::array<int, 8>, 8> face_index{}, tet_index{};
};

constexpr Chains make_chains() {
  Chains chains;
  int faces = 0, tets = 0;
  for (int m2 = 1; m2 < 8; ++m2)
    for (int m1 = 1; m1 < m2; ++m1) {
      if ((m1 & m2) != m1) continue;
      chains.face[faces] = {m1, m2};
      chains.face_index[m1][m2] = faces++;
      if (m2 == 7 || std::popcount(static_cast<unsigned>(m2)) != 2) continue;
      chains.tet[tets] = {m1, m2};
      chains.tet_index[m1][m2] = tets++;
    }
  return chains;
}

constexpr Chains kChains = make_chains();

class Lattice {
 public:
  explicit Lattice(const LevelSets& level_sets)
      : level_sets_(level_sets), frame_(level_sets.frame()) {
    for (int axis = 0; axis < 3; ++axis)
      dims_[axis] = frame_.dims[axis] + 2;
  }

  [[nodiscard]] const std::array<int, 3>& dims() const { return dims_; }

  [[nodiscard]] std::uint64_t node(int i, int j, int k) const {
    return (static_cast<std::uint64_t>(k) * dims_[1] + j) * dims_[0] + i;
  }

  [[nodiscard]] std::array<int, 3> place(std::uint64_t node) const {
    return {static_cast<int>(node % dims_[0]), static_cast<int>(node / dims_[0] % dims_[1]),
            static_cast<int>(node / dims_[0] / dims_[1])};
  }

  [[nodiscard]] MaterialId label(const std::array<int, 3>& at) const {
    return (*level_sets_.labels)(source(0, at[0]), source(1, at[1]), source(2, at[2]));
  }

  [[nodiscard]] double value(MaterialId m, const std::array<int, 3>& at) const {
    return level_sets_.at(m, source(0, at[0]), source(1, at[1]), source(2, at[2]));
  }

  /// Grid coordinate index (not mm) of lattice place `i` along an axis.
  [[nodiscard]] double coordinate(int axis, int i) const {
    if (i == 0) return -0.5;
    if (i == dims_[axis] - 1) return frame_.dims[axis] - 0.5;
    return i - 1;
  }

  [[nodiscard]] Vec3 position(const std::array<int, 3>& at) const {
    return {coordinate(0, at[0]), coordinate(1, at[1]), coordinate(2, at[2])};
  }

  [[nodiscard]] Vec3 to_mm(const Vec3& index) const { return frame_.index_to_mm(index); }

  static std::array<int, 3> offset(const std::array<int, 3>& at, int mask) {
    return {at[0] + (mask & 1), at[1] + ((mask >> 1) & 1), at[2] + ((mask >> 2) & 1)};
  }

 private:
  [[nodiscard]] int source(int axis, int i) const {
    return std::clamp(i - 1, 0, frame_.dims[axis] - 1);
  }

  const LevelSets& level_sets_;
  const GridFrame& frame_;
  std::array<int, 3> dims_{};
};

// A simplex of the lattice while it is cut: labels at its chain nodes, and the keys of its parts.
struct Simplex {
  std::uint64_t base = 0;     // lowest node of the cube
  std::array<int, 4> mask{};  // ascending; the first may be nonzero
  std::array<MaterialId, 4> label{};
  const Lattice* lattice = nullptr;

  [[nodiscard]] std::uint64_t node(int corner) const {
    const int m = mask[corner];
    return base + lattice->node(m & 1, (m >> 1) & 1, (m >> 2) & 1);
  }

  [[nodiscard]] Key edge(int a, int b) const {
    if (a > b) std::swap(a, b);
    return node(a) * 32 + static_cast<Key>((mask[b] ^ mask[a]) - 1);
  }

  [[nodiscard]] Key face(int a, int b, int c) const {
    if (a > b) std::swap(a, b);
    if (b > c) std::swap(b, c);
    if (a > b) std::swap(a, b);
    return node(a) * 32 + kFirstFaceType + kChains.face_index[mask[b] ^ mask[a]][mask[c] ^ mask[a]];
  }

  [[nodiscard]] Key center() const {
    return node(0) * 32 + kFirstTetType + kChains.tet_index[mask[1]][mask[2]];
  }

  [[nodiscard]] Key corner(int a) const { return node(a) * 32 + kNodeType; }
};

// Where a key's element sits when every cut is in the middle: decides orientations exactly.
Vec3 middle(const Simplex& s, std::initializer_list<int> corners) {
  Vec3 sum;
  for (const int c : corners)
    sum += Vec3{double(s.mask[c] & 1), double((s.mask[c] >> 1) & 1), double((s.mask[c] >> 2) & 1)};
  return sum / static_cast<double>(corners.size());
}

struct KeyFacet {
  std::array<Key, 3> keys;
  PatchKey patch;
};

struct Point {
  Key key;
  Vec3 middle;
};

class FacetSink {
 public:
  std::vector<KeyFacet> facets;

  // A facet between the labels at corners `a` and `b` of the simplex, oriented from the larger
  // material id (inside) to the smaller.
  void add_interface(
      const Simplex& s, int a, int b, const Point& p, const Point& q, const Point& r) {
    if (s.label[a] < s.label[b]) std::swap(a, b);
    const Vec3 outward = middle(s, {b}) - middle(s, {a});
    add(p, q, r, outward, {{s.label[a], s.label[b]}, 0});
  }

  // A facet of box face `wall` that closes a material.
  void add_wall(MaterialId material,
                std::uint8_t wall,
                const Vec3& outward,
                const Point& p,
                const Point& q,
                const Point& r) {
    if (material != kExterior) add(p, q, r, outward, {{material, kExterior}, wall});
  }

 private:
  void add(const Point& p, const Point& q, const Point& r, const Vec3& outward, PatchKey patch) {
    const bool is_outward = dot(area_vector2(p.middle, q.middle, r.middle), outward) > 0;
    facets.push_back({is_outward ? std::array<Key, 3>{p.key, q.key, r.key}
                                 : std::array<Key, 3>{p.key, r.key, q.key},
                      patch});
  }
};

Point edge_point(const Simplex& s, int a, int b) {
  return {s.edge(a, b), middle(s, {a, b})};
}

Point face_point(const Simplex& s, int a, int b, int c) {
  return {s.face(a, b, c), middle(s, {a, b, c})};
}

// Corners of a simplex grouped by label: groups in order of their first corner.
struct Groups {
  int count = 0;
  std::array<std::array<int, 4>, 4> corners{};
  std::array<int, 4> size{};
};

Groups group_by_label(const Simplex& s, int corner_count) {
  Groups groups;
  for (int c = 0; c < corner_count; ++c) {
    int g = 0;
    while (g < groups.count && s.label[groups.corners[g][0]] != s.label[c])
      ++g;
    if (g == groups.count) ++groups.count;
    groups.corners[g][groups.size[g]++] = c;
  }
  return groups;
}

// The facets between labels inside one tet: 1 or 2 (two labels), 5 (three), 12 (four).
void cut_tet(const Simplex& s, FacetSink& sink) {
  const Groups g = group_by_label(s, 4);
  if (g.count == 2 && g.size[0] != 2) {
    const int single = g.size[0] == 1 ? 0 : 1;
    const int a = g.corners[single][0];
    const auto& b = g.corners[1 - single];
    sink.add_interface(s, a, b[0], edge_point(s, a, b[0]), edge_point(s, a, b[1]),
                       edge_point(s, a, b[2]));
  } else if (g.count == 2) {
    const auto& a = g.corners[0];
    const auto& b = g.corners[1];
    const Point p = edge_point(s, a[0], b[0]), q = edge_point(s, a[0], b[1]);
    const Point r = edge_point(s, a[1], b[1]), t = edge_point(s, a[1], b[0]);
    sink.add_interface(s, a[0], b[0], p, q, r);
    sink.add_interface(s, a[0], b[0], p, r, t);
  } else if (g.count == 3) {
    const int pair = g.size[0] == 2 ? 0 : g.size[1] == 2 ? 1 : 2;
    const int i = g.corners[pair][0], j = g.corners[pair][1];
    const int k = g.corners[pair == 0 ? 1 : 0][0], l = g.corners[pair == 2 ? 1 : 2][0];
    const Point fi = face_point(s, i, k, l), fj = face_point(s, j, k, l);
    sink.add_interface(s, k, l, edge_point(s, k, l), fi, fj);
    for (const int single : {k, l}) {
      const Point ei = edge_point(s, i, single), ej = edge_point(s, j, single);
      sink.add_interface(s, i, single, ei, fi, fj);
      sink.add_interface(s, i, single, ei, fj, ej);
    }
  } else if (g.count == 4) {
    const Point center{s.center(), middle(s, {0, 1, 2, 3})};
    for (int a = 0; a < 4; ++a)
      for (int b = a + 1; b < 4; ++b) {
        const int c = a == 0 ? (b == 1 ? 2 : 1) : 0, d = 6 - a - b - c;
        const Point e = edge_point(s, a, b);
        sink.add_interface(s, a, b, e, face_point(s, a, b, c), center);
        sink.add_interface(s, a, b, e, face_point(s, a, b, d), center);
      }
  }
}

// The parts of one boundary triangle (corners 0..2 of the simplex) that belong to each label.
void cut_wall(const Simplex& s, std::uint8_t wall, const Vec3& outward, FacetSink& sink) {
  const Groups g = group_by_label(s, 3);
  const auto corner = [&](int c) { return Point{s.corner(c), middle(s, {c})}; };
  if (g.count == 1) {
    sink.add_wall(s.label[0], wall, outward, corner(0), corner(1), corner(2));
  } else if (g.count == 2) {
    const int pair = g.size[0] == 2 ? 0 : 1;
    const int i = g.corners[pair][0], j = g.corners[pair][1], k = g.corners[1 - pair][0];
    const Point ik = edge_point(s, i, k), jk = edge_point(s, j, k);
    sink.add_wall(s.label[k], wall, outward, corner(k), ik, jk);
    sink.add_wall(s.label[i], wall, outward, corner(i), corner(j), jk);
    sink.add_wall(s.label[i], wall, outward, corner(i), jk, ik);
  } else {
    const Point f = face_point(s, 0, 1, 2);
    for (int a = 0; a < 3; ++a) {
      const Point ab = edge_point(s, a, (a + 1) % 3), ac = edge_point(s, a, (a + 2) % 3);
      sink.add_wall(s.label[a], wall, outward, corner(a), ab, f);
      sink.add_wall(s.label[a], wall, outward, corner(a), f, ac);
    }
  }
}

// Facets of all cubes of one lattice layer.
void cut_layer(const Lattice& lattice, int k, FacetSink& sink) {
  const auto& dims = lattice.dims();
  std::array<MaterialId, 8> label;
  for (int j = 0; j + 1 < dims[1]; ++j)
    for (int i = 0; i + 1 < dims[0]; ++i) {
      bool is_uniform = true;
      for (int m = 0; m < 8; ++m) {
        label[m] = lattice.label(Lattice::offset({i, j, k}, m));
        is_uniform &= label[m] == label[0];
      }
      if (is_uniform) continue;
      for (const auto& [m1, m2] : kChains.tet) {
        const Simplex s{lattice.node(i, j, k),
                        {0, m1, m2, 7},
                        {label[0], label[m1], label[m2], label[7]},
                        &lattice};
        cut_tet(s, sink);
      }
    }
}

// Facets of box face `axis`, `is_high`: two triangles for each lattice square.
void cut_box_face(const Lattice& lattice, int axis, bool is_high, FacetSink& sink) {
  const auto& dims = lattice.dims();
  const int u = (axis + 1) % 3, v = (axis + 2) % 3;
  const int mu = 1 << u, mv = 1 << v;
  const auto wall = static_cast<std::uint8_t>(1 + 2 * axis + (is_high ? 1 : 0));
  Vec3 outward;
  outward[axis] = is_high ? 1 : -1;
  std::array<int, 3> at{};
  at[axis] = is_high ? dims[axis] - 1 : 0;
  for (at[v] = 0; at[v] + 1 < dims[v]; ++at[v])
    for (at[u] = 0; at[u] + 1 < dims[u]; ++at[u])
      for (const int first : {mu, mv}) {
        const Simplex s{lattice.node(at[0], at[1], at[2]),
                        {0, first, mu | mv, 0},
                        {lattice.label(at), lattice.label(Lattice::offset(at, first)),
                         lattice.label(Lattice::offset(at, mu | mv)), 0},
                        &lattice};
        cut_wall(s, wall, outward, sink);
      }
}

// Barycentric coordinates of the point where all n labels' values are equal, on the simplex of the
// n nodes; clamped inside. Gaussian elimination on (f_0 - f_r) = 0, sum = 1.
std::array<double, 4> equal_value_point(int n,
                                        const std::array<std::array<int, 3>, 4>& at,
                                        const Lattice& lattice) {
  std::array<std::array<double, 5>, 4> system{};
  for (int row = 0; row + 1 < n; ++row)
    for (int c = 0; c < n; ++c)
      system[row][c] = lattice.value(lattice.label(at[0]), at[c]) -
                       lattice.value(lattice.label(at[row + 1]), at[c]);
  for (int c = 0; c < n; ++c)
    system[n - 1][c] = 1;
  system[n - 1][n] = 1;
  std::array<double, 4> w{};
  bool is_solved = true;
  for (int col = 0; col < n && is_solved; ++col) {
    int pivot = col;
    for (int row = col + 1; row < n; ++row)
      if (std::abs(system[row][col]) > std::abs(system[pivot][col])) pivot = row;
    std::swap(system[col], system[pivot]);
    is_solved = std::abs(system[col][col]) > 1e-9;
    if (!is_solved) break;
    for (int row = 0; row < n; ++row) {
      if (row == col) continue;
      const double factor = system[row][col] / system[col][col];
      for (int c = col; c <= n; ++c)
        system[row][c] -= factor * system[col][c];
    }
  }
  double sum = 0;
  for (int c = 0; c < n; ++c) {
    w[c] = is_solved ? system[c][n] / system[c][c] : 1.0 / n;
    w[c] = std::clamp(w[c], kBarycentricClamp, 1.0);
    sum += w[c];
  }
  for (int c = 0; c < n; ++c)
    w[c] /= sum;
  return w;
}

// Position (index space) of the dense vertex with a given key.
Vec3 vertex_position(const Lattice& lattice, Key key) {
  const auto at = lattice.place(key / 32);
  const int type = static_cast<int>(key % 32);
  if (type == kNodeType) return lattice.position(at);
  std::array<std::array<int, 3>, 4> corner{at};
  int n = 2;
  if (type < kFirstFaceType) {
    corner[1] = Lattice::offset(at, type + 1);
  } else if (type < kFirstTetType) {
    n = 3;
    for (int c = 0; c < 2; ++c)
      corner[c + 1] = Lattice::offset(at, kChains.face[type - kFirstFaceType][c]);
  } else {
    n = 4;
    for (int c = 0; c < 2; ++c)
      corner[c + 1] = Lattice::offset(at, kChains.tet[type - kFirstTetType][c]);
    corner[3] = Lattice::offset(at, 7);
  }
  const Vec3 p0 = lattice.position(at);
  if (n == 2) {
    const MaterialId a = lattice.label(corner[0]), b = lattice.label(corner[1]);
    const double g0 = lattice.value(a, corner[0]) - lattice.value(b, corner[0]);
    const double g1 = lattice.value(a, corner[1]) - lattice.value(b, corner[1]);
    const double t = std::clamp(g0 / (g0 - g1), kEdgeClamp, 1 - kEdgeClamp);
    return p0 + t * (lattice.position(corner[1]) - p0);
  }
  const auto w = equal_value_point(n, corner, lattice);
  Vec3 p = p0;  // as offsets from p0, so that points of a box face stay exactly in its plane
  for (int c = 1; c < n; ++c)
    p += w[c] * (lattice.position(corner[c]) - p0);
  return p;
}

// Numbers of sorted keys, found by binary search inside the row of lattice nodes of a key.
class KeyIndex {
 public:
  KeyIndex(std::vector<Key> keys, const Lattice& lattice)
      : keys_(std::move(keys)), row_keys_(32 * static_cast<Key>(lattice.dims()[0])) {
    const std::size_t rows = static_cast<std::size_t>(lattice.dims()[1]) * lattice.dims()[2];
    row_start_.resize(rows + 1);
    std::size_t n = 0;
    for (std::size_t row = 0; row <= rows; ++row) {
      while (n < keys_.size() && keys_[n] < row * row_keys_)
        ++n;
      row_start_[row] = n;
    }
  }

  [[nodiscard]] std::int32_t find(Key key) const {
    const std::size_t row = key / row_keys_;
    const auto begin = keys_.begin() + static_cast<std::ptrdiff_t>(row_start_[row]);
    const auto end = keys_.begin() + static_cast<std::ptrdiff_t>(row_start_[row + 1]);
    return static_cast<std::int32_t>(std::lower_bound(begin, end, key) - keys_.begin());
  }

  [[nodiscard]] const std::vector<Key>& keys() const { return keys_; }

 private:
  std::vector<Key> keys_;
  Key row_keys_;
  std::vector<std::size_t> row_start_;
};

std::vector<KeyFacet> cut_lattice(const Lattice& lattice, const StageContext& context) {
  const auto layers = static_cast<std::size_t>(lattice.dims()[2] - 1);
  std::vector<FacetSink> sinks(layers + 6);
  parallel_for_each_index(
      0, layers, [&](std::size_t k) { cut_layer(lattice, static_cast<int>(k), sinks[k]); }, 1);
  for (std::size_t face = 0; face < 6; ++face)
    cut_box_face(lattice, static_cast<int>(face / 2), face % 2 == 1, sinks[layers + face]);
  report_progress(context, "dense surfaces", 0.4);
  std::size_t count = 0;
  for (const auto& sink : sinks)
    count += sink.facets.size();
  std::vector<KeyFacet> facets;
  facets.reserve(count);
  for (auto& sink : sinks) {
    facets.insert(facets.end(), sink.facets.begin(), sink.facets.end());
    std::vector<KeyFacet>().swap(sink.facets);
  }
  return facets;
}

}  // namespace

InterfaceMesh extract_interfaces(const LevelSets& level_sets, const StageContext& context) {
  const Lattice lattice(level_sets);
  const std::vector<KeyFacet> key_facets = cut_lattice(lattice, context);

  std::vector<Key> keys;
  keys.reserve(3 * key_facets.size());
  for (const auto& facet : key_facets)
    keys.insert(keys.end(), facet.keys.begin(), facet.keys.end());
  parallel_sort(keys.begin(), keys.end());
  keys.erase(std::unique(keys.begin(), keys.end()), keys.end());
  const KeyIndex index(std::move(keys), lattice);
  report_progress(context, "dense surfaces", 0.7);

  InterfaceMesh mesh;
  mesh.points.resize(index.keys().size());
  parallel_for_each_index(0, mesh.points.size(), [&](std::size_t v) {
    mesh.points[v] = lattice.to_mm(vertex_position(lattice, index.keys()[v]));
  });
  mesh.facets.resize(key_facets.size());
  mesh.patch_of.resize(key_facets.size());
  parallel_for_each_index(0, key_facets.size(), [&](std::size_t f) {
    for (int c = 0; c < 3; ++c)
      mesh.facets[f][c] = index.find(key_facets[f].keys[c]);
    mesh.patch_of[f] = key_facets[f].patch;
  });
  sort_along_curve(mesh, level_sets.frame().voxel_mm());
  report_progress(context, "dense surfaces", 1);
  return mesh;
}

}  // namespace cvmesh
