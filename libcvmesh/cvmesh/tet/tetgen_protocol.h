// SPDX-License-Identifier: AGPL-3.0-or-later
#pragma once

#include "cvmesh/core/vec3.h"

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

/// What cvmesh and its helper program cvmesh-tetgen say to each other: one request on the helper's
/// standard input, one reply on its standard output.
///
/// A message is a `Header` followed by `payload_bytes` bytes: the fields of the request or reply in
/// the order of `encode`, arrays with their length in front. Both ends run on one machine and come
/// from one build, so numbers travel in the machine's own format; magic, version, length and
/// checksum catch a helper of another build and a reply that was cut short.
namespace cvmesh::tetgen_protocol {

inline constexpr std::array<char, 8> kMagic{'C', 'V', 'M', 'T', 'E', 'T', '\r', '\n'};
inline constexpr std::uint32_t kVersion = 1;

enum class Kind : std::uint32_t { Request = 1, Reply = 2 };

struct Header {
  std::array<char, 8> magic = kMagic;
  std::uint32_t version = kVersion;
  Kind kind = Kind::Request;
  std::uint64_t payload_bytes = 0;
  std::uint64_t checksum = 0;
  std::uint64_t memory_limit_bytes = 0;  ///< of a request: address space; 0 none
  std::int64_t parent_pid = 0;           ///< of a request: dies when this process does
};

static_assert(std::is_trivially_copyable_v<Header>);

/// Target edge lengths on a grid: the value at (i, j, k) sits at origin + (i, j, k) * cell,
/// x fastest. Empty `values`: no bound on the size of the tets.
struct SizeGrid {
  std::array<std::int32_t, 3> dims{0, 0, 0};
  Vec3 origin, cell;
  std::vector<float> values;

  /// Trilinear, clamped to the grid.
  [[nodiscard]] double at(const Vec3& p) const {
    int lower[3], upper[3];
    double t[3];
    for (int k = 0; k < 3; ++k) {
      const double u = (p[k] - origin[k]) / cell[k];
      const double clamped = u > 0 ? (u < dims[k] - 1 ? u : dims[k] - 1) : 0;
      lower[k] = static_cast<int>(clamped);
      upper[k] = lower[k] + 1 < dims[k] ? lower[k] + 1 : lower[k];
      t[k] = clamped - lower[k];
    }
    double sum = 0;
    for (int corner = 0; corner < 8; ++corner) {
      std::size_t at[3];
      double weight = 1;
      for (int k = 0; k < 3; ++k) {
        const bool high = (corner >> k) & 1;
        at[k] = static_cast<std::size_t>(high ? upper[k] : lower[k]);
        weight *= high ? t[k] : 1 - t[k];
      }
      sum +=
          weight * static_cast<double>(values[(at[2] * static_cast<std::size_t>(dims[1]) + at[1]) *
                                                  static_cast<std::size_t>(dims[0]) +
                                              at[0]]);
    }
    return sum;
  }
};

/// One run of TetGen. Facet f bears the marker f + 1.
struct Request {
  std::string switches;
  std::vector<Vec3> points;
  std::vector<std::array<std::int32_t, 3>> facets;
  SizeGrid size;  ///< a tet larger than a regular one of this edge length is split
};

/// What became of it. `code` is 0, a number that TetGen threw (1 memory, 2 its own fault,
/// 3 self-intersection, 4 very small feature, 5 very close facets, 10 input), or one of `kCode...`.
struct Reply {
  std::int32_t code = 0;
  std::vector<Vec3> points;
  std::vector<std::array<std::int32_t, 4>> tets;
  std::vector<std::int32_t> region_of;  ///< per tet: TetGen's number of its connected part
};

inline constexpr std::int32_t kCodeOutOfMemory = 100;
inline constexpr std::int32_t kCodeBadRequest = 101;
inline constexpr std::int32_t kCodeException = 102;

/// FNV-1a over eight bytes at a time: catches truncation and mix-ups, not malice.
inline std::uint64_t checksum(const std::vector<char>& bytes) {
  std::uint64_t hash = 0xcbf29ce484222325ULL;
  for (std::size_t i = 0; i < bytes.size(); i += sizeof(std::uint64_t)) {
    std::uint64_t word = 0;
    std::memcpy(&word, bytes.data() + i, std::min(sizeof word, bytes.size() - i));
    hash = (hash ^ word) * 0x100000001b3ULL;
    hash ^= hash >> 32;
  }
  return hash ^ bytes.size();
}

/// Appends values to a payload.
class Writer {
 public:
  template <typename T>
  void value(const T& v) {
    static_assert(std::is_trivially_copyable_v<T>);
    append(&v, sizeof v);
  }

