// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/convert/convert_command.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <sstream>
#include <string>
#include <vector>

#include "firmware-host/result/result_json.h"
#include "pipeline/tube/representations.h"

namespace bendloop::host {
namespace {

using ::testing::HasSubstr;
using ::testing::StartsWith;

struct Outcome {
  int code = -1;
  std::string out, err;
};

Outcome Convert(std::vector<std::string> words, const std::string& input) {
  CLI::App app("test");
  app.name("bendloop");
  std::function<int()> run;
  std::istringstream in(input);
  std::ostringstream out, err;
  AddConvertCommand(app, run, in, out, err);
  words.insert(words.begin(), "convert");
  std::reverse(words.begin(), words.end());  // as CLI11 takes them
  try {
    app.parse(words);
  } catch (const CLI::ParseError& error) {
    return {2, "", error.what()};
  }
  const int code = run ? run() : 2;
  return {code, out.str(), err.str()};
}

constexpr const char* kCadPoints =
    "X Y Z\n0 0 0\n0 0 1495.39\n0 10100 1495.39\n0 10100 3989.39\n5718.30 10136.89 3989.39\n";

// The report of a CAD system that the points and this table come from: L 935.39, 8980.00, 1374.00,
// 5158.42; R 180.00, 90.37; A 90.
TEST(Convert, WritesTheLraOfTheCadReport) {
  const auto done = Convert({"--to", "lra", "--bend-radius", "560", "--decimals", "2"}, kCadPoints);
  EXPECT_EQ(done.code, 0) << done.err;
  EXPECT_EQ(done.out,
            "length_mm  rotation_deg  angle_deg  bend_radius_mm\n"
            "---------  ------------  ---------  --------------\n"
            "   935.39          0.00      90.00          560.00\n"
            "  8980.00        180.00      90.00          560.00\n"
            "  1374.00         90.37      90.00          560.00\n"
            "  5158.42          0.00       0.00            -\n");
}

TEST(Convert, WritesCsv) {
  const auto done = Convert({"--to", "ybc", "--format", "csv", "--bend-radius", "560", "--rotation",
                             "cumulative", "--rotation-sign", "-1", "--decimals", "1"},
                            kCadPoints);
  EXPECT_EQ(done.out,
            "y_mm,b_deg,c_deg,bend_radius_mm\n"
            "935.4,0.0,90.0,560.0\n"
            "8980.0,180.0,90.0,560.0\n"
            "1374.0,89.6,90.0,560.0\n"
            "5158.4,89.6,0.0,\n")
      << done.err;
}

TEST(Convert, ComesBackFromEveryKindInEveryFormat) {
  const auto pose =
      Convert({"--to", "pose", "--format", "json", "--bend-radius", "560"}, kCadPoints);
  ASSERT_EQ(pose.code, 0) << pose.err;
  const auto points = Convert({"--to", "xyz", "--decimals", "3"}, pose.out);
  EXPECT_THAT(points.out, HasSubstr("5718.300  10136.890  3989.390"));
  for (const std::string format : {"text", "csv", "json"}) {
    for (const std::string kind : {"xyz", "pose", "lra", "ybc"}) {
      for (const std::string length : {"incremental", "cumulative", "straights"}) {
        SCOPED_TRACE(kind + " " + format + " " + length);
        const auto there =
            Convert({"--to", kind, "--format", format, "--length", length, "--rotation",
                     "cumulative", "--rotation-sign", "-1", "--decimals", "9"},
                    pose.out);
        ASSERT_EQ(there.code, 0) << there.err;
        const auto back = Convert({"--to", "lra", "--length", length, "--rotation", "cumulative",
                                   "--rotation-sign", "-1"},
                                  there.out);
        ASSERT_EQ(back.code, 0) << back.err << there.out;
        EXPECT_EQ(back.out, Convert({"--to", "lra"}, pose.out).out);
      }
    }
    const auto there = Convert({"--to", "pose", "--format", format, "--decimals", "9"}, pose.out);
    EXPECT_EQ(Convert({"--to", "xyz", "--decimals", "3"}, there.out).out, points.out) << there.out;
  }
}

TEST(Convert, ReversesTwiceToTheSame) {
  const auto once = Convert({"--to", "lra", "--bend-radius", "560", "--reverse"}, kCadPoints);
  EXPECT_THAT(once.out, HasSubstr("\n5158.4190  "));
  EXPECT_EQ(Convert({"--to", "lra", "--reverse"}, once.out).out,
            Convert({"--to", "lra", "--bend-radius", "560"}, kCadPoints).out);
  const auto points =
      Convert({"--to", "xyz", "--reverse", "--format", "csv", "--decimals", "2"}, kCadPoints);
  EXPECT_THAT(points.out, HasSubstr("z_mm,bend_radius_mm\n5718.30,10136.89,3989.39,\n"));
}

TEST(Convert, ReadsTablesOfTheTrade) {
  const std::string expected =
      Convert({"--to", "lra"}, "L R A CLR\n100 0 90 50\n200 -45 30 50\n80\n").out;
  const std::vector<std::pair<std::vector<std::string>, std::string>> tables = {
      {{},
       "# made by "
       "hand\nlength_mm,rotation_deg,angle_deg,bend_radius_mm\n100,0,90,50\n200,-45,30,50\n80,0,0,"
       "\n"},
      {{},
       "\xef\xbb\xbfNo;Length [mm];Rotation [deg];Angle [deg];Radius "
       "[mm]\r\n1;100,0;;90,0;50\r\n2;200,0;-45,0;30,0;50\r\n3;80,0\r\n"},
      {{"--from", "lra"}, "100 0 90 50\n200 -45 30 50\n80 0 0\n"},
      {{"--from", "lra", "--bend-radius", "50"}, "100\t0\t90\n200\t-45\t30\n80\t-\t-\n"},
      {{"--from", "lra", "--units", "m"}, "0.1 0 90 0.05\n0.2 315 30 0.05\n0.08 0 0\n"},
      {{"--rotation-sign", "-1"}, "Y B C R CLR\n100 0 90 1 50\n200 45 30 1 50\n80 0 0 0 0\n"},
      {{"--from", "ybc", "--length", "straights", "--rotation", "cumulative"},
       "100 0 90 50\n300 315 30 50\n380 315 0\n"},
      {{"--from", "ybc"}, "length rotation angle clr\n100 0 90 50\n200 -45 30 50\n80 0 0 -\n"},
      {{}, R"({"rows": [{"length_mm": 100, "angle_deg": 90, "bend_radius_mm": 50},
          {"length_mm": 200, "rotation_deg": -45, "angle_deg": 30, "bend_radius_mm": 50},
          {"length_mm": 80, "bend_radius_mm": null}]})"},
  };
  for (auto [words, table] : tables) {
    SCOPED_TRACE(table);
    words.insert(words.end(), {"--to", "lra"});
    const auto done = Convert(words, table);
    EXPECT_EQ(done.code, 0) << done.err;
    EXPECT_EQ(done.out, expected);
  }
}

