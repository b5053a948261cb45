// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

namespace bendloop::house {

// Lines are counted from 1.
struct Include {
  std::string header;  // as written between the quotation marks
  int line = 0;
};

struct Function {
  std::string name;  // Class::Name as written
  int line = 0;      // of its first line, the return type included
  int lines = 0;     // to its closing brace
};

struct SourceFile {
  std::string path;  // from the root of the sources, with slashes
  std::vector<Include> includes;
  std::vector<Function> functions;
};

// Includes in quotation marks, which are ours.
std::vector<Include> IncludesOf(std::string_view text);
// Definitions outside of functions; a lambda counts to the function around it. Enough for sources
// in clang-format's layout: no macro opens or closes a brace.
std::vector<Function> FunctionsOf(std::string_view text);

// All *.h and *.cc below the folders of the root, sorted by path.
std::vector<SourceFile> ReadSources(const std::filesystem::path& root,
                                    const std::vector<std::string>& folders);

}  // namespace bendloop::house
