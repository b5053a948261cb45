// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/cell/run_context.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace bendloop::host {
namespace {

using ::testing::HasSubstr;

RunContext Sample() {
  RunContext context;
  context.last_sequence = 4'000'000'000u;
  context.repeat_of = "part-0007";
  // Numbers that rounding to any count of decimals would change.
  context.bent_with = hal::ProgramBlock{
      7, 12, {{{0.1 + 0.2, 1e-17, 90.0 / 7, 12.0}, {1.0 / 3, 0, 0, std::nullopt}}}, 0xdeadbeef};
  pipeline::LotState lot;
  lot.parts = 3;
  lot.base = context.bent_with->program;
  lot.held = true;
  lot.slips = 2;
  lot.parts_of_all_lots = 41;
  pipeline::LotHypothesis& one = lot.hypotheses.emplace_back();
  one.temperament = pipeline::Temperament::kDrifting;
  one.log_weight = -1.0 / 3;
  one.behind = 0.1;
  one.event = pipeline::LotEvent::kCoilJump;
  one.parts_since = 2;
  one.values = {0, 3};
  one.scatter = {1.0 / 3, 2e-300, 0.7};
  one.scatter_weight = {1e300, 1.0 / 7, 3};
  one.mean = {0.1 + 0.2, -1e-17};
  one.covariance = {1, 1.0 / 9, 2};
  context.lot = lot;
  return context;
}

TEST(RunContext, ReadsBackBitForBit) {
  const RunContext written = Sample();
  const auto read = ReadRunContext(WriteRunContext(written), "test");
  ASSERT_TRUE(read) << read.error().message;
  EXPECT_EQ(read->bent_with, written.bent_with);
  EXPECT_EQ(read->lot, written.lot);
  EXPECT_EQ(read->last_sequence, written.last_sequence);
  EXPECT_EQ(read->repeat_of, written.repeat_of);
}

TEST(RunContext, MayBeEmpty) {
  const auto read = ReadRunContext(WriteRunContext({}), "test");
  ASSERT_TRUE(read) << read.error().message;
  EXPECT_FALSE(read->bent_with);
  EXPECT_FALSE(read->lot);
}

TEST(RunContext, BadTextIsBadInputThatSaysWhere) {
  for (const char* text : {"", "{", "[]", "7", R"({"schema":"bendloop.context/2"})",
                           R"({"schema":"bendloop.context/1","bent_with":{"part_number":"x"}})"}) {
    const auto read = ReadRunContext(text, "a.session");
    ASSERT_FALSE(read) << text;
    EXPECT_EQ(read.error().kind, hal::ErrorKind::kBadInput);
    EXPECT_THAT(read.error().message, HasSubstr("a.session"));
  }
}

TEST(Lot, BelongsToTheSettingsItWasLearntWith) {
  const pipeline::LotState lot = *Sample().lot;
  const std::string text = WriteLot(lot, "abc");
  const auto same = ReadLot(text, "lot.json", "abc");
  ASSERT_TRUE(same) << same.error().message;
  EXPECT_EQ(*same, lot);
  const auto other = ReadLot(text, "lot.json", "abd");
  ASSERT_TRUE(other);
  EXPECT_FALSE(*other);
  EXPECT_FALSE(ReadLot("{}", "lot.json", "abc"));
  // What the lot was until 2026-11 says nothing of drift.
  const auto old = ReadLot(R"({"schema":"bendloop.lot/1","key":"abc"})", "lot.json", "abc");
  ASSERT_TRUE(old) << old.error().message;
  EXPECT_FALSE(*old);
}

}  // namespace
}  // namespace bendloop::host
