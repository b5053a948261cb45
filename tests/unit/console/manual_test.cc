// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/console/manual.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <memory>
#include <string>

#include "firmware-host/console/command_line.h"

namespace bendloop::host {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;

class ManualTest : public ::testing::Test {
 protected:
  ManualTest() {
    DressCommandLine(app_, "bend 1.2 (abc)\nbuild: x");
    app_.require_subcommand(1);
    CLI::App* turn = app_.add_subcommand("turn", "Turn one's tube round. And back.");
    turn->add_option("file", file_, "A table")->required();
    turn->add_option("--units", units_, "Of lengths [mm]")->check(CLI::IsMember({"mm", "in"}));
    turn->add_option("--count", count_, "How often");
    turn->add_flag("-q,--quick", quick_, "Don't wait: now");
    turn->footer("\nExamples:\n  bend turn x.csv\n.and a line that roff would take for its own");
    CLI::App* lot = app_.add_subcommand("lot", "Of one coil");
    lot->add_subcommand("show", "What is known");
  }

  CLI::App app_{"bend: bends tubes", "bend"};
  std::string file_, units_;
  int count_ = 0;
  bool quick_ = false;
};

TEST_F(ManualTest, PageSaysWhatHelpSays) {
  const std::string page = Manual(app_, "man1:turn", "bend 1.2 (abc)\nbuild: x");
  EXPECT_THAT(page, HasSubstr(".TH bend\\-turn 1 \"\" \"bend 1.2 (abc)\"\n.SH NAME\n"
                              "bend\\-turn \\- Turn one's tube round\n"));
  EXPECT_THAT(page, HasSubstr("\\fB\\-q,\\-\\-quick\\fR\nDon't wait: now\n"));
  EXPECT_THAT(page, HasSubstr(".SS Examples\n.nf\n  bend turn x.csv\n.fi\n\\&.and a line"));
  EXPECT_THAT(Manual(app_, "man8", ""), HasSubstr(".TP\n.B turn\nTurn one's tube round"));
  EXPECT_THAT(Manual(app_, "man1:lot", ""), HasSubstr(".TP\n.B show\nWhat is known"));
}

TEST_F(ManualTest, OptionForTheBuildIsNotForPeople) {
  EXPECT_THAT(app_.help(), Not(HasSubstr("--manual")));
  EXPECT_THAT(Manual(app_, "man1", ""), Not(HasSubstr("manual")));
  EXPECT_THAT(Manual(app_, "bash", ""), Not(HasSubstr("--manual")));
  EXPECT_EQ(Manual(app_, "commands", ""), "turn\nlot\n");
  EXPECT_THROW(Manual(app_, "man1:twist", ""), CLI::ValidationError);
  // It needs none of the options and commands that people must give.
  EXPECT_THROW(app_.parse("--manual commands"), CLI::CallForVersion);
}

TEST_F(ManualTest, BashKnowsCommandsOptionsAndWords) {
  const std::string script = BashCompletion(app_);
  EXPECT_THAT(script, HasSubstr("'bend') words='turn lot -h --help -V --version' ;;"));
  EXPECT_THAT(script, HasSubstr("'bend turn --units') words='mm in' ;;"));
  EXPECT_THAT(script, HasSubstr("'bend turn --count') return ;;"));
  EXPECT_THAT(script, HasSubstr("'bend lot show') at=\"$at $word\" ;;"));
}

TEST_F(ManualTest, ZshHasTheDescriptions) {
  const std::string script = ZshCompletion(app_);
  EXPECT_THAT(script, HasSubstr("#compdef bend\n"));
  EXPECT_THAT(script, HasSubstr("'(--units)--units=[Of lengths \\[mm\\]]:--units:(mm in)'"));
  EXPECT_THAT(script, HasSubstr("'(-q --quick)--quick[Don'\\''t wait\\: now]'"));
  EXPECT_THAT(script, HasSubstr("lot) _bend_lot ;;"));
}

}  // namespace
}  // namespace bendloop::host
