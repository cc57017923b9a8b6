// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/core/base64.h"

#include "support/catch.h"
#include <string>

namespace cvmesh {

TEST_CASE("append_base64: the examples of RFC 4648, and all digits", "[core][unit]") {
  const auto encoded = [](const std::string& bytes) {
    std::string text = "=";  // what is there stays
    append_base64(bytes, text);
    return text;
  };
  CHECK(encoded("") == "=");
  CHECK(encoded("f") == "=Zg==");
  CHECK(encoded("fo") == "=Zm8=");
  CHECK(encoded("foo") == "=Zm9v");
  CHECK(encoded("foob") == "=Zm9vYg==");
  CHECK(encoded("fooba") == "=Zm9vYmE=");
  CHECK(encoded("foobar") == "=Zm9vYmFy");
  CHECK(encoded(std::string("\0\xff\xfe\xfb\xef\xbe", 6)) == "=AP/+++++");
}

}  // namespace cvmesh