TEST(Convert, ReadsDecimalCommasWhereCommasSeparateNothing) {
  const std::string expected = Convert({"--to", "lra"}, "L R A CLR\n100.5 0 90 20\n50.5\n").out;
  for (const char* delimiter : {";", "\t", " ", " ; "}) {
    std::string table = "L;R;A;CLR\n100,5;0,0;90;20\n50,5\n";
    for (auto at = table.find(';'); at != std::string::npos;
         at = table.find(';', at + std::string(delimiter).size())) {
      table.replace(at, 1, delimiter);
    }
    EXPECT_EQ(Convert({"--to", "lra"}, table).out, expected) << table;
  }
}

TEST(Convert, ABendRadiusBesideNoBendIsRefused) {
  // 100.5, 0, 90 and 50.5, 0, 0 in the words of who wrote it.
  for (const char* table : {"100,5,0,90\n50,5,0,0\n", "L,R,A,radius\n100,5,0,90\n50,5,0,0\n",
                            "100,5,0,90\n", "100 5 0 90\n50 0 0\n"}) {
    const auto done = Convert({"--to", "lra", "--from", "lra"}, table);
    EXPECT_EQ(done.code, 3) << table << done.out;
    EXPECT_THAT(done.err, HasSubstr("found a bend radius beside angle 0")) << table;
  }
  EXPECT_THAT(Convert({"--to", "lra", "--from", "lra"}, "100,5,0,90\n50,5,0,0\n").err,
              HasSubstr(":1: found a bend radius beside angle 0, expected a bend, or -; decimal "
                        "commas need semicolons"));
  // A last row may repeat the tool's.
  EXPECT_EQ(Convert({"--to", "lra", "--from", "lra"}, "100,0,90,20\n50,0,0,20\n").out,
            Convert({"--to", "lra", "--from", "lra"}, "100 0 90 20\n50\n").out);
}

TEST(Convert, ReadsResults) {
  RunResult result;
  result.measurement.tube.pipe_radius_mm = 4;
  result.measurement.tube.program = {{{50, 0, 90, 10.0}, {60, 0, 0, std::nullopt}}};
  result.measurement.tube.X_WT.position_mm = {1, 2, 3};
  const auto done =
      Convert({"--to", "xyz", "--format", "csv", "--decimals", "1"}, WriteResultJson(result));
  EXPECT_EQ(done.code, 0) << done.err;
  EXPECT_EQ(done.out,
            "x_mm,y_mm,z_mm,bend_radius_mm\n1.0,2.0,3.0,\n61.0,2.0,3.0,10.0\n61.0,72.0,3.0,\n");
}

