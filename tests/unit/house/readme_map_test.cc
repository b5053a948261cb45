// SPDX-License-Identifier: Apache-2.0
// The maps in the READMEs are the tree: each folder has its row, and no row is of a folder that is
// gone.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <regex>
#include <set>
#include <sstream>
#include <string>

namespace bendloop::house {
namespace {

using testing::ElementsAre;

// Folders of the table's rows, before the row's sentence: `name/` or [name](name/README.md).
std::set<std::string> FoldersInMap(const std::string& readme) {
  static const std::regex kName(R"(`([a-z0-9_-]+)/`|\[([a-z0-9_-]+)\]\(\2/README\.md\))");
  std::set<std::string> names;
  std::istringstream lines(readme);
  for (std::string line; std::getline(lines, line);) {
    if (!line.starts_with("| ")) continue;
    // The name stands in the first column, or in the second one behind a floor's number.
    const std::size_t second = line.find(" | "), third = line.find(" | ", second + 1);
    const bool is_numbered = second == 3;
    const std::string head = line.substr(0, is_numbered ? third : second);
    for (std::sregex_iterator found(head.begin(), head.end(), kName), end; found != end; ++found) {
      names.insert((*found)[1].matched ? (*found)[1] : (*found)[2]);
    }
  }
  return names;
}

// Of ours: what somebody left there has neither file.
std::set<std::string> FoldersIn(const std::filesystem::path& folder) {
  std::set<std::string> names;
  for (const auto& entry : std::filesystem::directory_iterator(folder)) {
    if (exists(entry.path() / "CMakeLists.txt") || exists(entry.path() / "README.md")) {
      names.insert(entry.path().filename().string());
    }
  }
  return names;
}

std::string TextOf(const std::filesystem::path& path) {
  std::ostringstream text;
  text << std::ifstream(path).rdbuf();
  return text.str();
}

class ReadmeMap : public testing::TestWithParam<const char*> {};

TEST_P(ReadmeMap, IsTheTree) {
  const std::filesystem::path folder = std::filesystem::path(BENDLOOP_SOURCE_DIR) / GetParam();
  const auto shown = FoldersInMap(TextOf(folder / "README.md")), are = FoldersIn(folder);
  ASSERT_GT(are.size(), 5U) << folder;
  for (const std::string& name : are) {
    EXPECT_TRUE(shown.contains(name)) << folder / "README.md"
                                      << ": no row of " << name << "/";
  }
  for (const std::string& name : shown) {
    EXPECT_TRUE(is_directory(folder / name)) << folder / "README.md"
                                             << ": a row of " << name << "/, which is not there";
  }
}

INSTANTIATE_TEST_SUITE_P(, ReadmeMap,
                         testing::Values(".", "pipeline", "drivers", "firmware-host", "tests"),
                         [](const auto& folder) {
                           std::string name = folder.param;
                           if (name == ".") return std::string("Top");
                           return std::regex_replace(name, std::regex("-"), "_");
                         });

TEST(FoldersInMap, StandInTheFirstColumnOrBehindAFloorsNumber) {
  EXPECT_THAT(FoldersInMap("| folder | is |\n| --- | --- |\n| `a/`, `b-c/` | not `d/` |\n"
                           "| 3 | [e_f](e_f/README.md) | `g/` |\nbeside `h/`\n"),
              ElementsAre("a", "b-c", "e_f"));
}

}  // namespace
}  // namespace bendloop::house
