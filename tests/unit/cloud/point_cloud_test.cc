// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/cloud/point_cloud.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <liblzf/lzf.h>
#include <sys/stat.h>
#include <unistd.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <thread>

namespace bendloop::host {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using Points = std::vector<Eigen::Vector3d>;

PointCloud Parse(const std::string& bytes, Units units = Units::kMillimetres) {
  auto cloud = ParseCloud(bytes, "test", units);
  EXPECT_TRUE(cloud) << cloud.error().message;
  return cloud ? *cloud : PointCloud{};
}

std::string ErrorOf(const std::string& bytes) {
  const auto cloud = ParseCloud(bytes, "test", Units::kMillimetres);
  return cloud ? "accepted" : cloud.error().message;
}

const Points kTwo = {{1.5, -2, 3}, {4, 5.25, -6}};

template <class T>
void Put(std::string& bytes, T value, bool big_endian = false) {
  char raw[sizeof(T)];
  std::memcpy(raw, &value, sizeof(T));
  if (big_endian) std::reverse(raw, raw + sizeof(T));
  bytes.append(raw, sizeof(T));
}

TEST(Ply, ReadsAsciiWithComments) {
  const auto cloud = Parse(
      "ply\nformat ascii 1.0\ncomment made by hand\nobj_info something\nelement vertex 2\n"
      "property float x\nproperty float y\nproperty float z\nend_header\n"
      "1.5 -2 3\n\n  4\t5.25 -6e0\n");
  EXPECT_EQ(cloud.points_mm, kTwo);
  EXPECT_EQ(cloud.format, "PLY ascii");
  EXPECT_THAT(cloud.warnings, IsEmpty());
}

TEST(Ply, ReadsBothByteOrdersWithFacesBeforeAndListsInsideTheVertices) {
  for (const bool big : {false, true}) {
    for (const std::string end : {"\n", "\r\n", "\r"}) {
      const std::vector<std::string> header = {
          "ply",
          std::string("format binary_") + (big ? "big" : "little") + "_endian 1.0",
          "element face 2",
          "property list uchar int vertex_indices",
          "element vertex 2",
          "property uchar red",
          "property double z",
          "property list ushort short neighbours",
          "property float x",
          "property short quality",
          "property float32 y",
          "element edge 7",
          "property int a",
          "end_header"};
      std::string bytes;
      for (const auto& line : header) bytes += line + end;
      for (const int items : {3, 0}) {
        Put<std::uint8_t>(bytes, items);
        for (int i = 0; i < items; ++i) Put<std::int32_t>(bytes, i, big);
      }
      for (std::size_t i = 0; i < kTwo.size(); ++i) {
        Put<std::uint8_t>(bytes, '\n');
        Put<double>(bytes, kTwo[i].z(), big);
        Put<std::uint16_t>(bytes, i, big);
        for (std::size_t k = 0; k < i; ++k) Put<std::int16_t>(bytes, -1, big);
        Put<float>(bytes, kTwo[i].x(), big);
        Put<std::int16_t>(bytes, -300, big);
        Put<float>(bytes, kTwo[i].y(), big);
      }
      EXPECT_EQ(Parse(bytes).points_mm, kTwo);
    }
  }
}

TEST(Ply, ReadsEveryScalarType) {
  std::string bytes =
      "ply\nformat binary_little_endian 1.0\nelement vertex 1\nproperty char a\nproperty uchar b\n"
      "property short c\nproperty ushort d\nproperty int32 x\nproperty uint8 y\nproperty int16 z\n"
      "end_header\n";
  Put<std::int8_t>(bytes, 1);
  Put<std::uint8_t>(bytes, 1);
  Put<std::int16_t>(bytes, 1);
  Put<std::uint16_t>(bytes, 1);
  Put<std::int32_t>(bytes, -70000);
  Put<std::uint8_t>(bytes, 200);
  Put<std::int16_t>(bytes, -300);
  EXPECT_EQ(Parse(bytes).points_mm, (Points{{-70000, 200, -300}}));
}

TEST(Ply, AsciiSkipsElementsBeforeTheVertices) {
  const auto cloud = Parse(
      "ply\r\nformat ascii 1.0\r\nelement face 1\r\nproperty list uchar int vertex_indices\r\n"
      "element vertex 2\r\nproperty float nx\r\nproperty float x\r\nproperty float y\r\n"
      "property float z\r\nend_header\r\n3 0 1 1\r\n9 1.5 -2 3\r\n9 4 5.25 -6\r\n");
  EXPECT_EQ(cloud.points_mm, kTwo);
}

std::string PcdHeader(const std::string& data, int width, int height) {
  return "# .PCD v.7\nVERSION .7\nFIELDS rgb z _ x y\nSIZE 4 8 1 4 4\nTYPE U F U F F\n"
         "COUNT 1 1 3 1 1\nWIDTH " +
         std::to_string(width) + "\nHEIGHT " + std::to_string(height) +
         "\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS " + std::to_string(width * height) + "\nDATA " + data +
         "\n";
}

TEST(Pcd, ReadsAscii) {
  EXPECT_EQ(Parse(PcdHeader("ascii", 2, 1) + "7 3 0 0 0 1.5 -2\n7 -6 0 0 0 4 5.25\n").points_mm,
            kTwo);
}

TEST(Pcd, ReadsTheShortHeaderOfOldFiles) {
  EXPECT_EQ(Parse("COLUMNS x y z\r\nPOINTS 2\r\nDATA ascii\r\n1.5 -2 3\r\n4 5.25 -6\r\n").points_mm,
            kTwo);
}

TEST(Pcd, ReadsBinaryWithPaddingAndOrganisedCloudsWithHoles) {
  std::string bytes = PcdHeader("binary", 2, 2);
  for (int i = 0; i < 4; ++i) {
    const Eigen::Vector3d point = i % 2 ? kTwo[i / 2] : Eigen::Vector3d::Constant(NAN);
    Put<std::uint32_t>(bytes, 7);
    Put<double>(bytes, point.z());
    bytes += "pad";
    Put<float>(bytes, point.x());
    Put<float>(bytes, point.y());
  }
  const auto cloud = Parse(bytes);
  EXPECT_EQ(cloud.points_mm, kTwo);
  EXPECT_EQ(cloud.dropped_non_finite, 2u);
  EXPECT_THAT(cloud.warnings, ElementsAre(HasSubstr("left out 2 points")));
}

TEST(Pcd, ReadsBinaryCompressed) {
  std::string plain;
  constexpr int kCount = 500;
  for (int i = 0; i < kCount; ++i) Put<std::uint32_t>(plain, 7);
  for (int i = 0; i < kCount; ++i) Put<double>(plain, 3.0 * i);
  plain.append(3 * kCount, '\0');
  for (int i = 0; i < kCount; ++i) Put<float>(plain, 1.0f * i);
  for (int i = 0; i < kCount; ++i) Put<float>(plain, 2.0f * i);
  std::string packed(plain.size() + 100, '\0');
  packed.resize(lzf_compress(plain.data(), plain.size(), packed.data(), packed.size()));
  ASSERT_GT(packed.size(), 0u);
  std::string bytes = PcdHeader("binary_compressed", kCount, 1);
  Put<std::uint32_t>(bytes, packed.size());
  Put<std::uint32_t>(bytes, plain.size());
  const auto cloud = Parse(bytes + packed);
  ASSERT_EQ(cloud.points_mm.size(), 500u);
  for (int i = 0; i < kCount; ++i) {
    EXPECT_EQ(cloud.points_mm[i], Eigen::Vector3d(i, 2 * i, 3 * i));
  }
}

TEST(Xyz, ReadsEveryDelimiterHeaderAndLineEnd) {
  const std::vector<std::string> texts = {
      "1.5 -2 3\n4 5.25 -6\n",
      "  1.5   -2\t3  \r\n\r\n  4 5.25 -6",
      "1.5\t-2\t3\n4\t5.25\t-6\n",
      "1.5\t\t-2\t\t3\n4\t\t5.25\t\t-6\n",
      "1.5,-2,3\n4,5.25,-6\n",
      "1.5, -2, 3\n4, 5.25, -6\n",
      "1, -2, 3\n4, 5.25, -6\n",
      "1.5;-2;3;\n4;5.25;-6;\n",
      "1,5;-2,0;3\n4;5,25;-6\n",
      "1,5 -2,0 3,0\n4,0 5,25 -6,0\n",
      "1,5\t-2\t3\n4\t5,25\t-6\n",
      "1.5|-2|3\n4|5.25|-6\n",
      "+1.5e0 -2.0E+0 3\n40e-1 525e-2 -.6e1\n",
      "x y z\n1.5 -2 3\n4 5.25 -6\n",
      "\xef\xbb\xbfX [mm];Y [mm];Z [mm]\r\n1,5;-2;3\r\n4;5,25;-6\r\n",
      "X [mm] Y [mm] Z [mm]\n1.5 -2 3\n4 5.25 -6\n",
      "//X Y Z\n1.5 -2 3\n4 5.25 -6\n",
      "//X,Y,Z,R,G,B\n2\n1.5,-2,3,0,0,0\n4,5.25,-6,0,0,0\n",
      "# exported somewhere\n# z x y\n3 1.5 -2\n-6 4 5.25\n",
      "2\n1.5 -2 3 -1200 255 0 0\n4 5.25 -6 -1200 255 0 0\n",
      "id,name,Z,Y,X\n1,a b,3,-2,1.5\n2,c,-6,5.25,4\n",
      "Intensity,Points:0,Points:1,Points:2\n9,1.5,-2,3\n9,4,5.25,-6\n",
      "\"x\",\"y\",\"z\"\n\"1.5\",\"-2\",\"3\"\n\"4\",\"5.25\",\"-6\"\n",
      "Point No;X;Y;Z\n1;1.5;-2;3\n2;4;5.25;-6\n",
      "1.5 -2 3\n# between\n// also\n  # indented\n4 5.25 -6\n# last",
      "1.5 -2 3\r4 5.25 -6\r",
      "x_mm,y_mm,z_mm\n1.5,-2,3\n4,5.25,-6\n",
      "1.5,-2,3,0,0,1\n4,5.25,-6,0,1,0\n",
      "x;y;z;i\n1,5;-2;3;7\n4;5,25;-6;\n",
      "1.5\t-2\t3\t7\n4\t5.25\t-6\t\n",
      "1.5 -2 3 # the first\n4 5.25 -6\n",
  };
  for (const auto& text : texts) {
    SCOPED_TRACE(text);
    const auto cloud = Parse(text);
    Points expected = kTwo;
    if (text.starts_with("1, ")) expected[0].x() = 1;
    EXPECT_EQ(cloud.points_mm, expected);
    EXPECT_THAT(cloud.warnings, IsEmpty());
  }
}

TEST(Xyz, DropsAndCountsPointsThatAreNotFinite) {
  const auto cloud =
      Parse("1 2 3\nnan nan nan\n-inf 0 0\n1.#QNAN 0 0\nNaN 1 2\n1e999 0 0\n4 5 6\n");
  EXPECT_EQ(cloud.points_mm.size(), 2u);
  EXPECT_EQ(cloud.dropped_non_finite, 5u);
}

TEST(Xyz, WarnsOfPointNumbersTakenAsX) {
  std::string text;
  for (int i = 1; i < 20; ++i) text += std::to_string(i) + " 0.5 0.5 0.5\n";
  EXPECT_THAT(Parse(text).warnings, ElementsAre(HasSubstr("counts the lines")));
}

TEST(Xyz, WarnsWhenTheHeaderStatesAnotherUnit) {
  EXPECT_THAT(Parse("x [m],y [m],z [m]\n1,2,3\n").warnings, ElementsAre(HasSubstr("--units")));
  EXPECT_THAT(Parse("x [m],y [m],z [m]\n1,2,3\n", Units::kMetres).warnings, IsEmpty());
}

TEST(Xyz, NeverGuessesAboutThousands) {
  EXPECT_THAT(ErrorOf("x;y;z\n1;2;3\n1.234,5;2;3\n"), HasSubstr("test:3: found \"1.234,5\" as x"));
}

TEST(PointCloud, ScalesUnits) {
  EXPECT_EQ(Parse("1 2 3\n", Units::kMetres).points_mm, (Points{{1000, 2000, 3000}}));
  EXPECT_EQ(Parse("1 2 3\n", Units::kInches).points_mm[0].x(), 25.4);
  EXPECT_TRUE(UnitsFromName("in"));
  ASSERT_FALSE(UnitsFromName("ft"));
  EXPECT_EQ(UnitsFromName("ft").error().kind, hal::ErrorKind::kUsage);
  EXPECT_THAT(UnitsFromName("ft").error().message, HasSubstr("expected mm, m or in"));
}

TEST(PointCloud, FlagsCoordinatesThatNoTubeHas) {
  EXPECT_THAT(Parse("1 2 3\n1e7 0 0\n").warnings,
              ElementsAre(HasSubstr("1 points lie more than 1 km from the origin")));
}

TEST(PointCloud, EveryCutOfABinaryFileIsAnErrorAndNeverACrash) {
  std::string bytes =
      "ply\nformat binary_little_endian 1.0\nelement vertex 2\nproperty float x\n"
      "property float y\nproperty float z\nend_header\n";
  for (int i = 0; i < 6; ++i) Put<float>(bytes, 1);
  for (std::size_t size = 0; size < bytes.size(); ++size) {
    EXPECT_NE(ErrorOf(bytes.substr(0, size)), "accepted") << size;
  }
}

TEST(PointCloud, ReadsTheRealScan) {
  const auto cloud =
      ReadCloud(BENDLOOP_SOURCE_DIR "/tests/data/clouds/real-coil/coil.ply", Units::kMetres);
  ASSERT_TRUE(cloud) << cloud.error().message;
  EXPECT_EQ(cloud->points_mm.size(), 10000u);
  EXPECT_EQ(cloud->dropped_non_finite, 0u);
  EXPECT_THAT(cloud->warnings, IsEmpty());
  Eigen::AlignedBox<double, 3> box;
  for (const auto& point : cloud->points_mm) box.extend(point);
  EXPECT_GT(box.diagonal().norm(), 300);
  EXPECT_LT(box.diagonal().norm(), 3000);
}

TEST(PointCloud, ReadsNamedPipes) {
  const auto pipe =
      std::filesystem::path(::testing::TempDir()) / ("cloud_pipe_" + std::to_string(getpid()));
  ASSERT_EQ(mkfifo(pipe.c_str(), 0600), 0);
  std::thread writer([&] {
    std::ofstream out(pipe);
    for (int i = 0; i < 20000; ++i) out << i << ";" << 2 * i << ";0\n";
  });
  const auto cloud = ReadCloud(pipe.string(), Units::kMillimetres);
  writer.join();
  std::filesystem::remove(pipe);
  ASSERT_TRUE(cloud) << cloud.error().message;
  EXPECT_EQ(cloud->points_mm.size(), 20000u);
}

}  // namespace
}  // namespace bendloop::host
