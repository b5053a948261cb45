// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/report/report.h"

#include <gmock/gmock.h>

#include <regex>

#include "firmware-host/report/html.h"
#include "firmware-host/report/part_html.h"
#include "firmware-host/report/scene.h"
#include "firmware-host/report/unrolled_svg.h"
#include "firmware-host/result/json.h"
#include "hal/angles.h"
#include "hal/tube_features.h"
#include "tests/support/sample_run.h"

namespace bendloop::host {
namespace {

// How often `what` stands in `text`; a page is too long to be printed by a matcher.
std::size_t Count(const std::string& text, const std::string& what) {
  std::size_t count = 0;
  for (std::size_t at = 0; (at = text.find(what, at)) != std::string::npos; at += what.size()) {
    ++count;
  }
  return count;
}

Json Data(const std::string& html) {
  const std::string open = "id=\"data\">";
  const std::size_t from = html.find(open) + open.size();
  return Json::parse(html.substr(from, html.find("</script>", from) - from));
}

// The page without the scripts of three.js, whose text is not ours.
std::string Markup(const std::string& html) {
  const std::size_t data = html.find("<script type=\"application/json\"");
  return html.substr(0, data);
}

TEST(ReportHtml, LoadsNothingFromAnywhere) {
  const std::vector<RunResult> runs = {SampleRun(1), SampleRun(2, 0.1)};
  const std::string html = ReportHtml(runs);
  EXPECT_FALSE(std::regex_search(
      Markup(html), std::regex("<(link|img|iframe|object|embed|base)\\b", std::regex::icase)));
  EXPECT_FALSE(
      std::regex_search(Markup(html), std::regex("(src|href)=|@import", std::regex::icase)));
  EXPECT_EQ(Count(Markup(html), "://"), 0u);
  EXPECT_EQ(Count(html, "<script src"), 0u);
  EXPECT_EQ(Count(html, "</script>"), 4u);
  EXPECT_EQ(Count(html, "url("),
            Count(html, "url(#rdbu)") + Count(html.substr(Markup(html).size()), "url("));
  EXPECT_GT(Count(html, "default-src 'none'"), 0u);
  EXPECT_GT(Count(html, "MIT License"), 0u);
}

TEST(ReportHtml, TellsStraightnessEasingsDentsSeamAndWrinkles) {
  RunResult run = SampleRun();
  run.measurement.straights = {{0.12, 0.01, 80}, {0, 0, 0}, {0.3, 0.02, 60}};
  run.measurement.bend_easings = {{8, 0.5}, {7.5, 0.25}};
  run.measurement.dents = {{40, -90, 0.5, 0.02, 6, {1, 2, 3}, 0.1, 0.9, 28.3, 0.7}};
  run.measurement.seam = {72.5, 0.2, 0.125, 0.004, 1.4};
  run.measurement.wrinkles = {{1, 0.275, 0.015, {0, 0, 0}}};
  run.measurement.last_end.begins_mm = 4.5;
  run.measurement.last_end.profile = {{0.2, 5.4, 0.01}, {4.8, 4, 0.01}};
  const std::string html = CardsHtml(run);
  // 0.3 mm of 60 mm; the straight in the middle is too short to tell.
  EXPECT_EQ(Count(html, ">L/200<"), 1u);
  EXPECT_EQ(Count(html, ">L/"), 2u);
  EXPECT_EQ(Count(html, "<td class=\"n\">7.50</td><td class=\"n\">0.25</td>"), 1u);
  EXPECT_EQ(Count(html, "<p>Dents; "), 1u);
  EXPECT_EQ(Count(html, "<p>Weld seam; "), 1u);
  EXPECT_EQ(Count(html, "<p>Wrinkles "), 1u);
  EXPECT_EQ(Count(html, "<td class=\"n\">2</td><td class=\"n\">0.275</td>"), 1u);
  EXPECT_EQ(Count(html, "<td class=\"n\">0.125</td>"), 1u);
  EXPECT_EQ(Count(html, "<td class=\"n\">28.3</td><td class=\"n\">0.7</td>"), 1u);
  EXPECT_EQ(Count(html, "stroke-dasharray=\"3 2\""), 1u);  // on the unrolled surface
  EXPECT_EQ(Count(html, "<td class=\"n\">5.40</td>"), 1u);
  EXPECT_EQ(Count(html, "aria-label=\"radius by place\""), 1u);
  EXPECT_EQ(Count(CardsHtml(SampleRun()), "<h3>Form</h3>"), 0u);
}

// Where a ridge that no bend twists comes out of each bend, by angles that each bend counts anew.
TEST(UnrolledSvg, DrawsASeamWhereItRunsOnEachSegment) {
  pipeline::Measurement m = SampleRun().measurement;
  const auto segments = hal::SpineSegments(m.tube.program, m.tube.X_WT);
  constexpr double kAroundDeg = 72.5, kDrawnDeg = 0.3;
  m.seam = {kAroundDeg, 0.2, 0.125, 0.004, 1.4};
  const std::string svg = UnrolledSvg(m);
  const std::regex line("M[0-9.]+,([0-9.]+) L[0-9.]+,([0-9.]+) ");
  auto at = std::sregex_iterator(svg.begin(), svg.end(), line);
  Eigen::Vector3d ridge = hal::FrameAt(segments, 0, kAroundDeg).outward;
  for (std::size_t k = 0; k < segments.size(); ++k, ++at) {
    SCOPED_TRACE(k);
    ASSERT_NE(at, std::sregex_iterator());
    const double expected_deg =
        hal::AroundDeg(hal::AroundZero(segments, k), segments[k].tangent, ridge);
    for (const int side : {1, 2}) {
      // The height of the paper, 172 px, is a turn.
      const double drawn_deg = (std::stod((*at)[side].str()) / 172.0 - 0.5) * 360.0;
      EXPECT_LT(std::abs(std::remainder(drawn_deg - expected_deg, 360.0)), kDrawnDeg);
    }
    ridge = Eigen::Quaterniond::FromTwoVectors(segments[k].tangent,
                                               segments[k].TangentAt(segments[k].length_mm)) *
            ridge;
  }
  EXPECT_EQ(at, std::sregex_iterator());
  m.seam.reset();
  EXPECT_EQ(UnrolledSvg(m), "");
}

TEST(ReportHtml, TellsAndDrawsEdgesOfEnds) {
  RunResult run = SampleRun();
  pipeline::TubeFeaturesFound& features = run.measurement.features;
  features.is_known = true;
  features.first_end.emplace().bevel = {1.25, 0.03, 0.75, 0.02, 31.0, 0.2};
  features.last_end.emplace().burr = {0.35, 0.01, -52.5, 0.5};
  features.last_end->border = {{0, 0.5, 0.02}, {180, -0.625, 0.02}};
  const std::string html = CardsHtml(run);
  EXPECT_EQ(Count(html, "<p>Edges of the ends</p>"), 1u);
  EXPECT_EQ(Count(html, "<td class=\"n\">1.25</td><td class=\"n\">0.03</td>"), 1u);
  EXPECT_EQ(Count(html, "<td class=\"n\">0.35</td><td class=\"n\">0.01</td>"), 1u);
  EXPECT_EQ(Count(html, "stroke-dasharray=\"3 2\""), 1u);  // where the bevel begins
  RunResult square = run;
  square.measurement.features.last_end->border.clear();
  EXPECT_NE(CardsHtml(square), html);
}

TEST(ReportHtml, IsTheSameBytesEachTime) {
  const std::vector<RunResult> runs = {SampleRun(1), SampleRun(2)};
  EXPECT_EQ(ReportHtml(runs), ReportHtml(runs));
}

TEST(ReportHtml, NamesCannotBreakOut) {
  const std::string evil =
      "</script><script>alert(1)</script><img src=x onerror='alert(\"2\")'>&\x01";
  RunResult run = SampleRun();
  run.part = run.session = run.time = run.software = evil;
  run.measurement.warnings = {evil};
  run.measurement.timing = {{evil, 1}};
  run.inspection->reasons = {evil};
  run.inspection->direction.message = evil;
  run.inspection->envelope[0].name = evil;
  run.correction->notices = {evil};
  run.correction->refusals = {evil};
  run.interlocks->checks[0].sentence = evil;
  run.bender->outcome = CommitOutcome::kRefused;
  run.bender->reason = evil;
  const std::string html = ReportHtml(std::span(&run, 1), {.title = evil});
  EXPECT_EQ(Count(html, "<script>alert"), 0u);
  EXPECT_EQ(Count(html, "<img"), 0u);
  EXPECT_GT(Count(html, "&lt;/script&gt;"), 0u);
  EXPECT_EQ(Count(html, "</script>"), 4u);
}

TEST(ReportHtml, ShowsTheNumbersAndMarksThemNotByColourAlone) {
  const RunResult run = SampleRun(1, 1.5);
  const std::string html = ReportHtml(std::span(&run, 1));
  EXPECT_GT(Count(html,
                  "<td class=\"n\">46.500</td><td class=\"n\">0.015</td>"
                  "<td class=\"n\">+1.500</td>"),
            0u);
  EXPECT_GT(Count(html, "<span aria-hidden=\"true\">\u2717</span> out</td>"), 0u);
  EXPECT_GT(Count(html, "committed as sequence 102"), 0u);
  EXPECT_GT(Count(html, "bend 2 was 1.500&#176; over its nominal"), 0u);
  EXPECT_GT(Count(html, "the clamp hides 14 mm of row 3"), 0u);
  EXPECT_GT(Count(html, "<title>part 1, bend 2: +1.500 +- 0.015 deg</title>"), 0u);
}

// Between `from` and the next `to`.
std::string Piece(const std::string& html, const std::string& from, const std::string& to) {
  const std::size_t at = html.find(from);
  return at == std::string::npos ? "" : html.substr(at, html.find(to, at) - at);
}

TEST(ReportHtml, TheHeadIsThatOfThePartThatIsShown) {
  std::vector<RunResult> runs = {SampleRun(1, 1.5), SampleRun(2, 0.1)};
  runs[0].session = "cell-a-part-0006";
  runs[1].session = "cell-a-part-0007";
  const std::string html = Markup(ReportHtml(runs));
  const std::string first = Piece(html, "<div class=\"head\" data-part=\"0\" hidden>", "</dl>");
  EXPECT_EQ(Count(first, "</span> Fail</span>"), 1u);
  EXPECT_EQ(Count(first, "<dd>6, one of 2 in this report</dd>"), 1u);
  const std::string second = Piece(html, "<div class=\"head\" data-part=\"1\">", "</dl>");
  EXPECT_EQ(Count(second, "</span> Pass</span>"), 1u);
  EXPECT_EQ(Count(second, "cell-a-part-0007"), 1u);
  // Nothing else says how a part ended: it would be another part's.
  EXPECT_EQ(Count(Piece(html, "<header>", "<main>"), "class=\"badge"), 2u);
  EXPECT_EQ(Count(html, "data-number=\"6\""), 1u);
  EXPECT_EQ(Count(html, "<article class=\"part\" data-part=\"0\" hidden><h2>Part 6 "), 1u);
  EXPECT_GT(Count(html, "<title>part 7, bend 2"), 0u);
}

TEST(PartNumber, IsTheSessionsOrThePlaceOnThePage) {
  RunResult run;
  for (const auto& [session, number] :
       std::vector<std::pair<std::string, std::string>>{{"part-0025", "25"},
                                                        {"part-0000", "4"},
                                                        {"0006", "4"},
                                                        {"scan.ply", "4"},
                                                        {"", "4"},
                                                        {"2024-05-06_part-1", "1"},
                                                        {"scan-20240506071059", "4"}}) {
    run.session = session;
    EXPECT_EQ(PartNumber(run, 3), number) << session;
  }
}

TEST(ReportHtml, SaysInWordsWhereThereIsNoPicture) {
  const RunResult run = SampleRun();
  const std::string html = Markup(ReportHtml(std::span(&run, 1)));
  EXPECT_EQ(Count(html, "<body class=\"no-webgl\">"), 1u);
  EXPECT_EQ(Count(html, "<p class=\"fallback\">This browser shows no three-dimensional picture"),
            1u);
  EXPECT_EQ(Count(Piece(html, "<div class=\"views\">", "</div>"), "<figure>"), 3u);
}

// A view is drawn to the same size whatever its extents are, and so must be its lettering.
TEST(ReportHtml, TheLetteringIsOfOneSizeInAllViews) {
  RunResult run = SampleRun();
  run.inspection.reset();
  hal::BendProgram& program = run.measurement.tube.program;
  program.rows = {{1000, 0, 20, 30.0}, {50, 0, 0, {}}};  // long, flat and seen from its end
  const std::string html = Markup(ReportHtml(std::span(&run, 1)));
  const std::regex view("viewBox=\"0 0 ([0-9.]+) ([0-9.]+)\">.*?<text font-size=\"([0-9.]+)\"");
  const std::string views = Piece(html, "<div class=\"views\">", "</div>");
  std::vector<double> sizes;  // on a page that gives each view 4 by 3
  for (std::sregex_iterator at(views.begin(), views.end(), view), end; at != end; ++at) {
    const double scale = std::min(4 / std::stod((*at)[1]), 3 / std::stod((*at)[2]));
    sizes.push_back(scale * std::stod((*at)[3]));
  }
  ASSERT_EQ(sizes.size(), 3u);
  EXPECT_NEAR(sizes[0], sizes[1], 0.02 * sizes[0]);
  EXPECT_NEAR(sizes[0], sizes[2], 0.02 * sizes[0]);
}

// The script turns "N mm" and "N of N mm" into inches: no length may stand without its unit.
TEST(ReportHtml, LengthsInSentencesNameTheirUnit) {
  RunResult run = SampleRun();
  run.inspection->surface.tolerance_mm = 0.5;
  const std::string html = Markup(ReportHtml(std::span(&run, 1)));
  EXPECT_EQ(Count(html, " of 0.50 mm <span class=\"state"), 1u);
  EXPECT_EQ(Count(html, " mm)</dd>"), 1u);
  EXPECT_GT(Count(ReportHtml(std::span(&run, 1)), "document.createTreeWalker(piece"), 0u);
}

TEST(ReportHtml, EachJudgedNumberStandsInItsLimits) {
  RunResult run = SampleRun(1, 1.5);
  const std::string html = Markup(ReportHtml(std::span(&run, 1)));
  std::size_t judged = 0;
  for (const auto& row : run.inspection->rows) {
    for (const auto* d : {&row.length_mm, &row.rotation_deg, &row.angle_deg}) {
      judged += d->state != pipeline::ToleranceState::kNotJudged ? 1 : 0;
    }
    judged += row.bend_radius_mm ? 1 : 0;
  }
  EXPECT_EQ(Count(html, "<td class=\"dial\">"), judged);
  // 1.5 of a limit of 0.5: at the end.
  EXPECT_EQ(Count(html, "<circle cx=\"78.0\""), 1u);
}

TEST(ReportHtml, TimesAreFoldedAwayForDevelopers) {
  const RunResult run = SampleRun();
  const std::string html = Markup(ReportHtml(std::span(&run, 1)));
  EXPECT_EQ(Count(html, "<h3>Timing"), 0u);
  EXPECT_EQ(Count(html, "<details class=\"developers\"><summary>For developers"), 1u);
}

TEST(TickDecimals, WriteATickAndItsHalfAsTheyAre) {
  for (const auto& [value, decimals] : std::vector<std::pair<double, int>>{
           {1.5, 2}, {1, 1}, {2, 0}, {3, 1}, {0.8, 1}, {0.1, 2}, {0.06, 2}, {40, 0}, {1e-5, 4}}) {
    EXPECT_EQ(TickDecimals(value), decimals) << value;
  }
}

// Digits and "~" as on the terminal.
TEST(ReportHtml, ShowsOnlyTheDigitsThatAreKnown) {
  RunResult run = SampleRun(1, 1.5);
  EXPECT_EQ(Count(Markup(ReportHtml(std::span(&run, 1))), ">~"), 0u);
  run.inspection->rows[1].length_mm.measured = 60.12345;
  run.inspection->rows[1].length_mm.sigma = 75.0;
  std::string html = Markup(ReportHtml(std::span(&run, 1)));
  EXPECT_EQ(Count(html, "<td class=\"n\">~60</td><td class=\"n\">75</td>"), 1u);
  EXPECT_EQ(Count(html, "<small>~ not known: 1 sigma"), 1u);
  run.inspection->rows.clear();  // measured only
  run.measurement.sigma.rows.at(1).rotation_deg = 12.3;
  html = Markup(ReportHtml(std::span(&run, 1)));
  EXPECT_EQ(Count(html, "<td class=\"n\">~"), 1u);
  EXPECT_EQ(Count(html, "<td class=\"n\">12</td>"), 1u);
  run.measurement.joint.known_together = {{.first_bend = 0,
                                           .last_bend = 0,
                                           .values = {{1, pipeline::RowValueKind::kRotation}},
                                           .direction_sigma_deg = 0.03}};
  EXPECT_EQ(Count(Markup(ReportHtml(std::span(&run, 1))), "vague: R2; but direction behind"), 1u);
}

TEST(ReportHtml, HoldsForAnythingThatIsMissing) {
  EXPECT_GT(Count(ReportHtml({}), "</html>"), 0u);
  RunResult run;
  EXPECT_GT(Count(ReportHtml(std::span(&run, 1)), "Measured"), 0u);
  run = SampleRun();
  run.inspection->rows.clear();  // another number of bends than the nominal
  run.measurement.tube.program.rows.pop_back();
  EXPECT_GT(Count(ReportHtml(std::span(&run, 1)), "</html>"), 0u);
  run = SampleRun();
  run.measurement.surface.clear();
  run.measurement.sigma.rows.clear();
  run.measurement.tube.program.rows[1].angle_deg = std::nan("");
  EXPECT_EQ(Count(Markup(ReportHtml(std::span(&run, 1))), "nan<"), 0u);
  run.nominal->rows.clear();
  EXPECT_GT(Count(ReportHtml(std::span(&run, 1)), "</html>"), 0u);
}

TEST(ReportHtml, StaysSmallForManySamples) {
  std::vector<RunResult> runs(4, SampleRun(1, 1, 100));
  for (RunResult& run : runs) {
    run.measurement.surface.resize(500'000, run.measurement.surface.front());
  }
  const std::string html = ReportHtml(runs);
  EXPECT_LT(html.size(), 5'000'000u);
  for (const auto& part : Data(html)["parts"]) {
    const std::size_t bytes = part["points"].get<std::string>().size() / 4 * 3;
    EXPECT_LE(bytes, 16u * 15'000 + 3);
    EXPECT_GE(bytes, 16u * 12'000);
  }
}

TEST(Scene, DeviationsAreSignedAndExact) {
  // A tube of the nominal's shape, 2 mm off along +z of its first straight: +2 above, -2 below.
  RunResult run = SampleRun(1, 0);
  run.inspection->measured.program = *run.nominal;
  run.inspection->measured.pipe_radius_mm = 10;
  run.inspection->alignment.X_NW.position_mm = {0, 0, 2};
  run.inspection->alignment.X_NW.orientation.setIdentity();
  run.inspection->measured.X_WT = {};
  const Scene scene = MakeScene(run, 100);
  ASSERT_TRUE(scene.compared);
  double most = 0, least = 0;
  for (int k = 0; k < TubeMesh::kSides; ++k) {
    const auto& v = scene.measured.vertices[static_cast<std::size_t>(k)];
    const double d = scene.deviation_mm[static_cast<std::size_t>(k)];
    EXPECT_NEAR(d, std::hypot(v.y(), v.z()) - 10, 1e-9);
    most = std::max(most, d);
    least = std::min(least, d);
  }
  EXPECT_NEAR(most, 2, 1e-9);
  EXPECT_NEAR(least, -2, 1e-9);
}

TEST(Scene, ScannedPointsHaveTheDeviationOfTheInspection) {
  const RunResult run = SampleRun(1, 1.5, 300);
  const Scene scene = MakeScene(run, 1000);
  ASSERT_EQ(scene.points.size(), 300u);
  const auto spine = hal::SpineSegments(*run.nominal, hal::Pose{});
  double most = 0;
  for (std::size_t i = 0; i < 300; ++i) {
    EXPECT_EQ(scene.points[i].deviation_mm, run.inspection->surface.distance_mm[i]);
    EXPECT_NEAR(DistanceFromSpine(spine, scene.points[i].position_mm) - 10,
                scene.points[i].deviation_mm, 0.02);
    most = std::max(most, std::abs(scene.points[i].deviation_mm));
  }
  EXPECT_GT(most, 2);  // 1.5 degrees at bend 2 over the rest of the tube
}

TEST(TubeMesh, LiesOnTheTubeAndDoesNotTwist) {
  const auto spine = hal::SpineSegments(SampleNominal(), hal::Pose{});
  const auto counts = RingCounts({spine});
  const TubeMesh mesh = MakeTubeMesh(spine, 10, counts);
  ASSERT_EQ(mesh.vertices.size(), mesh.centers.size() * TubeMesh::kSides);
  for (std::size_t i = 0; i < mesh.vertices.size(); ++i) {
    EXPECT_NEAR(DistanceFromSpine(spine, mesh.vertices[i]), 10, 1e-9);
  }
  for (std::size_t i = TubeMesh::kSides; i < mesh.vertices.size(); ++i) {
    // A step is 8 mm of straight or 3 degrees of the bend's outside: 2.6 mm.
    EXPECT_LT((mesh.vertices[i] - mesh.vertices[i - TubeMesh::kSides]).norm(), 9);
  }
}

TEST(DeviationColour, RunsFromBlueOverGreyToRed) {
  EXPECT_EQ(DeviationColour(-9, 3), "#054891");
  EXPECT_EQ(DeviationColour(0, 3), "#d8d8d3");
  EXPECT_EQ(DeviationColour(3, 3), "#960a26");
}

TEST(Base64, KnowsItsPadding) {
  const std::vector<float> one = {1.0f}, three = {1.0f, -2.0f, 0.5f};
  EXPECT_EQ(Base64(one), "AACAPw==");
  EXPECT_EQ(Base64(three), "AACAPwAAAMAAAAA/");
  EXPECT_EQ(Base64({}), "");
}

}  // namespace
}  // namespace bendloop::host
