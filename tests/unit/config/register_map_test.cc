// SPDX-License-Identifier: Apache-2.0
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "config/load.h"
#include "config_text.h"

namespace bendloop::config {
namespace {

using ::testing::HasSubstr;

class RegisterMapFile : public ::testing::Test {
 protected:
  // The shipped default with one change.
  std::string ErrorOf(std::string_view from, std::string_view to) {
    changed_ = With(default_, from, to);
    const auto map = ParseRegisterMap(changed_, "map.toml");
    EXPECT_FALSE(map) << to;
    return map ? "" : map.error().message;
  }

  std::string default_ = ReadAll(ShippedConfig() / "register-maps/default.toml");
  std::string changed_;
};

TEST_F(RegisterMapFile, ReadsTheDefault) {
  const auto map = ParseRegisterMap(default_, "map.toml");
  ASSERT_TRUE(map) << map.error().message;
  EXPECT_EQ(map->mode.address, 0);
  EXPECT_EQ(map->mode_bending, 2u);
  ASSERT_TRUE(map->commit);
  EXPECT_EQ(map->commit->address, 2000);
  EXPECT_EQ(map->commit->type, hal::RegisterType::kUint32);
  EXPECT_EQ(map->active.crc.address, 105);
  EXPECT_EQ(map->staging.row_count.address, 1004);
  EXPECT_EQ(map->row_stride, 8);
  ASSERT_TRUE(map->row_bend_radius_mm);
  EXPECT_EQ(map->row_bend_radius_mm->address, 6);
  EXPECT_EQ(map->row_bend_radius_mm->scale, 0.001);
}

TEST_F(RegisterMapFile, OverlapsNameBothPlaces) {
  const std::string error = ErrorOf("heartbeat  = { address = 2,", "heartbeat  = { address = 1,");
  EXPECT_EQ(error, "map.toml:" + LineOf(changed_, "heartbeat  =") +
                       ": key 'state.heartbeat': found registers 1, expected them apart from "
                       "'state.fault_code', which has 1 (map.toml:" +
                       LineOf(changed_, "fault_code =") + ")");
  // The second register of a 32-bit value.
  EXPECT_THAT(ErrorOf("sequence    = { address = 102,", "sequence    = { address = 101,"),
              HasSubstr("found registers 101 to 102, expected them apart from "
                        "'active.part_number', which has 100 to 101"));
  // A whole block of rows.
  EXPECT_THAT(ErrorOf("rows        = { address = 110 }", "rows        = { address = 900 }"),
              HasSubstr("found registers 1000 to 1001, expected them apart from 'active.rows', "
                        "which has 900 to 1219"));
  // Fields of a row.
  EXPECT_THAT(ErrorOf("angle_deg      = { address = 4", "angle_deg      = { address = 3"),
              HasSubstr("key 'row.angle_deg': found registers 3 to 4, expected them apart from "
                        "'row.rotation_deg', which has 2 to 3"));
}

TEST_F(RegisterMapFile, TheSameAddressInAnotherSpaceIsNoOverlap) {
  const std::string text = With(default_, "heartbeat  = { address = 2,",
                                "heartbeat  = { address = 1, space = \"input\",");
  const auto map = ParseRegisterMap(text, "map.toml");
  EXPECT_TRUE(map) << map.error().message;
}

TEST_F(RegisterMapFile, SizesThatDoNotFit) {
  EXPECT_THAT(ErrorOf("rows        = { address = 110 }", "rows        = { address = 65217 }"),
              HasSubstr("found registers 65217 to 65536, expected none beyond 65535"));
  EXPECT_THAT(ErrorOf("parts_bent = { address = 7,", "parts_bent = { address = 65535,"),
              HasSubstr("found registers 65535 to 65536"));
  EXPECT_THAT(ErrorOf("parts_bent = { address = 7,", "parts_bent = { address = 65536,"),
              HasSubstr("found 65536, expected a whole number from 0 to 65535"));
  EXPECT_THAT(ErrorOf("stride         = 8", "stride         = 7"),
              HasSubstr("key 'row.bend_radius_mm': found registers up to 7 of the row, expected "
                        "less than the stride of 7"));
  EXPECT_THAT(ErrorOf("max_rows       = 40", "max_rows       = 60000"),
              HasSubstr("found 60000, expected a whole number from 2 to 1000"));
  EXPECT_THAT(ErrorOf("bending = 2", "bending = 65537"), HasSubstr("expected at most 65535"));
}

TEST_F(RegisterMapFile, TypesAndScalesThatCannotCarryAProgram) {
  EXPECT_THAT(ErrorOf("crc         = { address = 105, type = \"uint32\" }",
                      "crc         = { address = 105, type = \"uint16\" }"),
              HasSubstr("key 'active.crc.type': found another type, expected 'uint32'"));
  EXPECT_THAT(ErrorOf("angle_deg      = { address = 4, type = \"int32\", scale = 0.001",
                      "angle_deg      = { address = 4, type = \"int32\", scale = 0"),
              HasSubstr("key 'row.angle_deg.scale': found 0, expected a scale that is not 0"));
  EXPECT_THAT(ErrorOf("angle_deg      = { address = 4, type = \"int32\"",
                      "angle_deg      = { address = 4, type = \"int16\""),
              HasSubstr("found a type and scale that hold -32.768 to 32.767, expected at least 0 "
                        "to 180"));
  EXPECT_THAT(ErrorOf("rotation_deg   = { address = 2, type = \"int32\"",
                      "rotation_deg   = { address = 2, type = \"uint32\""),
              HasSubstr("expected at least -179 to 180"));
  EXPECT_THAT(ErrorOf("length_mm      = { address = 0, type = \"int32\"",
                      "length_mm      = { address = 0, type = \"double\""),
              HasSubstr("expected one of 'uint16', 'int16', 'uint32', 'int32', 'float32'"));
  EXPECT_THAT(ErrorOf("sequence       = { address = 2000, type = \"uint32\" }",
                      "sequence       = { address = 2000, type = \"uint16\" }"),
              HasSubstr("key 'commit.sequence': found another type than 'staging.sequence' has"));
}

TEST_F(RegisterMapFile, WhatIsWrittenStandsInHoldingRegisters) {
  EXPECT_THAT(ErrorOf("sequence       = { address = 2000,",
                      "sequence       = { address = 2000, space = \"input\","),
              HasSubstr("key 'commit.sequence.space': found 'input', expected 'holding'"));
  EXPECT_THAT(ErrorOf("rows        = { address = 1010 }",
                      "rows        = { address = 1010, space = \"input\" }"),
              HasSubstr("key 'staging.rows.space': found 'input', expected 'holding'"));
}

TEST_F(RegisterMapFile, CodesAreDistinct) {
  EXPECT_THAT(ErrorOf("bending = 2", "bending = 1"),
              HasSubstr("key 'state.mode.bending': found 1, expected another value than 'idle'"));
  EXPECT_THAT(ErrorOf("rejected = 2", "rejected = 1"),
              HasSubstr("expected another value than 'accepted' has"));
}

TEST_F(RegisterMapFile, KeysOfOtherPlacesAreUnknown) {
  EXPECT_THAT(ErrorOf("heartbeat  = { address = 2,", "heartbeat  = { adress = 2,"),
              HasSubstr("did you mean 'address'?"));
  // Counters are not scaled, rows have no space of their own.
  EXPECT_THAT(ErrorOf("heartbeat  = { address = 2,", "heartbeat  = { scale = 2, address = 2,"),
              HasSubstr("key 'state.heartbeat.scale': found an unknown key"));
}

// One program only, no commit: what is written is what it bends. A weaker guarantee, but a map.
TEST_F(RegisterMapFile, WithoutCommitStagingMayBeTheActiveProgram) {
  const std::size_t staging = default_.find("[staging]");
  const std::size_t active = default_.find("[active]");
  std::string area = default_.substr(active, default_.find("# Where bendloop puts") - active);
  std::string text = default_.substr(0, staging) + With(area, "[active]", "[staging]") +
                     default_.substr(default_.find("# One row:"));
  const auto refused = ParseRegisterMap(text, "map.toml");
  ASSERT_FALSE(refused);
  EXPECT_THAT(refused.error().message, HasSubstr("key 'staging.rows': found registers"));
  text = With(text, "sequence       = { address = 2000, type = \"uint32\" }", "");
  const auto map = ParseRegisterMap(text, "map.toml");
  ASSERT_TRUE(map) << map.error().message;
  EXPECT_FALSE(map->commit);
}

}  // namespace
}  // namespace bendloop::config