// A tube of two unlike straights, scanned from the end that is the nominal's last.
TEST(Convert, GivesAResultInTheNominalsOrderAndSaysSo) {
  RunResult result;
  result.measurement.tube.pipe_radius_mm = 4;
  result.measurement.tube.program = {{{60, 0, 90, 10.0}, {50, 0, 0, std::nullopt}}};
  const std::vector<std::string> words = {"--to", "lra", "--format", "csv", "--decimals", "0"};
  const auto scanned = Convert(words, WriteResultJson(result));
  EXPECT_THAT(scanned.out, HasSubstr("\n60,0,90,10\n50,0,0,\n"));
  EXPECT_THAT(scanned.err, HasSubstr("rows in the order of the scan: the result knows no nominal"));

  result.inspection.emplace();
  result.inspection->direction.state = pipeline::DirectionState::kReverse;
  result.inspection->measured = pipeline::ReverseTube(result.measurement.tube);
  const auto inspected = Convert(words, WriteResultJson(result));
  EXPECT_THAT(inspected.out, HasSubstr("\n50,0,90,10\n60,0,0,\n"));
  EXPECT_THAT(inspected.err,
              HasSubstr("rows in the nominal's order; the scan came from the other end"));
  auto as_scanned = words;
  as_scanned.insert(as_scanned.end(), {"--order", "scan"});
  const auto scan = Convert(as_scanned, WriteResultJson(result));
  EXPECT_EQ(scan.out, scanned.out);
  EXPECT_THAT(scan.err, HasSubstr("in the order of the scan, against the nominal's"));

  result.inspection->direction.state = pipeline::DirectionState::kAmbiguous;
  EXPECT_THAT(Convert(words, WriteResultJson(result)).err, HasSubstr("not settled (ambiguous)"));
}

TEST(Convert, KeepsRotationsInRangeWhenItRounds) {
  const std::string lra = "l r a clr\n10 0 90 5\n10 -179.99999 90 5\n10 179.999985 90 5\n10 0 0\n";
  EXPECT_THAT(Convert({"--to", "lra", "--format", "csv", "--decimals", "3"}, lra).out,
              HasSubstr("\n10.000,180.000,90.000,5.000\n10.000,180.000,"));
  EXPECT_THAT(
      Convert({"--to", "ybc", "--format", "csv", "--decimals", "3", "--rotation", "cumulative"},
              lra)
          .out,
      HasSubstr("\n10.000,180.000,90.000,5.000\n10.000,0.000,"));
}

TEST(Convert, SharpCornersOnlyWhenAskedFor) {
  const std::string points = "x y z\n0 0 0\n10 0 0\n10 10 0\n";
  const auto refused = Convert({"--to", "lra"}, points);
  EXPECT_EQ(refused.code, 2);
  EXPECT_THAT(refused.err, HasSubstr("give --bend-radius MM"));
  const auto sharp =
      Convert({"--to", "lra", "--bend-radius", "0", "--format", "csv", "--decimals", "0"}, points);
  EXPECT_EQ(sharp.out, "length_mm,rotation_deg,angle_deg,bend_radius_mm\n10,0,90,\n10,0,0,\n");
}

TEST(Convert, NotesPointsThatBendNothing) {
  const auto done =
      Convert({"--to", "lra", "--bend-radius", "5"}, "x y z\n0 0 0\n10 0 0\n20 0 0\n");
  EXPECT_EQ(done.code, 0);
  EXPECT_THAT(done.err, StartsWith("bendloop: note: standard input: point 2 lies on a straight"));
}