  template <typename Array>
  void array(const Array& a) {
    static_assert(std::is_trivially_copyable_v<typename Array::value_type>);
    value(static_cast<std::uint64_t>(a.size()));
    append(a.data(), a.size() * sizeof(typename Array::value_type));
  }

  std::vector<char> bytes;

 private:
  void append(const void* data, std::size_t size) {
    const char* first = static_cast<const char*>(data);
    bytes.insert(bytes.end(), first, first + size);
  }
};

/// Takes them out again; `ok` turns false, and stays so, when the payload is too short.
class Reader {
 public:
  explicit Reader(const std::vector<char>& bytes) : bytes_(bytes) {}

  template <typename T>
  void value(T& v) {
    static_assert(std::is_trivially_copyable_v<T>);
    take(&v, sizeof v);
  }

  template <typename Array>
  void array(Array& a) {
    using Item = typename Array::value_type;
    static_assert(std::is_trivially_copyable_v<Item>);
    std::uint64_t count = 0;
    value(count);
    if (!ok || count > (bytes_.size() - at_) / sizeof(Item)) {
      ok = false;
      return;
    }
    a.resize(count);
    take(a.data(), count * sizeof(Item));
  }

  [[nodiscard]] bool is_done() const { return ok && at_ == bytes_.size(); }

  bool ok = true;

 private:
  void take(void* data, std::size_t size) {
    if (!ok || size > bytes_.size() - at_) {
      ok = false;
      return;
    }
    if (size > 0) std::memcpy(data, bytes_.data() + at_, size);
    at_ += size;
  }

  const std::vector<char>& bytes_;
  std::size_t at_ = 0;
};

inline std::vector<char> encode(const Request& request) {
  Writer out;
  out.array(request.switches);
  out.array(request.points);
  out.array(request.facets);
  out.value(request.size.dims);
  out.value(request.size.origin);
  out.value(request.size.cell);
  out.array(request.size.values);
  return std::move(out.bytes);
}

inline bool decode(const std::vector<char>& bytes, Request& request) {
  Reader in(bytes);
  in.array(request.switches);
  in.array(request.points);
  in.array(request.facets);
  in.value(request.size.dims);
  in.value(request.size.origin);
  in.value(request.size.cell);
  in.array(request.size.values);
  if (!in.is_done()) return false;
  const SizeGrid& size = request.size;
  std::size_t nodes = 1;
  for (int k = 0; k < 3; ++k) {
    if (size.dims[k] < 0 || size.dims[k] > (1 << 20)) return false;
    nodes *= static_cast<std::size_t>(size.dims[k]);
  }
  if (!size.values.empty() && nodes != size.values.size()) return false;
  for (const auto& facet : request.facets)
    for (const std::int32_t v : facet)
      if (v < 0 || static_cast<std::size_t>(v) >= request.points.size()) return false;
  return true;
}

inline std::vector<char> encode(const Reply& reply) {
  Writer out;
  out.value(reply.code);
  out.array(reply.points);
  out.array(reply.tets);
  out.array(reply.region_of);
  return std::move(out.bytes);
}

inline bool decode(const std::vector<char>& bytes, Reply& reply) {
  Reader in(bytes);
  in.value(reply.code);
  in.array(reply.points);
  in.array(reply.tets);
  in.array(reply.region_of);
  if (!in.is_done() || reply.region_of.size() != reply.tets.size()) return false;
  for (const auto& tet : reply.tets)
    for (const std::int32_t v : tet)
      if (v < 0 || static_cast<std::size_t>(v) >= reply.points.size()) return false;
  return true;
}

}  // namespace cvmesh::tetgen_protocol
