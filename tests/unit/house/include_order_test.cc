// SPDX-License-Identifier: Apache-2.0
// Who may include whom: floors of the house, rooms of the pipeline, and no circles anywhere.
#include <gtest/gtest.h>

#include <map>
#include <set>
#include <string>
#include <string_view>
#include <vector>

#include "source_text.h"

namespace bendloop::house {
namespace {

// What a floor may include besides itself.
const std::map<std::string, std::set<std::string>> kFloors = {
    {"hal", {}},
    {"pipeline", {"hal"}},
    {"drivers", {"hal"}},
    {"config", {"hal"}},
    {"firmware-host", {"hal", "pipeline", "drivers", "config"}},
};

// Rooms of the pipeline, from below. A room includes those of lower floors; `tube` may use `math`
// beside it. The doors are the headers of pipeline/ itself.
const std::map<std::string, int> kRooms = {
    {"math", 0},      {"tube", 1},  {"points", 2},     {"inspection", 2},
    {"spine", 3},     {"fit", 3},   {"correction", 3}, {"spline", 4},
    {"structure", 5}, {"canal", 6}, {"features", 7},   {"", 8},
};

std::string FolderOf(const std::string& path) {
  const std::size_t slash = path.rfind('/');
  return slash == std::string::npos ? "" : path.substr(0, slash);
}

std::string FloorOf(const std::string& path) { return path.substr(0, path.find('/')); }

// "" for the doors.
std::string RoomOf(const std::string& path) {
  const std::string folder = FolderOf(path);
  return folder == "pipeline" ? "" : folder.substr(std::string_view("pipeline/").size());
}

std::string Place(const SourceFile& file, const Include& include) {
  return file.path + ":" + std::to_string(include.line) + ": includes \"" + include.header + "\"";
}

// Empty: the include is right.
std::string WhatIsWrong(const SourceFile& file, const Include& include) {
  const std::string from = FloorOf(file.path), to = FloorOf(include.header);
  if (!kFloors.contains(to)) {
    return "which is on no floor: write the path from the root of the sources, and a floor's name "
           "(hal, pipeline, drivers, config, firmware-host) first";
  }
  if (from != to) {
    if (kFloors.at(from).contains(to)) return "";
    return from + " must not know " + to +
           ": put what both need into hal, or hand it in through an interface of hal";
  }
  if (from != "pipeline") return "";
  const std::string room = RoomOf(file.path), other = RoomOf(include.header);
  for (const std::string& name : {room, other}) {
    if (!kRooms.contains(name)) {
      return "and room \"" + name + "\" has no place in the order: give it one in " __FILE__;
    }
  }
  if (room == other || kRooms.at(other) < kRooms.at(room)) return "";
  return "room \"" + room + "\" stands beside or below \"" + other +
         "\": move what both need into a lower room (pipeline/README.md has the map)";
}

using Graph = std::map<std::string, std::set<std::string>>;

// The first circle found, as "a -> b -> a"; empty: there is none.
std::string CircleIn(const Graph& graph) {
  enum class State { kNew, kOpen, kDone };
  std::map<std::string, State> states;
  std::vector<std::string> way;
  std::string circle;
  const auto visit = [&](const auto& self, const std::string& name) -> void {
    states[name] = State::kOpen;
    way.push_back(name);
    if (const auto found = graph.find(name); found != graph.end()) {
      for (const std::string& next : found->second) {
        if (!circle.empty()) return;
        if (states[next] == State::kNew) {
          self(self, next);
        } else if (states[next] == State::kOpen) {
          std::size_t i = way.size();
          while (way[i - 1] != next) --i;
          for (; i <= way.size(); ++i) circle += way[i - 1] + " -> ";
          circle += next;
          return;
        }
      }
    }
    way.pop_back();
    states[name] = State::kDone;
  };
  for (const auto& [name, to] : graph) {
    if (states[name] == State::kNew && circle.empty()) visit(visit, name);
  }
  return circle;
}

const std::vector<SourceFile>& Product() {
  static const std::vector<SourceFile> files =
      ReadSources(BENDLOOP_SOURCE_DIR, {"hal", "pipeline", "drivers", "config", "firmware-host"});
  return files;
}

TEST(IncludeOrder, GoesDownTheFloorsAndRooms) {
  ASSERT_GT(Product().size(), 100U) << "hardly any sources below " << BENDLOOP_SOURCE_DIR;
  for (const SourceFile& file : Product()) {
    for (const Include& include : file.includes) {
      const std::string wrong = WhatIsWrong(file, include);
      EXPECT_EQ(wrong, "") << Place(file, include) << ", " << wrong;
    }
  }
}

TEST(IncludeOrder, HasNoCircleOfHeaders) {
  Graph headers;
  for (const SourceFile& file : Product()) {
    for (const Include& include : file.includes) headers[file.path].insert(include.header);
  }
  EXPECT_EQ(CircleIn(headers), "") << "break it where one of these needs a name only: declare it";
}

TEST(IncludeOrder, HasNoCircleOfFolders) {
  Graph folders;
  for (const SourceFile& file : Product()) {
    for (const Include& include : file.includes) {
      const std::string from = FolderOf(file.path), to = FolderOf(include.header);
      if (from != to) folders[from].insert(to);
    }
  }
  EXPECT_EQ(CircleIn(folders), "") << "move what both need into one folder below both";
}

// What the tests above would say of sources that break the order.
TEST(IncludeOrder, IsToldFromDisorder) {
  const auto wrong = [](const std::string& path, const std::string& header) {
    return WhatIsWrong({path, {}, {}}, {header, 1});
  };
  EXPECT_EQ(wrong("pipeline/fit/a.cc", "pipeline/points/b.h"), "");
  EXPECT_EQ(wrong("pipeline/tube/a.cc", "pipeline/math/b.h"), "");
  EXPECT_EQ(wrong("pipeline/tube_model.cc", "pipeline/canal/b.h"), "");
  EXPECT_EQ(wrong("firmware-host/cell/a.cc", "drivers/session/b.h"), "");
  EXPECT_NE(wrong("pipeline/math/a.cc", "pipeline/tube/b.h"), "");
  EXPECT_NE(wrong("pipeline/fit/a.cc", "pipeline/spine/b.h"), "");
  EXPECT_NE(wrong("pipeline/spine/a.cc", "pipeline/spline/b.h"), "");
  EXPECT_NE(wrong("pipeline/canal/a.cc", "pipeline/reconstruction.h"), "");
  EXPECT_NE(wrong("pipeline/attic/a.cc", "pipeline/math/b.h"), "");
  EXPECT_NE(wrong("pipeline/fit/a.cc", "drivers/session/b.h"), "");
  EXPECT_NE(wrong("drivers/session/a.cc", "pipeline/reconstruction.h"), "");
  EXPECT_NE(wrong("hal/a.h", "config/cell.h"), "");
  EXPECT_NE(wrong("config/a.h", "tests/support/b.h"), "");
  EXPECT_EQ(CircleIn({{"a", {"b"}}, {"b", {"c"}}}), "");
  EXPECT_EQ(CircleIn({{"a", {"b"}}, {"b", {"c"}}, {"c", {"b"}}}), "b -> c -> b");
}

}  // namespace
}  // namespace bendloop::house
