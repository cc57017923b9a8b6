// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/core/cpu_limit.h"
#include "cvmesh/core/id_bits.h"
#include "cvmesh/io/sha256.h"

#include "io/image_files.h"
#include "support/catch.h"
#include "support/test_data.h"
#include <algorithm>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

using namespace cvmesh;
using cvmesh::image_files::write_file;

namespace {

std::string sha256(const std::string& text, std::size_t piece) {
  Sha256 hash;
  for (std::size_t at = 0; at < text.size(); at += piece)
    hash.update(std::as_bytes(std::span(text).subspan(at, std::min(piece, text.size() - at))));
  return hash.hex();
}

}  // namespace

TEST_CASE("Sha256: the standard's examples, in pieces of any size", "[core][unit]") {
  for (const std::size_t piece : {1U, 7U, 64U, 1000000U}) {
    CHECK(sha256("", piece) == "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855");
    CHECK(sha256("abc", piece) ==
          "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
    CHECK(sha256("abcdbcdecdefdefgefghfghighijhijkijkljklmklmnlmnomnopnopq", piece) ==
          "248d6a61d20638b8e5c026930c3e6039a33ce45964ff2167f6ecedd419db06c1");
    CHECK(sha256(std::string(1000000, 'a'), piece) ==
          "cdc76e5c9914fb9281a1c7e284d73e67f1809a48a497200e046d39ccc7112cd0");
  }
}

TEST_CASE("cgroup_cpu_limit: the least of the group and those above it", "[core][unit]") {
  const test_data::TemporaryFolder folder;
  const auto root = folder / "cgroup";
  std::filesystem::create_directories(root / "job" / "step");
  write_file(folder / "self", "12:cpu:/old\n0::/job/step\n");
  CHECK(cgroup_cpu_limit(root, folder / "self") == 0);
  write_file(root / "cpu.max", "max 100000\n");
  CHECK(cgroup_cpu_limit(root, folder / "self") == 0);
  write_file(root / "job" / "cpu.max", "250000 100000\n");
  CHECK(cgroup_cpu_limit(root, folder / "self") == 3);
  write_file(root / "job" / "step" / "cpu.max", "50000 100000\n");
  CHECK(cgroup_cpu_limit(root, folder / "self") == 1);
  write_file(root / "job" / "step" / "cpu.max", "800000 100000\n");
  CHECK(cgroup_cpu_limit(root, folder / "self") == 3);
  // Another group is none of ours, and a file that is not there sets no limit.
  write_file(folder / "self", "0::/other\n");
  CHECK(cgroup_cpu_limit(root, folder / "self") == 0);
  CHECK(cgroup_cpu_limit(folder / "absent", folder / "absent") == 0);
}

TEST_CASE("IdBits: never says of one that it is not there, and says it of most others",
          "[core][unit]") {
  const std::vector<std::int32_t> ids{0, 7, 64, 1000003, 2147483647};
  IdBits bits(ids);
  for (const std::int32_t id : ids)
    CHECK(bits.may_hold(id));
  CHECK_FALSE(bits.may_hold(8));
  CHECK_FALSE(IdBits().may_hold(0));
  bits.add(8);
  CHECK(bits.may_hold(8));
  int maybe = 0;
  for (std::int32_t id = 100; id < 164; ++id)
    maybe += bits.may_hold(id) ? 1 : 0;
  CHECK(maybe == 5);  // 0 and 64 have the same bit
}
