// SPDX-License-Identifier: AGPL-3.0-or-later
#include "cvmesh/io/json_io.h"

#include "cvmesh/io/atomic_file.h"

#include <nlohmann/json.hpp>

#include <cerrno>
#include <cstdio>
#include <memory>
#include <set>
#include <string>
#include <system_error>
#include <vector>

namespace cvmesh {
namespace {

constexpr std::size_t kMaxBytes = std::size_t{64} << 20;  // far above any parameter file or report
constexpr int kMaxDepth = 200;

std::string read_text(const std::filesystem::path& path,
                      ErrorCode error,
                      const std::string& stage) {
  const auto refuse = [&](const std::string& why) {
    throw Error(error, stage, "'" + path.string() + "' " + why);
  };
  std::error_code code;
  if (!std::filesystem::exists(path, code)) refuse("does not exist; check the path");
  if (!std::filesystem::is_regular_file(path, code)) refuse("is not a file; give a JSON file");
  const std::unique_ptr<std::FILE, int (*)(std::FILE*)> file(std::fopen(path.c_str(), "rbe"),
                                                             &std::fclose);
  if (!file) refuse("cannot be read: " + std::generic_category().message(errno));
  std::string text;
  std::vector<char> block(std::size_t{1} << 16);
  while (const std::size_t count = std::fread(block.data(), 1, block.size(), file.get())) {
    text.append(block.data(), count);
    if (text.size() > kMaxBytes)
      refuse("is larger than 64 MiB; that is no parameter file and no report");
  }
  if (std::ferror(file.get())) refuse("cannot be read: " + std::generic_category().message(errno));
  return text;
}

std::string place(const std::string& text, std::size_t byte) {
  std::size_t line = 1, column = 1;
  for (std::size_t i = 0; i + 1 < byte && i < text.size(); ++i) {
    ++column;
    if (text[i] == '\n') {
      ++line;
      column = 1;
    }
  }
  return "line " + std::to_string(line) + ", column " + std::to_string(column);
}

}  // namespace

void write_json(const std::filesystem::path& path, const nlohmann::ordered_json& value) {
  AtomicFile file(path);
  file.write(value.dump(2, ' ', false, nlohmann::ordered_json::error_handler_t::replace));
  file.write("\n");
  file.commit();
}

nlohmann::ordered_json read_json(const std::filesystem::path& path,
                                 ErrorCode code,
                                 const std::string& stage) {
  const std::string text = read_text(path, code, stage);
  // The parser keeps the last of two equal keys without a word; a user would wonder which counts.
  std::vector<std::set<std::string>> keys;
  using Event = nlohmann::ordered_json::parse_event_t;
  const auto watch = [&](int depth, Event event, nlohmann::ordered_json& parsed) {
    require(depth <= kMaxDepth, code, stage,
            "'" + path.string() + "' is nested deeper than " + std::to_string(kMaxDepth) +
                " levels; that is no parameter file and no report");
    if (event == Event::object_start) keys.emplace_back();
    if (event == Event::object_end) keys.pop_back();
    if (event == Event::key) {
      const auto key = parsed.get<std::string>();
      require(keys.back().insert(key).second, code, stage,
              "'" + path.string() + "' names the key \"" + key +
                  "\" twice in one object; remove one of the two");
    }
    return true;
  };
  try {
    return nlohmann::ordered_json::parse(text, watch);
  } catch (const nlohmann::ordered_json::parse_error& error) {
    // "[json.exception.parse_error.101] parse error at line 1, column 2: what": keep the what.
    std::string what = error.what();
    const std::size_t colon = what.find(": ");
    if (colon != std::string::npos) what.erase(0, colon + 2);
    throw Error(
        code, stage,
        "'" + path.string() + "' is no valid JSON at " + place(text, error.byte) + ": " + what);
  }
}

}  // namespace cvmesh
