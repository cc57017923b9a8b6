// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/core/utf8.h"

#include "support/catch.h"
#include <string>

using namespace cvmesh;

TEST_CASE("is_utf8: the least and the largest character of each length", "[core][unit]") {
  for (const char* text : {"", "a", "\x7F", "\xC2\x80", "\xDF\xBF", "\xE0\xA0\x80", "\xED\x9F\xBF",
                           "\xEE\x80\x80", "\xEF\xBF\xBF", "\xF0\x90\x80\x80", "\xF4\x8F\xBF\xBF",
                           "kn\xC3\xB6"
                           "chern, \xE9\xAA\xA8"})
    CHECK(is_utf8(text));
  CHECK(is_utf8(std::string(2, '\0')));
}

TEST_CASE("is_utf8: stray, missing, overlong and forbidden bytes", "[core][unit]") {
  for (const char* text :
       {"kn\xF6"
        "chern",
        "\x80", "\xC3", "\xC3(", "\xE9\xAA",
        "\xE9\xAA"
        "a",
        "\xC0\x80", "\xC1\xBF", "\xE0\x9F\xBF", "\xF0\x8F\xBF\xBF", "\xED\xA0\x80", "\xED\xBF\xBF",
        "\xF4\x90\x80\x80", "\xF8\x88\x80\x80\x80", "\xFE", "\xFF"})
    CHECK_FALSE(is_utf8(text));
}
