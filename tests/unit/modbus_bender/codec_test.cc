// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <random>

#include "drivers/register_bender/field_codec.h"
#include "drivers/register_bender/program_codec.h"
#include "tests/support/bender_maps.h"

namespace bendloop::drivers {
namespace {

using hal::RegisterType;
using test::Field;

// As python's zlib.crc32 computes it from the bytes in drivers/README.md.
constexpr std::uint32_t kWorkedExampleCrc = 0xACEC1448;

constexpr RegisterType kTypes[] = {RegisterType::kUint16, RegisterType::kInt16,
                                   RegisterType::kUint32, RegisterType::kInt32,
                                   RegisterType::kFloat32};

TEST(FieldCodec, WordAndByteOrderAsDocumented) {
  hal::RegisterMap map;
  RegisterImage image;
  const auto field = Field(10, RegisterType::kUint32);
  const std::uint16_t* words = image.At(field.space, 10);
  ASSERT_TRUE(PutField(map, field, 0x11223344, "x", image));
  EXPECT_EQ(words[0], 0x1122);
  EXPECT_EQ(words[1], 0x3344);
  map.high_word_first = false;
  ASSERT_TRUE(PutField(map, field, 0x11223344, "x", image));
  EXPECT_EQ(words[0], 0x3344);
  EXPECT_EQ(words[1], 0x1122);
  map.high_byte_first = false;
  ASSERT_TRUE(PutField(map, field, 0x11223344, "x", image));
  EXPECT_EQ(words[0], 0x4433);
  EXPECT_EQ(words[1], 0x2211);
  map = {};
  ASSERT_TRUE(PutField(map, Field(10, RegisterType::kFloat32), 1.5, "x", image));
  EXPECT_EQ(words[0], 0x3FC0);
  EXPECT_EQ(words[1], 0x0000);
  ASSERT_TRUE(PutField(map, Field(10, RegisterType::kInt16, 0.01), -1.005e2, "x", image));
  EXPECT_EQ(words[0], 0x10000 - 10050);
}

TEST(FieldCodec, RoundTripStaysWithinHalfAStep) {
  std::mt19937_64 random(1);
  RegisterImage image;
  hal::RegisterMap map;
  for (int i = 0; i < 20000; ++i) {
    map.high_word_first = random() & 1;
    map.high_byte_first = random() & 1;
    hal::RegisterField field = Field(static_cast<int>(random() % 65534), kTypes[random() % 5],
                                     std::pow(10.0, static_cast<int>(random() % 5) - 4));
    if (random() & 1) field.scale = -field.scale;
    field.offset = static_cast<double>(random() % 3) - 1;
    const double value = std::uniform_real_distribution<double>(-40, 40)(random);
    const double raw = std::round((value - field.offset) / field.scale);
    const bool is_unsigned =
        field.type == RegisterType::kUint16 || field.type == RegisterType::kUint32;
    const bool is_short = RegisterCount(field.type) == 1;
    const bool fits = field.type == RegisterType::kFloat32 ||
                      (is_unsigned ? raw >= 0 && raw <= (is_short ? 65535.0 : 4294967295.0)
                                   : std::abs(raw) <= (is_short ? 32767.0 : 2147483647.0));
    const auto put = PutField(map, field, value, "x", image);
    ASSERT_EQ(put.has_value(), fits) << value << " " << raw << " " << int(field.type);
    if (!put) {
      EXPECT_EQ(put.error().kind, hal::ErrorKind::kBadInput);
      continue;
    }
    const auto back = GetField(map, field, "x", image);
    ASSERT_TRUE(back);
    const double step = field.type == RegisterType::kFloat32 ? 1e-5 : std::abs(field.scale);
    EXPECT_NEAR(*back, value, step * 0.5 + 1e-9);
  }
}

TEST(FieldCodec, LimitsOfEveryTypeAreKeptNotWrapped) {
  RegisterImage image;
  const hal::RegisterMap map;
  struct Limit {
    RegisterType type;
    double low, high;
  };
  for (const Limit& limit :
       {Limit{RegisterType::kUint16, 0, 65535}, Limit{RegisterType::kInt16, -32768, 32767},
        Limit{RegisterType::kUint32, 0, 4294967295.0},
        Limit{RegisterType::kInt32, -2147483648.0, 2147483647.0}}) {
    const auto field = Field(0, limit.type);
    for (double value : {limit.low, limit.high}) {
      ASSERT_TRUE(PutField(map, field, value, "x", image));
      EXPECT_EQ(GetField(map, field, "x", image).value(), value);
    }
    EXPECT_FALSE(PutField(map, field, limit.low - 1, "x", image));
    EXPECT_FALSE(PutField(map, field, limit.high + 1, "x", image));
  }
  EXPECT_FALSE(PutField(map, Field(0, RegisterType::kFloat32), 1e39, "x", image));
  const auto error = PutField(map, Field(7, RegisterType::kInt16, 0.01), 400, "row 2 x", image);
  ASSERT_FALSE(error);
  EXPECT_EQ(error.error().message,
            "row 2 x: 400 does not fit int16 with scale 0.01 at register 7, which holds -327.68 "
            "to 327.67");
}

TEST(FieldCodec, FloatsThatAreNoNumbersAreTheDevicesFault) {
  RegisterImage image;
  const hal::RegisterMap map;
  *image.At(hal::RegisterSpace::kHolding, 4) = 0x7FC0;
  const auto value = GetField(map, Field(4, RegisterType::kFloat32), "angle", image);
  ASSERT_FALSE(value);
  EXPECT_EQ(value.error().kind, hal::ErrorKind::kDevice);
}

TEST(FieldCodec, LargestIntegerOfAField) {
  EXPECT_EQ(MaxInteger(Field(0, RegisterType::kUint16)), 65535u);
  EXPECT_EQ(MaxInteger(Field(0, RegisterType::kInt16)), 32767u);
  EXPECT_EQ(MaxInteger(Field(0, RegisterType::kUint32)), 4294967295u);
  EXPECT_EQ(MaxInteger(Field(0, RegisterType::kFloat32)), 16777216u);
}

// A map with any types, orders, places and conventions that can carry a usual program.
hal::RegisterMap RandomMap(std::mt19937_64& random) {
  hal::RegisterMap map = test::PlainMap();
  map.high_word_first = random() & 1;
  map.high_byte_first = random() & 1;
  map.rotation_cumulative = random() & 1;
  map.rotation_sign_reversed = random() & 1;
  map.length_cumulative = random() & 1;
  int next = static_cast<int>(random() % 3);
  const auto place = [&](RegisterType type, double scale) {
    const auto field = Field(next, type, scale);
    next += RegisterCount(type) + static_cast<int>(random() % 2);
    return field;
  };
  const RegisterType wide[] = {RegisterType::kInt32, RegisterType::kFloat32};
  map.row_rotation_deg =
      map.rotation_cumulative
          ? place(random() & 1 ? RegisterType::kUint16 : RegisterType::kFloat32, 0.01)
          : place(random() & 1 ? RegisterType::kInt16 : wide[random() % 2], 0.01);
  map.row_angle_deg = place(kTypes[random() % 5], 0.01);
  map.row_length_mm = place(wide[random() % 2], 0.001);
  map.row_bend_radius_mm.reset();
  if (random() & 1) map.row_bend_radius_mm = place(RegisterType::kUint32, 0.001);
  map.row_stride = static_cast<std::uint16_t>(next + static_cast<int>(random() % 3));
  const int rows = map.max_rows * map.row_stride;
  map.staging.rows_address = static_cast<std::uint16_t>(1010 + random() % (50000 - rows));
  return map;
}

TEST(ProgramCodec, RoundTripForAnyMap) {
  std::mt19937_64 random(2);
  RegisterImage image;
  for (int i = 0; i < 2000; ++i) {
    const hal::RegisterMap map = RandomMap(random);
    ASSERT_TRUE(CheckRegisterMap(map)) << CheckRegisterMap(map).error().message;
    const hal::ProgramBlock block{
        static_cast<std::uint32_t>(random()), static_cast<std::uint32_t>(random()),
        test::RandomProgram(random, 1 + static_cast<int>(random() % 39)), 0};
    const auto put = EncodeProgram(map, map.staging, block, image);
    ASSERT_TRUE(put) << put.error().message;
    const auto back = DecodeProgram(map, map.staging, image);
    ASSERT_TRUE(back) << back.error().message;
    ASSERT_EQ(back->program.rows.size(), block.program.rows.size());
    EXPECT_EQ(back->part_number, block.part_number);
    EXPECT_EQ(back->sequence, block.sequence);
    for (std::size_t r = 0; r < block.program.rows.size(); ++r) {
      const hal::BendRow& in = block.program.rows[r];
      const hal::BendRow& out = back->program.rows[r];
      EXPECT_NEAR(out.length_mm, in.length_mm, 0.0021);
      EXPECT_NEAR(out.angle_deg, in.angle_deg, 0.0051);
      EXPECT_NEAR(hal::WrapRotationDeg(out.rotation_deg - in.rotation_deg), 0, 0.0101);
      EXPECT_GT(out.rotation_deg, -180.0);
      EXPECT_LE(out.rotation_deg, 180.0);
      if (map.row_bend_radius_mm && in.bend_radius_mm) {
        EXPECT_NEAR(out.bend_radius_mm.value(), *in.bend_radius_mm, 0.00051);
      } else {
        EXPECT_FALSE(out.bend_radius_mm);
      }
    }
    // What has been through the registers once goes through unchanged.
    RegisterImage again;
    ASSERT_TRUE(EncodeProgram(map, map.staging, *back, again));
    const auto twice = DecodeProgram(map, map.staging, again);
    ASSERT_TRUE(twice);
    EXPECT_EQ(twice->crc, back->crc) << "map " << i;
  }
}

TEST(ProgramCodec, CumulativeRotationNeverShowsAFullTurn) {
  hal::RegisterMap map = test::PlainMap();
  map.rotation_cumulative = true;
  map.row_rotation_deg = Field(2, RegisterType::kUint16, 0.01);
  RegisterImage image;
  for (double second : {359.999, -0.001, 0.0, 359.994, 180.0, -180.0}) {
    const hal::ProgramBlock block{
        1, 1, {{{10, 0, 30, 20}, {10, second, 30, 20}, {10, 0, 0, {}}}}, 0};
    ASSERT_TRUE(EncodeProgram(map, map.staging, block, image));
    const std::uint16_t raw = *image.At(hal::RegisterSpace::kHolding, 1010 + 8 + 2);
    EXPECT_LT(raw, 36000) << second;
    const auto back = DecodeProgram(map, map.staging, image);
    ASSERT_TRUE(back);
    EXPECT_NEAR(hal::WrapRotationDeg(back->program.rows[1].rotation_deg - second), 0, 0.0051);
  }
}

TEST(ProgramCodec, ConventionsInNumbers) {
  hal::RegisterMap map = test::PlainMap();
  map.rotation_cumulative = true;
  map.rotation_sign_reversed = true;
  map.length_cumulative = true;
  RegisterImage image;
  const hal::ProgramBlock block{
      1, 1, {{{100, 0, 30, 20}, {50, 90, 40, 20}, {25, -30, 50, 20}, {10, 0, 0, {}}}}, 0};
  ASSERT_TRUE(EncodeProgram(map, map.staging, block, image));
  const auto raw = [&](int row, const hal::RegisterField& field) {
    hal::RegisterField at = field;
    at.address = static_cast<std::uint16_t>(1010 + row * 8 + field.address);
    return GetField(map, at, "x", image).value();
  };
  EXPECT_DOUBLE_EQ(raw(1, map.row_rotation_deg), 270);
  EXPECT_DOUBLE_EQ(raw(2, map.row_rotation_deg), 300);
  EXPECT_DOUBLE_EQ(raw(2, map.row_length_mm), 175);
  EXPECT_DOUBLE_EQ(raw(3, map.row_length_mm), 185);
}

// The worked example of drivers/README.md, byte by byte.
TEST(ProgramCodec, WorkedExampleOfTheCrc) {
  const hal::RegisterMap map = test::PlainMap();
  RegisterImage image;
  const hal::ProgramBlock block{7, 12, {{{100, 0, 45.5, 30}, {80.25, 0, 0, {}}}}, 0};
  ASSERT_TRUE(EncodeProgram(map, map.staging, block, image));
  const std::uint16_t rows[] = {0x0001, 0x86A0, 0, 0, 0x0000, 0xB1BC, 0x0000, 0x7530,
                                0x0001, 0x397A, 0, 0, 0,      0,      0,      0};
  for (std::uint16_t i = 0; i < 16; ++i) {
    EXPECT_EQ(*image.At(hal::RegisterSpace::kHolding, static_cast<std::uint16_t>(1010 + i)),
              rows[i]);
  }
  EXPECT_EQ(ProgramCrc(map, map.staging, 7, 12, 2, image), kWorkedExampleCrc);
  EXPECT_EQ(DecodeProgram(map, map.staging, image)->crc, kWorkedExampleCrc);
}

TEST(ProgramCodec, CrcChangesWithEveryUsedBitAndNoOther) {
  hal::RegisterMap map = test::PlainMap();
  map.row_stride = 10;  // two registers that no field uses
  RegisterImage image;
  std::mt19937_64 random(4);
  const hal::ProgramBlock block{7, 12, test::RandomProgram(random, 5), 0};
  ASSERT_TRUE(EncodeProgram(map, map.staging, block, image));
  const std::uint32_t crc = ProgramCrc(map, map.staging, 7, 12, 6, image);
  for (int i = 0; i < 60; ++i) {
    std::uint16_t* word =
        image.At(hal::RegisterSpace::kHolding, static_cast<std::uint16_t>(1010 + i));
    for (int bit = 0; bit < 16; ++bit) {
      *word ^= static_cast<std::uint16_t>(1 << bit);
      EXPECT_EQ(ProgramCrc(map, map.staging, 7, 12, 6, image) == crc, i % 10 >= 8);
      *word ^= static_cast<std::uint16_t>(1 << bit);
    }
  }
  EXPECT_NE(ProgramCrc(map, map.staging, 8, 12, 6, image), crc);
  EXPECT_NE(ProgramCrc(map, map.staging, 7, 13, 6, image), crc);
  EXPECT_NE(ProgramCrc(map, map.staging, 7, 12, 5, image), crc);
}

TEST(ProgramCodec, ZeroRadiusAndLostDigitsAreRefused) {
  hal::RegisterMap map = test::PlainMap();
  RegisterImage image;
  hal::ProgramBlock block{7, 12, {{{100, 0, 45, 0.0001}, {80, 0, 0, {}}}}, 0};
  EXPECT_FALSE(EncodeProgram(map, map.staging, block, image));
  block.program.rows[0].bend_radius_mm = 30;
  EXPECT_TRUE(EncodeProgram(map, map.staging, block, image));
  map.staging.part_number.type = RegisterType::kFloat32;
  block.part_number = 16777217;
  const auto lost = EncodeProgram(map, map.staging, block, image);
  ASSERT_FALSE(lost);
  EXPECT_NE(lost.error().message.find("part_number"), std::string::npos);
}

TEST(RegisterPlan, JoinsWhatTouchesAndSplitsWhatIsTooLong) {
  using hal::RegisterSpace;
  const auto plan = PlanRequests({{RegisterSpace::kHolding, 10, 2},
                                  {RegisterSpace::kInput, 12, 2},
                                  {RegisterSpace::kHolding, 12, 5},
                                  {RegisterSpace::kHolding, 11, 2},
                                  {RegisterSpace::kHolding, 18, 0},
                                  {RegisterSpace::kHolding, 20, 7}},
                                 4);
  const std::vector<RegisterRange> expected{{RegisterSpace::kHolding, 10, 4},
                                            {RegisterSpace::kHolding, 14, 3},
                                            {RegisterSpace::kHolding, 20, 4},
                                            {RegisterSpace::kHolding, 24, 3},
                                            {RegisterSpace::kInput, 12, 2}};
  EXPECT_EQ(plan, expected);
}

TEST(RegisterMap, ImpossibleMapsAreRefused) {
  const hal::RegisterMap good = test::PlainMap();
  EXPECT_TRUE(CheckRegisterMap(good));
  EXPECT_TRUE(CheckRegisterMap(test::OddMap()));
  EXPECT_TRUE(CheckRegisterMap(test::NoCommitMap()));
  const auto refused = [&](auto change) {
    hal::RegisterMap map = good;
    change(map);
    return !CheckRegisterMap(map);
  };
  EXPECT_TRUE(refused([](auto& m) { m.max_rows = 1; }));
  EXPECT_TRUE(refused([](auto& m) { m.max_read_registers = 126; }));
  EXPECT_TRUE(refused([](auto& m) { m.max_write_registers = 0; }));
  EXPECT_TRUE(refused([](auto& m) { m.max_write_registers = 1; }));  // commit has two
  EXPECT_TRUE(refused([](auto& m) { m.row_stride = 7; }));
  EXPECT_TRUE(refused([](auto& m) { m.row_angle_deg.scale = 0; }));
  EXPECT_TRUE(refused([](auto& m) { m.mode.scale = std::nan(""); }));
  EXPECT_TRUE(refused([](auto& m) { m.staging.rows_address = 65500; }));
  EXPECT_TRUE(refused([](auto& m) { m.active.crc.address = 65535; }));
  EXPECT_TRUE(refused([](auto& m) { m.active.crc.type = RegisterType::kUint16; }));
  EXPECT_TRUE(refused([](auto& m) { m.staging.rows_space = hal::RegisterSpace::kInput; }));
}

}  // namespace
}  // namespace bendloop::drivers