TEST(Convert, SaysWhatIsWrongAndWhere) {
  struct Case {
    std::vector<std::string> words;
    std::string input;
    int code;
    std::string message;
  };
  const std::vector<Case> cases = {
      {{}, "", 2, "--to is required"},
      {{"--to", "abc"}, "", 2, "abc"},
      {{"--to", "lra", "--rotation-sign", "2"}, "", 2, "rotation-sign"},
      {{"--to", "lra", "--bend-radius", "-5"}, "", 2, "bend-radius"},
      {{"--to", "lra"}, " \n", 3, "standard input: is empty"},
      {{"--to", "lra"},
       "1 2 3\n",
       3,
       "standard input:1: found \"1 2 3\" without column names; say --from"},
      {{"--to", "lra"},
       "foo bar\n1 2\n",
       3,
       "standard input:1: found \"foo bar\", expected column names"},
      {{"--to", "lra", "--from", "xyz"},
       "l r a\n1 2 3\n",
       3,
       ":1: found \"l r a\", expected column names x y z"},
      {{"--to", "xyz"},
       "l r a\n1 0 90\n2 x 3\n",
       3,
       ":3: found \"x\" as rotation, expected a number"},
      {{"--to", "xyz"}, "l r a\n1 0 90\n2\n3 0 0\n", 3, ":3: found no angle, expected a number"},
      {{"--to", "xyz"}, "l r a\n1 0 90\n2 nan 3\n", 3, ":3: found \"nan\" as rotation"},
      {{"--to", "xyz", "--from", "lra"}, "1 2 3 4 5\n", 3, ":1: 5 columns without names"},
      {{"--to", "xyz"}, "l r a clr\n1 0 90 five\n", 3, ":2: found \"five\" as bend radius"},
      {{"--to", "xyz"}, "l r a clr\n1 0 90 5\n", 3, "row 1: the last row bends by 90 degrees"},
      {{"--to", "xyz"}, "l r a clr\n-1 0 90 5\n3 0 0\n", 3, "row 1: length -1 mm"},
      {{"--to", "xyz"},
       "l r a clr\n1 0 180 5\n3 0 0\n",
       3,
       "row 1: a bend of 180 degrees has no intersection point"},
      {{"--to", "xyz"}, "l r a\n1 0 90\n3 0 0\n", 2, "needs; give --bend-radius"},
      {{"--to", "xyz", "--units", "m"},
       "length_mm rotation angle\n1 0 90\n3 0 0\n",
       2,
       "expected --units mm"},
      {{"--to", "lra"},
       "L,R,A,radius\n100,5,0,90,20\n50,5\n",
       3,
       ":2: found 5 cells, expected 4 as in line 1; decimal commas need semicolons, tabs or "
       "blanks"},
      {{"--to", "lra"},
       "L,R,A,radius\n100,0,90,20\n50,5\n",
       3,
       ":3: found 2 cells, expected 4 as in line 1; decimal commas"},
      {{"--to", "lra"},
       "l r a clr\n1 0 90 5\n2 0 9\n3 0 0 0\n",
       3,
       ":3: found 3 cells, expected 4"},
      {{"--to", "lra", "--from", "lra"},
       "1,0,90\n2,0,90,5\n3\n",
       3,
       ":2: found 4 cells, expected 3 as in line 1"},
      {{"--to", "lra"}, "x;y;z\n1;2;3\n4;5\n", 3, ":3: found 2 cells, expected 3 as in line 1"},
      {{"--to", "lra"}, "position_mm 1 2\n", 3, ":1: position_mm has 2 value(s), expected 3"},
      {{"--to", "lra"},
       "position_mm 1 2 3\nl r a\n1 0 0\n",
       3,
       "pose without a line \"orientation_wxyz"},
      {{"--to", "lra"}, "orientation_wxyz 1 2 3 4\n", 3, ":1: orientation_wxyz has length"},
      {{"--to", "lra"}, "{\n\"rows\": [,]}", 3, "standard input:2: byte 12: not JSON"},
      {{"--to", "lra"}, "{\"rows\": [{\"length_mm\": \"a\"}]}", 3, "/rows/0/length_mm"},
      {{"--to", "lra"}, "[1, 2]", 3, "standard input"},
      {{"--to", "lra"}, "{\"rows\": [{\"length_mm\": 1e999}]}", 3, "a number does not fit 64 bits"},
      {{"--to", "lra", "--from", "xyz"},
       "{\"rows\": [{\"length_mm\": 1}]}",
       3,
       "found lra, expected xyz"},
      {{"--to", "lra", "--bend-radius", "9"},
       "x y z\n0 0 0\n10 0 0\n10 10 0\n0 10 0\n",
       3,
       "points 2 and 3 are 10 mm apart"},
      {{"--to", "lra", "missing.csv"}, "", 3, "missing.csv: cannot be opened: No such file"},
      {{"--to", "lra", "/"}, "", 3, "/: is a directory"},
  };
  for (const auto& test : cases) {
    SCOPED_TRACE(test.input + " " + test.message);
    const auto done = Convert(test.words, test.input);
    EXPECT_EQ(done.code, test.code) << done.err;
    EXPECT_THAT(done.err, HasSubstr(test.message));
    if (test.code != 2) {
      EXPECT_THAT(done.err, StartsWith("bendloop: "));
    }
    EXPECT_EQ(done.out, "");
  }
}

TEST(Convert, HelpHasExamples) {
  CLI::App app("test");
  std::function<int()> run;
  std::istringstream in;
  std::ostringstream out, err;
  const CLI::App* command = AddConvertCommand(app, run, in, out, err);
  EXPECT_THAT(command->help(), HasSubstr("bendloop convert --to xyz --format csv result.json"));
}

}  // namespace
}  // namespace bendloop::host
