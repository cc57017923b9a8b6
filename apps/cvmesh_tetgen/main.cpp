// SPDX-License-Identifier: AGPL-3.0-or-later

// cvmesh-tetgen: runs TetGen once, in a process of its own.
//
// The packaged TetGen 1.5.0 crashes, hangs and keeps global state; a process can be limited and
// killed, a library call cannot. Reads one request from standard input and writes one reply to
// standard output (cvmesh/tet/tetgen_protocol.h); whatever TetGen prints goes to standard error.

#ifndef TETLIBRARY
#define TETLIBRARY
#endif
#include "cvmesh/tet/tetgen_protocol.h"

#include <tetgen.h>

#include <cerrno>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <dlfcn.h>
#include <new>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <typeinfo>
#include <unistd.h>
#include <vector>

namespace {

using namespace cvmesh::tetgen_protocol;

constexpr int kExitNoRequest = 3;
constexpr int kExitNoReply = 4;

int reply_fd = -1;
bool is_meshing = false;
SizeGrid size_grid;

bool read_exactly(int fd, char* data, std::size_t size) {
  while (size > 0) {
    const ssize_t count = read(fd, data, size);
    if (count < 0 && errno == EINTR) continue;
    if (count <= 0) return false;
    data += count;
    size -= static_cast<std::size_t>(count);
  }
  return true;
}

bool write_exactly(int fd, const char* data, std::size_t size) {
  while (size > 0) {
    const ssize_t count = write(fd, data, size);
    if (count < 0 && errno == EINTR) continue;
    if (count <= 0) return false;
    data += count;
    size -= static_cast<std::size_t>(count);
  }
  return true;
}

[[noreturn]] void send_and_exit(const Reply& reply) {
  const std::vector<char> payload = encode(reply);
  Header header;
  header.kind = Kind::Reply;
  header.payload_bytes = payload.size();
  header.checksum = checksum(payload);
  const bool sent =
      write_exactly(reply_fd, reinterpret_cast<const char*>(&header), sizeof header) &&
      write_exactly(reply_fd, payload.data(), payload.size());
  std::fflush(nullptr);
  _exit(sent ? 0 : kExitNoReply);
}

[[noreturn]] void fail(std::int32_t code) {
  Reply reply;
  reply.code = code;
  send_and_exit(reply);
}

/// The parent may be killed with no chance to clean up; the kernel then ends this process too.
void die_with_parent(std::int64_t parent_pid) {
  prctl(PR_SET_PDEATHSIG, SIGKILL);
  if (parent_pid != 0 && getppid() != parent_pid) _exit(kExitNoRequest);
}

void limit_resources(std::uint64_t memory_bytes) {
  const rlimit no_core{0, 0};  // a crash is an expected outcome here, not one to keep a file of
  setrlimit(RLIMIT_CORE, &no_core);
  if (memory_bytes == 0) return;
  rlimit memory{};
  getrlimit(RLIMIT_AS, &memory);
  if (memory.rlim_max != RLIM_INFINITY && memory_bytes > memory.rlim_max)
    memory_bytes = memory.rlim_max;
  memory.rlim_cur = memory_bytes;
  setrlimit(RLIMIT_AS, &memory);
}

Request read_request() {
  Header header;
  if (!read_exactly(STDIN_FILENO, reinterpret_cast<char*>(&header), sizeof header) ||
      header.magic != kMagic) {
    std::fputs("cvmesh-tetgen is a helper of cvmesh and is not meant to be run by hand\n", stderr);
    _exit(kExitNoRequest);
  }
  if (header.version != kVersion || header.kind != Kind::Request) fail(kCodeBadRequest);
  die_with_parent(header.parent_pid);
  limit_resources(header.memory_limit_bytes);
  std::vector<char> payload(header.payload_bytes);
  if (!read_exactly(STDIN_FILENO, payload.data(), payload.size())) _exit(kExitNoRequest);
  Request request;
  if (checksum(payload) != header.checksum || !decode(payload, request)) fail(kCodeBadRequest);
  return request;
}

/// TetGen's question whether to split a tet: yes when its volume exceeds that of a regular tet
/// whose edges have the target length at its centroid.
bool is_too_large(REAL* a, REAL* b, REAL* c, REAL* d, REAL*, REAL) {
  const cvmesh::Vec3 p{a[0], a[1], a[2]}, q{b[0], b[1], b[2]}, r{c[0], c[1], c[2]},
      s{d[0], d[1], d[2]};
  const double h = size_grid.at((p + q + r + s) / 4);
  constexpr double kSqrt2 = 1.41421356237309505;
  return std::abs(cvmesh::volume6(p, q, r, s)) * kSqrt2 > h * h * h;  // 6 V > h^3 / sqrt 2
}

/// Fills TetGen's arrays, which it frees by delete[].
void fill(tetgenio& in, const Request& request) {
  in.firstnumber = 0;
  in.numberofpoints = static_cast<int>(request.points.size());
  in.pointlist = new REAL[3 * request.points.size()];
  for (std::size_t i = 0; i < request.points.size(); ++i)
    for (int k = 0; k < 3; ++k)
      in.pointlist[3 * i + static_cast<std::size_t>(k)] = request.points[i][k];
  in.numberoffacets = static_cast<int>(request.facets.size());
  in.facetlist = new tetgenio::facet[request.facets.size()];
  in.facetmarkerlist = new int[request.facets.size()];
  for (std::size_t f = 0; f < request.facets.size(); ++f) {
    tetgenio::facet& facet = in.facetlist[f];
    tetgenio::init(&facet);
    facet.numberofpolygons = 1;
    facet.polygonlist = new tetgenio::polygon[1];
    facet.polygonlist[0].numberofvertices = 3;
    facet.polygonlist[0].vertexlist = new int[3];
    for (std::size_t k = 0; k < 3; ++k)
      facet.polygonlist[0].vertexlist[k] = request.facets[f][k];
    in.facetmarkerlist[f] = static_cast<int>(f) + 1;
  }
  if (!request.size.values.empty()) {
    size_grid = request.size;
    in.tetunsuitable = is_too_large;
  }
}

Reply take(const tetgenio& out) {
  Reply reply;
  reply.points.resize(static_cast<std::size_t>(out.numberofpoints));
  for (std::size_t i = 0; i < reply.points.size(); ++i)
    reply.points[i] = {out.pointlist[3 * i], out.pointlist[3 * i + 1], out.pointlist[3 * i + 2]};
  const std::size_t tets = static_cast<std::size_t>(out.numberoftetrahedra);
  const std::size_t corners = static_cast<std::size_t>(out.numberofcorners);
  const std::size_t attributes = static_cast<std::size_t>(out.numberoftetrahedronattributes);
  reply.tets.resize(tets);
  reply.region_of.assign(tets, 0);
  for (std::size_t t = 0; t < tets; ++t) {
    for (std::size_t k = 0; k < 4; ++k)
      reply.tets[t][k] = out.tetrahedronlist[corners * t + k];
    if (attributes > 0)  // the region is the last attribute
      reply.region_of[t] =
          static_cast<std::int32_t>(out.tetrahedronattributelist[attributes * t + attributes - 1]);
  }
  return reply;
}

}  // namespace

