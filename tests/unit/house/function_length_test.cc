// SPDX-License-Identifier: Apache-2.0
// A function fits on one screen: at most 60 lines, head and closing brace included.
#include <gtest/gtest.h>

#include <map>
#include <set>
#include <string>
#include <string_view>
#include <vector>

#include "source_text.h"

namespace bendloop::house {
namespace {

constexpr int kMostLines = 60;

// "path: Name" of tables and lists of options, and why: they are read line by line and gain nothing
// from being cut.
const std::map<std::string, std::string> kTables = {
    {"drivers/simulated_bender/misbehaviour.cc: ParseMisbehaviour",
     "the words of a command and what each takes"},
    {"drivers/simulated_scanner/scanner_device.cc: ScannerDevice::DoMisbehave", "one case a fault"},
    {"firmware-host/cell/cell_status.cc: StatusJson", "the fields of /status, one a line"},
    {"firmware-host/cell/cell_status.cc: MetricsText", "the metrics, one after the other"},
};

// The same of what is to be cut still: a list that shrinks. What has become short must leave it.
const std::set<std::string> kToBeCut = {};

TEST(FunctionLength, IsOneScreen) {
  std::set<std::string> unused = kToBeCut;
  for (const auto& [key, why] : kTables) unused.insert(key);
  const std::set<std::string> may_be_longer = unused;
  std::size_t functions = 0;
  for (const SourceFile& file : ReadSources(
           BENDLOOP_SOURCE_DIR, {"hal", "pipeline", "drivers", "config", "firmware-host"})) {
    for (const Function& function : file.functions) {
      ++functions;
      if (function.lines <= kMostLines) continue;
      const std::string key = file.path + ": " + function.name;
      unused.erase(key);
      if (may_be_longer.contains(key)) continue;
      ADD_FAILURE() << file.path << ":" << function.line << ": " << function.name << " has "
                    << function.lines << " lines, at most " << kMostLines
                    << " are read at a glance: give its parts names of their own, or, if it is a "
                       "table or a list of options, say so in kTables of "
                    << __FILE__;
    }
  }
  EXPECT_GT(functions, 1000U) << "hardly any functions found below " << BENDLOOP_SOURCE_DIR;
  for (const std::string& key : unused) {
    ADD_FAILURE() << "\"" << key << "\" is short or gone by now: take it out of the lists in "
                  << __FILE__;
  }
}

std::string Names(std::string_view text) {
  std::string names;
  for (const Function& f : FunctionsOf(text)) {
    names += f.name + " " + std::to_string(f.line) + "+" + std::to_string(f.lines) + "; ";
  }
  return names;
}

TEST(FunctionLength, IsMeasuredFromHeadToBrace) {
  EXPECT_EQ(Names("int A() { return 1; }\n"), "A 1+1; ");
  EXPECT_EQ(Names("namespace n {\n\nstd::vector<int> B(\n    int x) {\n  if (x) {\n  }\n}\n}\n"),
            "B 3+5; ");
  EXPECT_EQ(
      Names("class C {\n public:\n  C() : a_{1}, b_(2) {\n  }\n private:\n  int a_ = {};\n};"),
      "C 3+2; ");
  EXPECT_EQ(Names("C::~C() {}\nbool C::operator==(const C& o) const {\n}\n"),
            "C::~C 1+1; C::operator== 2+2; ");
  EXPECT_EQ(Names("const std::map<int, int> kTable = {\n{1, 2},\n};\nint D() {\n}\n"), "D 4+2; ");
  EXPECT_EQ(Names("void E() {\n  const auto f = [](int a) {\n    return a;\n  };\n}\n"), "E 1+5; ");
}

TEST(FunctionLength, IsNotConfusedByTextAndComments) {
  EXPECT_EQ(Names("// }\nvoid A() {\n  f(\"{\");  // {\n  /* {\n*/\n}\nvoid B() {}\n"),
            "A 2+5; B 7+1; ");
  EXPECT_EQ(Names("void A() {\n  f(R\"x({{\n)x\", '{', '\\'', 1'000);\n}\n"), "A 1+4; ");
  EXPECT_EQ(Names("#define M(a) \\\n  { a\nvoid A() {}\n"), "A 3+1; ");
}

TEST(Includes, AreFoundWithTheirLines) {
  const auto includes = IncludesOf("#pragma once\n#include <map>\n#include \"hal/clock.h\"\n");
  ASSERT_EQ(includes.size(), 1U);
  EXPECT_EQ(includes[0].header, "hal/clock.h");
  EXPECT_EQ(includes[0].line, 3);
}

}  // namespace
}  // namespace bendloop::house
