// SPDX-License-Identifier: Apache-2.0
#include "run_nominal.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <functional>
#include <sstream>

#include "firmware-host/cad/nominal_command.h"
#include "hal/bend_program.h"
#include "made_files.h"

namespace bendloop::test {

Outcome Nominal(const std::string& file, std::vector<std::string> words) {
  CLI::App app("test");
  app.name("bendloop");
  std::function<int()> run;
  std::ostringstream out, err;
  host::AddNominalCommand(app, run, out, err);
  const std::string toml = TemporaryFile("part.toml"), json = TemporaryFile("part.json");
  // Those of a run before are not this one's.
  for (const std::string& left : {toml, json}) std::filesystem::remove(left);
  words.insert(words.begin(), {"nominal", file, "--out", toml, "--json", json});
  std::reverse(words.begin(), words.end());  // as CLI11 takes them
  try {
    app.parse(words);
  } catch (const CLI::ParseError& error) {
    return {2, "", error.what(), {}, hal::Fail(hal::ErrorKind::kUsage, error.what())};
  }
  Outcome outcome;
  outcome.code = run();
  outcome.out = out.str();
  outcome.err = err.str();
  if (outcome.code == 0) {
    outcome.part = config::LoadPart(toml);
    // A list writes none.
    if (std::ifstream in(json); in) outcome.json = nlohmann::json::parse(in);
  }
  return outcome;
}

hal::Tube DemoTube() {
  hal::Tube tube;
  tube.pipe_radius_mm = 5;
  tube.program = {{{60, 0, 45, 20.0},
                   {40, 70, 90, 20.0},
                   {0, 180, 30, 25.0},
                   {80, -155, 100, 20.0},
                   {50, 0, 0, std::nullopt}}};
  return tube;
}

void ExpectRows(const Outcome& outcome, const hal::BendProgram& expected, double tolerance) {
  ASSERT_EQ(outcome.code, 0) << outcome.err;
  ASSERT_TRUE(outcome.part) << outcome.part.error().message;
  const auto& rows = outcome.part->rows.rows;
  ASSERT_EQ(rows.size(), expected.rows.size()) << outcome.out;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    SCOPED_TRACE(i);
    EXPECT_NEAR(rows[i].length_mm, expected.rows[i].length_mm, tolerance);
    EXPECT_NEAR(hal::WrapRotationDeg(rows[i].rotation_deg - expected.rows[i].rotation_deg), 0,
                tolerance);
    EXPECT_NEAR(rows[i].angle_deg, expected.rows[i].angle_deg, tolerance);
    EXPECT_NEAR(rows[i].bend_radius_mm.value_or(0), expected.rows[i].bend_radius_mm.value_or(0),
                tolerance);
  }
}

}  // namespace bendloop::test
