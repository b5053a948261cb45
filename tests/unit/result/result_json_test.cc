// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/result/result_json.h"

#include <gmock/gmock.h>

#include <limits>
#include <random>

#include "tests/support/sample_run.h"

namespace bendloop::host {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

RunResult Sample() {
  RunResult result;
  result.part = "brake-line";
  result.session = "s-0001";
  result.time = "2024-05-06T07:08:09Z";
  result.software = "bendloop 0.1.0";
  pipeline::Measurement& m = result.measurement;
  m.tube.pipe_radius_mm = 4.00000012;
  m.tube.program.rows = {
      {42.1, 0, 35.2, 12.0}, {0, -90.1234567, 190.5, 12.0}, {30, -0.0, -1e-9, std::nullopt}};
  m.tube.X_WT.position_mm = {1, -2.5, 1.0 / 3};
  m.tube.X_WT.orientation = Eigen::Quaterniond(-0.5, 0.5, 0.5, -0.5);
  m.sigma.rows = {{0.02, 7, 0.01, 0.05}, {0.03, 0.02, 0.012, 0.06}, {0.04, 0.3, 0.2, std::nullopt}};
  m.pipe_radius_sigma_mm = 0.001;
  m.noise_mm = 0.05;
  m.coverage = 0.97;
  m.longest_gap_mm = 8;
  m.fit = {12000, 34, 0.03, 0.05, 0.1};
  m.bend_shapes = {{2.5, 0.1, 0.04, 0.002}, {0.2, 0.1, -0.01, 0.002}};
  m.straights = {{0.12, 0.01, 80}, {0, 0, 0}, {0.3, 0.02, 60}};
  m.bend_easings = {{8, 0.5}, {7.5, 0.25}};
  m.easing = {{5.3125, 4.6875}, 1.625, {0.375, -0.25}};
  m.dents = {{40, -90, 0.5, 0.02, 6, {1, 2, 3}, 0.1, 0.9, 28.3, 0.7}};
  m.seam = {72.5, 0.25, 0.125, 0.0625, 1.5};
  m.wrinkles = {{1, 0.25, 0.0625, {0, 0, 0}}};
  m.first_end = {2, 1, 0, 3, 0.1, 0, 0, {{0.2, 5.4, 0.01}, {4.8, 4, 0.02}}};
  m.last_end = {12.5, 3, 40, 0, 0, 0, 0, {}};
  m.passes = {{6000, {0.02, -0.01, 0}, {0, 0, 0.01}}, {6000, {0, 0, 0}, {0, 0, 0}}};
  m.structure_margin = 163.5;
  m.halves_differ_sigma = 1.75;
  m.spine = {{{0, 0, 0}, 4}, {{1, 0, 0}, 4.1}};
  m.warnings = {"the clamp hides 8 mm of row 2"};
  m.timing = {{"projection", 1.23456}, {"fit", 4}, {"projection", 1}, {"total", 7}};
  return result;
}

// A run whose values are hardly told apart.
RunResult VagueRun() {
  using Kind = pipeline::RowValueKind;
  RunResult run = SampleRun();
  run.measurement.joint.correlations = {{{1, Kind::kRotation}, {2, Kind::kRotation}, -0.98765},
                                        {{1, Kind::kBendRadius}, {2, Kind::kLength}, -0.95}};
  run.measurement.joint.known_together = {{.first_bend = 1,
                                           .last_bend = 1,
                                           .values = {{1, Kind::kRotation}, {2, Kind::kRotation}},
                                           .direction_sigma_deg = 0.03,
                                           .plane_sigma_deg = 0.05}};
  return run;
}

std::vector<std::string> Keys(const Json& json) {
  std::vector<std::string> keys;
  for (const auto& item : json.items()) keys.push_back(item.key());
  return keys;
}

TEST(ResultJson, WhatNobodyLookedForIsNullAndNotNone) {
  RunResult canal = Sample();
  canal.measurement.joint.is_known = false;
  canal.measurement.structure_margin = canal.measurement.halves_differ_sigma = kNan;
  const std::string text = WriteResultJson(canal);
  const Json json = Json::parse(text);
  EXPECT_TRUE(json["uncertainty_1sigma"]["correlations"].is_null());
  EXPECT_TRUE(json["uncertainty_1sigma"]["known_together"].is_null());
  EXPECT_TRUE(json["fit"]["structure_margin"].is_null());
  EXPECT_TRUE(json["fit"]["halves_differ_sigma"].is_null());
  const auto read = ReadResultJson(text, "canal");
  ASSERT_TRUE(read) << read.error().message;
  EXPECT_EQ(WriteResultJson(*read), text);
}

TEST(ResultJson, EdgesOfEndsComeBack) {
  RunResult run = Sample();
  pipeline::TubeFeaturesFound& features = run.measurement.features;
  features.is_known = true;
  pipeline::EndCutFound& first = features.first_end.emplace();
  first.cut = {3, 40};
  first.bevel = {1.25, 0.03, 0.75, 0.02, 31.0, 0.2};
  pipeline::EndCutFound& last = features.last_end.emplace();
  last.burr = {0.3, 0.01, -52.5, 0.5};
  last.border = {{0, 0.5, 0.02}, {180, -0.5, 0.02}};
  const std::string text = WriteResultJson(run);
  const Json json = Json::parse(text);
  EXPECT_EQ(json["features"]["first_end"]["bevel"]["depth_mm"], 0.75);
  EXPECT_FALSE(json["features"]["first_end"].contains("burr"));
  EXPECT_EQ(json["features"]["last_end"]["burr"]["around_deg"], -52.5);
  EXPECT_EQ(json["features"]["last_end"]["border"][1]["beyond_plane_mm"], -0.5);
  const auto read = ReadResultJson(text, "edges");
  ASSERT_TRUE(read) << read.error().message;
  EXPECT_EQ(WriteResultJson(*read), text);
}

TEST(ResultJson, TellsWhatAnOpeningIsAndWhatItShouldBe) {
  RunResult run = VagueRun();
  pipeline::OpeningInspection& opening = run.inspection->features.openings.emplace_back();
  opening.name = "hole 1";
  opening.state = pipeline::OpeningState::kFound;
  opening.found_as = pipeline::OpeningKind::kSlot;
  opening.out_of_round_mm = {0, 7.25, 7.25, 0.05, 0.3, pipeline::ToleranceState::kOut};
  opening.lean_deg.measured = 12.5;
  const std::string text = WriteResultJson(run);
  const Json json = Json::parse(text)["inspection"]["features"]["openings"][0];
  EXPECT_EQ(json["kind"], "hole");
  EXPECT_EQ(json["found_kind"], "slot");
  EXPECT_EQ(json["out_of_round_mm"]["state"], "out");
  const auto read = ReadResultJson(text, "kinds");
  ASSERT_TRUE(read) << read.error().message;
  EXPECT_EQ(WriteResultJson(*read), text);
  // Results of before that have no kinds.
  Json old = Json::parse(text);
  for (const char* key : {"kind", "found_kind", "out_of_round_mm", "lean_deg"}) {
    old["inspection"]["features"]["openings"][0].erase(key);
  }
  EXPECT_TRUE(ReadResultJson(old.dump(), "old"));
}

TEST(ResultJson, HasTheKeysOfTheSchemaInOrder) {
  const Json json = ResultJson(Sample(), {.spine = true});
  EXPECT_THAT(Keys(json), ElementsAre("schema", "part", "session", "time", "software", "tube",
                                      "uncertainty_1sigma", "fit", "bend_shapes", "form",
                                      "warnings", "spine", "timing_ms"));
  EXPECT_EQ(json["schema"], "bendloop.result/1");
  EXPECT_THAT(Keys(json["tube"]),
              ElementsAre("pipe_radius_mm", "rows", "position_mm", "orientation_wxyz"));
  for (const auto& rows : {json["tube"]["rows"], json["uncertainty_1sigma"]["rows"]}) {
    ASSERT_EQ(rows.size(), 3u);
    for (const auto& row : rows) {
      EXPECT_THAT(Keys(row),
                  ElementsAre("length_mm", "rotation_deg", "angle_deg", "bend_radius_mm"));
    }
    EXPECT_TRUE(rows[2]["bend_radius_mm"].is_null());
    EXPECT_EQ(rows[0]["rotation_deg"], 0.0);
  }
  EXPECT_THAT(Keys(json["fit"]), testing::Contains("median_abs_distance_mm").Times(1));
  EXPECT_THAT(Keys(json["spine"][1]), ElementsAre("position_mm", "pipe_radius_mm"));
  EXPECT_EQ(json["tube"]["rows"][1]["rotation_deg"].dump(), "-90.123457");
  EXPECT_EQ(json["tube"]["orientation_wxyz"].dump(), "[0.5,-0.5,-0.5,0.5]");
}

TEST(ResultJson, TimingIsTheLastKeyAndSumsRepeatedStages) {
  const Json json = ResultJson(Sample());
  EXPECT_EQ(Keys(json).back(), "timing_ms");
  EXPECT_EQ(json["timing_ms"].dump(), R"({"projection":2.235,"fit":4.0,"total":7.0})");
  RunResult no_total = Sample();
  no_total.measurement.timing.pop_back();
  EXPECT_EQ(ResultJson(no_total)["timing_ms"]["total"], 6.235);
  EXPECT_FALSE(ResultJson(Sample(), {.timing = false}).contains("timing_ms"));
}

TEST(ResultJson, WithoutTimingTheBytesDoNotDependOnIt) {
  RunResult a = Sample(), b = Sample();
  b.measurement.timing = {{"other", 1e9}};
  b.measurement.tube.X_WT.orientation.coeffs() *= -1;
  EXPECT_EQ(WriteResultJson(a, {.timing = false}), WriteResultJson(b, {.timing = false}));
}

TEST(ResultJson, HasNoMinusZeroAndNoNotANumber) {
  RunResult result = Sample();
  result.measurement.tube.program.rows[1].length_mm = -1e-12;
  result.measurement.sigma.rows[1].length_mm = kNan;
  result.measurement.noise_mm = std::numeric_limits<double>::infinity();
  result.measurement.timing.push_back({"broken", kNan});
  const std::string text = WriteResultJson(result);
  EXPECT_THAT(text, testing::Not(HasSubstr("-0.0,")));
  EXPECT_THAT(text, testing::Not(HasSubstr("nan")));
  const Json json = Json::parse(text);
  EXPECT_TRUE(json["uncertainty_1sigma"]["rows"][1]["length_mm"].is_null());
  EXPECT_TRUE(json["fit"]["noise_mm"].is_null());
}

TEST(ResultJson, UncertaintyKeepsTheShapeOfTheTube) {
  RunResult result = Sample();
  result.measurement.sigma.rows.clear();
  const Json rows = ResultJson(result)["uncertainty_1sigma"]["rows"];
  ASSERT_EQ(rows.size(), 3u);
  EXPECT_TRUE(rows[1]["length_mm"].is_null());
  EXPECT_EQ(rows[0]["rotation_deg"], 0.0);
}

TEST(ResultJson, BytesThatAreNotUtf8DoNotThrow) {
  RunResult result = Sample();
  result.part = "\xff\xfe</script>";
  EXPECT_THAT(WriteResultJson(result), HasSubstr("\xEF\xBF\xBD"));
}

TEST(ResultJson, ReadingGivesTheSameBytesBack) {
  std::mt19937 random(20240506);
  std::uniform_real_distribution<double> value(-200, 200);
  for (int round = 0; round < 100; ++round) {
    SCOPED_TRACE(round);
    RunResult result = Sample();
    for (auto* program : {&result.measurement.tube.program, &result.measurement.sigma}) {
      program->rows.clear();
      for (int i = 0; i <= round % 7; ++i) {
        program->rows.push_back({value(random), value(random), value(random), value(random)});
      }
      program->rows.back().bend_radius_mm.reset();
    }
    result.measurement.tube.X_WT.orientation =
        Eigen::Quaterniond(value(random), value(random), value(random), value(random)).normalized();
    const std::string text = WriteResultJson(result, {.spine = true});
    const auto read = ReadResultJson(text, "a.json");
    ASSERT_TRUE(read) << read.error().message;
    EXPECT_EQ(WriteResultJson(*read, {.spine = true}), text);
  }
}

TEST(ResultJson, AWholeCellRunReadsBackToTheSameBytes) {
  RunResult run = VagueRun();
  run.interlocks->checks[0].passed = false;
  run.correction->rows[1].angle_deg.flags = pipeline::kFlagDeadband | pipeline::kFlagUnexpected;
  run.correction->refusals = {"too far from the base program"};
  const std::string text = WriteResultJson(run);
  const auto read = ReadResultJson(text, "a.json");
  ASSERT_TRUE(read) << read.error().message;
  EXPECT_EQ(WriteResultJson(*read), text);

  const Json json = Json::parse(text);
  const Json& sigma = json["uncertainty_1sigma"];
  EXPECT_EQ(sigma["correlations"][0].dump(),
            R"({"first":{"row":1,"value":"rotation_deg"},)"
            R"("second":{"row":2,"value":"rotation_deg"},"coefficient":-0.9877})");
  EXPECT_EQ(sigma["known_together"][0]["values"].size(), 2u);
  EXPECT_EQ(sigma["known_together"][0]["plane_sigma_deg"], 0.05);
  EXPECT_TRUE(sigma["known_together"][0]["length_mm"].is_null());
  EXPECT_EQ(json["inspection"]["verdict"], "fail");
  EXPECT_EQ(json["inspection"]["rows"][1]["angle_deg"]["state"], "out");
  EXPECT_EQ(json["inspection"]["rows"][4]["bend_radius_mm"], nullptr);
  EXPECT_EQ(json["correction"]["rows"][1]["angle_deg"]["flags"].dump(),
            R"(["deadband","unexpected"])");
  EXPECT_TRUE(json["correction"]["refused"].get<bool>());
  EXPECT_FALSE(json["interlocks"]["passed"].get<bool>());
  EXPECT_EQ(json["bender"]["outcome"], "committed");
  EXPECT_EQ(Keys(json).back(), "timing_ms");
}

TEST(ReadResultJson, EveryCutIsAnErrorAndNoCrash) {
  const std::string text = WriteResultJson(SampleRun());
  for (std::size_t size = 0; size + 2 < text.size(); size += 97) {
    EXPECT_FALSE(ReadResultJson(std::string_view(text).substr(0, size), "a.json")) << size;
  }
}

// Takes every leaf and branch in turn and puts something of another type there.
void Spoil(const Json& whole, const Json::json_pointer& at, const Json& value) {
  for (const Json& wrong :
       {Json("x"), Json(true), Json::array({1}), Json::object(), Json(nullptr)}) {
    Json spoilt = whole;
    spoilt[at] = wrong;
    const auto read = ReadResultJson(spoilt.dump(), "a.json");
    if (!read) {
      EXPECT_THAT(read.error().message, testing::StartsWith("a.json"));
    }
  }
  if (value.is_object()) {
    for (const auto& item : value.items()) Spoil(whole, at / item.key(), item.value());
  } else if (value.is_array() && !value.empty()) {
    Spoil(whole, at / (value.size() - 1), value.back());
  }
}

TEST(ReadResultJson, AFailedScanSaysWhyThereIsNoResult) {
  const auto failed = ReadResultJson(
      R"({"schema": "bendloop.failed-scan/1", "error": "12 profiles"})", "part-0003.json");
  ASSERT_FALSE(failed);
  EXPECT_EQ(failed.error().message,
            "part-0003.json: a scan that led to no measurement: 12 profiles");
}

TEST(ReadResultJson, ANumberBeyondTheRangeIsAnErrorAndNoCrash) {
  const auto result = ReadResultJson(R"({"schema": 1e999})", "result.json");
  ASSERT_FALSE(result);
  EXPECT_EQ(result.error().kind, hal::ErrorKind::kBadInput);
}

TEST(ReadResultJson, AnyValueMayBeOfAnyType) {
  const Json whole = ResultJson(VagueRun());
  for (const auto& item : whole.items()) {
    Spoil(whole, Json::json_pointer() / item.key(), item.value());
  }
}

struct Wrong {
  const char* pointer;
  Json value;
  const char* message;
};

TEST(ReadResultJson, SaysWhereAndWhatWasExpected) {
  const std::vector<Wrong> cases = {
      {"/schema", "bendloop.result/2", "a.json/schema: found \"bendloop.result/2\""},
      {"/tube/rows/1/angle_deg", "ninety", "a.json/tube/rows/1/angle_deg: found string, expected"},
      {"/tube/rows", 3, "a.json/tube/rows: found number, expected an array"},
      {"/tube", Json::object(), "key \"pipe_radius_mm\" is missing"},
      {"/tube/position_mm", {1, 2}, "a.json/tube/position_mm: found array, expected three"},
      {"/tube/orientation_wxyz", {0, 0, 0, 0}, "expected a unit quaternion"},
      {"/uncertainty_1sigma/rows", Json::array(), "as many rows as tube/rows"},
      {"/fit/samples", -1, "a.json/fit/samples: found number, expected a whole number"},
      {"/warnings", {1}, "a.json/warnings/0: found number, expected a string"},
      {"/timing_ms", 4, "a.json/timing_ms: found number"},
  };
  for (const Wrong& wrong : cases) {
    SCOPED_TRACE(wrong.pointer);
    Json json = ResultJson(Sample());
    json[Json::json_pointer(wrong.pointer)] = wrong.value;
    const auto read = ReadResultJson(json.dump(), "a.json");
    ASSERT_FALSE(read);
    EXPECT_EQ(read.error().kind, hal::ErrorKind::kBadInput);
    EXPECT_THAT(read.error().message, HasSubstr(wrong.message));
    EXPECT_THAT(read.error().message, testing::Not(HasSubstr("\n")));
  }
  Json json = ResultJson(VagueRun());
  json["uncertainty_1sigma"]["known_together"][0]["last_bend"] = 99;
  const auto beyond = ReadResultJson(json.dump(), "a.json");
  ASSERT_FALSE(beyond);
  EXPECT_THAT(beyond.error().message, HasSubstr("last_bend: found number, expected a row"));
  const auto cut = ReadResultJson(WriteResultJson(Sample()).substr(0, 100), "a.json");
  ASSERT_FALSE(cut);
  EXPECT_THAT(cut.error().message, HasSubstr("a.json: byte 101: not JSON"));
}

}  // namespace
}  // namespace bendloop::host
