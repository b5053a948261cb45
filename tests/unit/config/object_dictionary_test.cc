// SPDX-License-Identifier: Apache-2.0
#include "config/object_dictionary.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "config/load.h"
#include "config_text.h"

namespace bendloop::config {
namespace {

using ::testing::HasSubstr;

class Eds : public ::testing::Test {
 protected:
  // The message about the shipped pair with one change in the EDS, or in the map.
  std::string ErrorOf(std::string_view from, std::string_view to, bool in_map = false) {
    (in_map ? changed_map_ : changed_) = With(in_map ? map_ : eds_, from, to);
    auto map = ParseRegisterMap(in_map ? changed_map_ : map_, "map.toml");
    if (!map) return map.error().message;
    const auto dictionary = ParseObjectDictionary(in_map ? eds_ : changed_, "bender.eds");
    if (!dictionary) return dictionary.error().message;
    const auto bound = BindObjects(*map, *dictionary);
    return bound ? "" : bound.error().message;
  }

  std::string eds_ = ReadAll(ShippedConfig() / "object-dictionaries/default.eds");
  std::string map_ = ReadAll(ShippedConfig() / "register-maps/canopen.toml");
  std::string changed_;
  std::string changed_map_;
};

TEST_F(Eds, TheShippedPairBinds) {
  auto map = LoadRegisterMap(ShippedConfig() / "register-maps/canopen.toml");
  ASSERT_TRUE(map) << map.error().message;
  EXPECT_TRUE(map->of_objects());
  EXPECT_FALSE(map->high_byte_first);
  const auto dictionary = LoadObjectDictionary(ShippedConfig() / "object-dictionaries/default.eds");
  ASSERT_TRUE(dictionary) << dictionary.error().message;
  EXPECT_EQ(dictionary->Find({0x1018, 1})->data_type, 7);
  EXPECT_FALSE(dictionary->Find({0x2010, 4})->writable);
  EXPECT_TRUE(dictionary->Find({0x2020, 4})->writable);
  EXPECT_EQ(dictionary->Find({0x2010, 0})->data_type, 5);
  EXPECT_EQ(dictionary->Find({0x2022, 0}), nullptr);
  const auto bound = BindObjects(*map, *dictionary);
  ASSERT_TRUE(bound) << bound.error().message;
  EXPECT_EQ(map->mode.type, hal::RegisterType::kUint8);
  EXPECT_EQ(map->commit->type, hal::RegisterType::kUint32);
  EXPECT_NE(map->active.rows_address, map->staging.rows_address);
  EXPECT_EQ(ValidateFile(ShippedConfig() / "object-dictionaries/default.eds"),
            FileKind::kObjectDictionary);
}

TEST_F(Eds, SyntaxErrorsNameTheLine) {
  const auto error = [](const char* text) {
    const auto dictionary = ParseObjectDictionary(text, "a.eds");
    return dictionary ? "" : dictionary.error().message;
  };
  EXPECT_EQ(error("; comment\n[1000]\nDataType\n"),
            "a.eds:3: found 'DataType', expected a [section], then lines of the form key=value; "
            "comments begin with ;");
  EXPECT_THAT(error("x=1\n"), HasSubstr("a.eds:1: found 'x=1', expected a [section]"));
  EXPECT_EQ(error("[1000]\n[2000]\n[1000]\n"),
            "a.eds:3: [1000]: found this section a second time, expected it once (a.eds:1)");
  EXPECT_THAT(error("[1000]\nDataType=7\ndatatype=7\n"),
              HasSubstr("a.eds:3: found key 'datatype'"));
  EXPECT_EQ(error("[2000sub1]\r\nDataType=0x10007\r\nAccessType=yes\r\n"),
            "a.eds: 2 problems:\n"
            "a.eds:2: [2000sub1] DataType: found '0x10007', expected a number from 0 to 65535\n"
            "a.eds:3: [2000sub1] AccessType: found 'yes', expected ro, wo, rw, rwr, rww or const");
  EXPECT_THAT(error(""), HasSubstr("a.eds:1: found no object"));
  EXPECT_THAT(error("\x7f"
                    "ELF\n\x01\x02"),
              HasSubstr("2 problems"));
  std::string all;
  for (int i = 0; i < 1000; ++i) all += "junk\n";
  EXPECT_THAT(error(all.c_str()), HasSubstr("1000 problems, the first 20 are:"));
  // A megabyte of arrays that each claim 254 entries.
  all.clear();
  for (int i = 0x1000; i < 0x4000; ++i) {
    all += "[" + std::to_string(i) + "]\nDataType=7\nCompactSubObj=254\n";
  }
  EXPECT_THAT(error(all.c_str()), HasSubstr("found more than 100000 objects"));
}

TEST_F(Eds, NumbersAndCompactArraysAreRead) {
  const auto dictionary = ParseObjectDictionary(
      "[DeviceInfo]\nVendorNumber=0x1F\nProductNumber=010\n"
      "[2000]\nObjectType=8\nDataType=0x0006\nAccessType=RW\nCompactSubObj=3\n"
      "[2000SUB2]\nDataType=7\nAccessType=wo\n[2000Name]\nNrOfEntries=0\n[5]\n",
      "a.eds");
  ASSERT_TRUE(dictionary) << dictionary.error().message;
  EXPECT_EQ(dictionary->vendor_number, 31u);
  EXPECT_EQ(dictionary->product_number, 8u);
  ASSERT_EQ(dictionary->objects.size(), 3u);
  EXPECT_EQ(dictionary->Find({0x2000, 3})->data_type, 6);
}

TEST_F(Eds, WhatDoesNotFitTheMapNamesBoth) {
  EXPECT_EQ(ErrorOf("[2001sub1]", "[2001sub7]"),
            "bender.eds:1: [2001sub1]: found no such object, expected one for 'commit.sequence' of "
            "register map \"bendloop canopen\"");
  const std::string crc = "[2010sub4]\nParameterName=CRC-32\nObjectType=0x7\nDataType=0x000";
  EXPECT_EQ(ErrorOf(crc + "7", crc + "6"),
            "bender.eds:" + LineOf(changed_, "[2010sub4]") +
                ": [2010sub4]: found DataType 6 (UNSIGNED16), expected 7 (UNSIGNED32) for "
                "'active.crc' of register map \"bendloop canopen\"");
  const std::string rows =
      "ParameterName=Staged rows\nObjectType=0x7\nDataType=0x000F\nAccessType=";
  EXPECT_THAT(
      ErrorOf(rows + "rw", rows + "ro"),
      HasSubstr("[2021sub0]: found an object that cannot be written, expected AccessType rw "
                "for 'staging.rows'"));
  EXPECT_THAT(ErrorOf(rows + "rw", rows + "wo"), HasSubstr("cannot be read"));
  const std::string count =
      "ParameterName=Rows, the end length included\nObjectType=0x7\nDataType=0x";
  EXPECT_THAT(ErrorOf("[2020sub3]\n" + count + "0006", "[2020sub3]\n" + count + "0009"),
              HasSubstr("DataType 9 (VISIBLE_STRING)"));
  EXPECT_THAT(ErrorOf("fault = 3 }", "fault = 300 }", true),
              HasSubstr("holds up to 255, expected one that holds 300 for 'state.mode'"));
  EXPECT_THAT(ErrorOf("rows        = { index = 0x2021 }", "rows        = { index = 0x2011 }", true),
              HasSubstr("key 'staging.rows': found object 2011sub0, expected another one than "
                        "'active.rows' has (map.toml:"));
  EXPECT_THAT(ErrorOf("reply_sequence = { index = 0x2001, sub = 2 }",
                      "reply_sequence = { address = 7 }", true),
              HasSubstr("key 'commit.reply_sequence': found an address, expected an object (index, "
                        "sub) as in 'state.mode'"));
  EXPECT_THAT(ErrorOf("heartbeat  = { index = 0x2000, sub = 3 }",
                      "heartbeat  = { index = 0x2000, sub = 3, type = \"uint16\" }", true),
              HasSubstr("found an unknown key"));
  EXPECT_THAT(ErrorOf("[state]", "[words]\nhigh_word_first = true\n[state]", true),
              HasSubstr("key 'words': found a table, expected none"));
}

TEST_F(Eds, CellTakesTheRightKindOfMap) {
  const auto cell = [](const std::string& link, const std::string& map) {
    const auto file = std::filesystem::path(testing::TempDir()) / "canopen-cell.toml";
    std::ofstream(file) << "schema = \"bendloop.cell/1\"\nname = \"c\"\npart = \"" +
                               (ShippedConfig() / "parts/demo.toml").string() +
                               "\"\n[scanner]\nkind = \"stream\"\n[bender]\nlink = \"" + link +
                               "\"\ncan_interface = \"can0\"\nregister_map = \"" +
                               (ShippedConfig() / "register-maps" / map).string() +
                               "\"\nobject_dictionary = \"" +
                               (ShippedConfig() / "object-dictionaries/default.eds").string() +
                               "\"\n";
    return LoadCell(file);
  };
  const auto good = cell("canopen", "canopen.toml");
  ASSERT_TRUE(good) << good.error().message;
  EXPECT_EQ(good->bender.register_map.mode.type, hal::RegisterType::kUint8);
  EXPECT_EQ(good->bender.can_node_id, 1);
  EXPECT_THAT(cell("canopen", "default.toml").error().message,
              HasSubstr("key 'bender.register_map': found a map of registers, expected one of "
                        "CANopen objects"));
  EXPECT_THAT(cell("can-isotp", "canopen.toml").error().message,
              HasSubstr("found a map of CANopen objects, expected one of registers"));
}

}  // namespace
}  // namespace bendloop::config