/// The packaged TetGen frees its mesh and then throws an int; unwinding destroys the mesh a second
/// time and the process dies before any handler runs. Its error number is therefore taken here,
/// where the exception starts. Everything else goes on to the C++ runtime.
extern "C" __attribute__((noreturn)) void __cxa_throw(void* thrown,
                                                      void* type,
                                                      void (*destroy)(void*)) {
  if (is_meshing && *static_cast<std::type_info*>(type) == typeid(int)) {
    is_meshing = false;
    fail(*static_cast<const int*>(thrown));
  }
  using Throw = void (*)(void*, void*, void (*)(void*));
  const Throw original = reinterpret_cast<Throw>(dlsym(RTLD_NEXT, "__cxa_throw"));
  if (original != nullptr) original(thrown, type, destroy);
  std::abort();
}

int main() {
  std::signal(SIGPIPE, SIG_IGN);
  reply_fd = dup(STDOUT_FILENO);
  if (reply_fd < 0 || dup2(STDERR_FILENO, STDOUT_FILENO) < 0) return kExitNoReply;
  try {
    const Request request = read_request();
    tetgenio in, out;
    fill(in, request);
    std::vector<char> switches(request.switches.begin(), request.switches.end());
    switches.push_back('\0');
    is_meshing = true;
    tetrahedralize(switches.data(), &in, &out);
    is_meshing = false;
    send_and_exit(take(out));
  } catch (const std::bad_alloc&) {
    is_meshing = false;
    fail(kCodeOutOfMemory);
  } catch (...) {
    is_meshing = false;
    fail(kCodeException);
  }
}
