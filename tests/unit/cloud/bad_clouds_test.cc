// SPDX-License-Identifier: Apache-2.0
// Every file of tests/data/clouds/bad is refused, and says where, what and what instead.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "firmware-host/cloud/point_cloud.h"

namespace bendloop::host {
namespace {

using ::testing::HasSubstr;

const std::string kFolder = BENDLOOP_SOURCE_DIR "/tests/data/clouds/bad/";

const std::map<std::string, std::vector<std::string>>& Expected() {
  static const std::map<std::string, std::vector<std::string>> expected = {
      {"truncated.ply", {": byte 143: ", "ends after 2 of 4 instances of element \"vertex\""}},
      {"lying-count.ply", {": byte ", "ends after 1 of 150000000 instances"}},
      {"count-beyond-limit.ply", {":3: ", "4000000000 vertices, expected at most 200000000"}},
      {"count-overflows.ply", {":3: ", "\"99999999999999999999999\", expected a whole number"}},
      {"negative-count.ply", {":3: ", "\"-1\", expected a whole number"}},
      {"lying-count-ascii.ply", {": byte ", "ends after 2 of 150000000 points"}},
      {"no-z.ply", {":3: ", "no property z", "\"x y q\"", "expected x, y and z"}},
      {"duplicate-x.ply", {":7: ", "\"x\" stands twice"}},
      {"list-x.ply", {":3: ", "property x is a list, expected a number"}},
      {"unknown-type.ply", {":4: ", "\"half\", expected char"}},
      {"unknown-format.ply", {":2: ", "\"binary_middle_endian\", expected ascii"}},
      {"header-cut-off.ply", {":4: ", "ends without end_header"}},
      {"word-in-vertex.ply", {":9: ", "found \"five\" as y, expected a number"}},
      {"short-line.ply", {":9: ", "found 2 values, expected 3"}},
      {"no-vertex.ply", {":5: ", "no element vertex"}},
      {"no-points.ply", {"holds no points"}},
      {"all-nan.ply", {"all 2 points are NaN or infinite"}},
      {"lying-list.ply", {": byte ", "ends after 1 of 2 instances of element \"face\""}},
      {"truncated.pcd", {": byte ", "ends after 1 of 3 points"}},
      {"lying-points.pcd", {": byte ", "ends after 1 of 150000000 points"}},
      {"lying-points-ascii.pcd", {": byte ", "ends after 1 of 150000000 points"}},
      {"width-and-points-differ.pcd", {":10: ", "POINTS 2, but WIDTH times HEIGHT is 3"}},
      {"size-without-fields.pcd", {":3: ", "SIZE has 2 entries", "each of the 3 FIELDS"}},
      {"no-z.pcd", {":3: ", "no field z (found \"x y w\"), expected x, y and z"}},
      {"odd-size.pcd", {":3: ", "field x has TYPE F, SIZE 3", "expected one F of 4 or 8 bytes"}},
      {"unknown-data.pcd", {":11: ", "DATA \"base64\", expected ascii, binary or"}},
      {"header-cut-off.pcd", {":3: ", "ends without a DATA line"}},
      {"compressed-size-lies.pcd", {": byte ", "1000 compressed bytes stated, but 7 follow"}},
      {"plain-size-lies.pcd",
       {": byte ", "4000000000 uncompressed bytes stated, expected 24 for 2 points of 12 bytes"}},
      {"points-beyond-compressed.pcd", {": byte ", "4 compressed bytes cannot hold them"}},
      {"damaged-lzf.pcd", {": byte ", "compressed data are damaged"}},
      {"no-sizes.pcd", {": byte ", "before the two sizes"}},
      {"word.csv", {":3: ", "found \"six\" as z, expected a number"}},
      {"two-columns.xyz", {":2: ", "found 2 column(s) in \"4 5\", expected 3 as in line 1"}},
      {"decimal-commas.csv", {":1: ", "six columns of whole numbers", "decimal commas"}},
      {"decimal-commas-under-names.csv",
       {":2: ", "found 6 column(s)", "expected 3 as in line 1; decimal commas need semicolons"}},
      {"rows-differ.csv", {":3: ", "found 4 column(s)", "expected 5 as in line 1"}},
      {"surplus-word.xyz", {":2: ", "found 4 column(s)", "expected 3 as in line 1"}},
      {"only-two-columns.xyz", {":1: ", "found \"1 2\", expected three numbers"}},
      {"header-without-xyz.csv", {":1: ", "\"length,width,height\"", "names x, y and z"}},
      {"empty-cell.csv", {":3: ", "found \"\" as y, expected a number"}},
      {"count-too-large.pts", {":3: ", "ends after 2 of 5 points that line 1 states"}},
      {"cut-off-in-number.xyz", {":2: ", "found \"6e\" as z, expected a number"}},
      {"empty.xyz", {"is empty, expected PLY, PCD or text"}},
      {"comments-only.xyz", {":3: ", "ends without a point"}},
      {"prose.txt", {":1: ", "found \"Dear colleague,\", expected three numbers"}},
      {"all-nan.xyz", {"all 2 points are NaN or infinite"}},
      {"unknown.bin", {": byte 1: ", "unknown binary data"}},
      {"utf16.txt", {"UTF-16", "save it as UTF-8"}},
      {"mesh.stl", {"looks like an STL mesh"}},
      {"archive.gz", {"looks like a gzip archive"}},
  };
  return expected;
}

TEST(BadClouds, AreRefusedWithWhereWhatAndWhatInstead) {
  for (const auto& [file, parts] : Expected()) {
    SCOPED_TRACE(file);
    const auto cloud = ReadCloud(kFolder + file, Units::kMillimetres);
    if (cloud) {
      ADD_FAILURE() << "accepted";
      continue;
    }
    EXPECT_EQ(cloud.error().kind, hal::ErrorKind::kBadInput);
    EXPECT_THAT(cloud.error().message, ::testing::StartsWith(kFolder + file));
    EXPECT_EQ(cloud.error().message.find('\n'), std::string::npos);
    for (const auto& part : parts) EXPECT_THAT(cloud.error().message, HasSubstr(part));
  }
}

TEST(BadClouds, AreAllTested) {
  for (const auto& entry : std::filesystem::directory_iterator(kFolder)) {
    EXPECT_EQ(Expected().count(entry.path().filename().string()), 1u) << entry.path();
  }
}

TEST(BadClouds, WhatIsNoFileIsRefused) {
  const auto message = [](const std::string& path) {
    const auto cloud = ReadCloud(path, Units::kMillimetres);
    return cloud ? std::string("accepted") : cloud.error().message;
  };
  EXPECT_THAT(message(kFolder), HasSubstr("is a directory"));
  EXPECT_THAT(message(kFolder + "missing.ply"), HasSubstr("cannot be opened: No such file"));
  EXPECT_THAT(message("/dev/zero"), HasSubstr("is a device"));
}

}  // namespace
}  // namespace bendloop::host
