// SPDX-License-Identifier: Apache-2.0
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <numbers>
#include <set>
#include <string>

#include "config/digest.h"
#include "config/fields.h"
#include "config/load.h"
#include "config/text_writer.h"
#include "config_text.h"
#include "hal/spine.h"

namespace bendloop::config {
namespace {

using ::testing::HasSubstr;

TEST(Shipped, EveryFileIsValid) {
  std::set<FileKind> kinds;
  int files = 0;
  for (const auto& entry : std::filesystem::recursive_directory_iterator(ShippedConfig())) {
    if (entry.path().extension() != ".toml" && entry.path().extension() != ".eds") continue;
    const auto kind = ValidateFile(entry.path());
    ASSERT_TRUE(kind) << kind.error().message;
    kinds.insert(*kind);
    ++files;
  }
  EXPECT_EQ(kinds.size(), 4u);
  EXPECT_GE(files, 9);
}

TEST(Shipped, DemoCellLoadsWithItsPartAndMap) {
  const auto cell = LoadCell(ShippedConfig() / "cells/demo.toml");
  ASSERT_TRUE(cell) << cell.error().message;
  EXPECT_EQ(cell->bender.link, BenderKind::kSimulated);
  EXPECT_EQ(cell->part.part_number, 1001u);
  EXPECT_EQ(cell->bender.register_map.staging.rows_address, 1010);
  EXPECT_TRUE(cell->state_dir.is_absolute());
  EXPECT_EQ(cell->record.directory, cell->state_dir / "sessions");
}

TEST(Shipped, DemoPartIsAFourBendTubeThatDoesNotTouchItself) {
  const auto part = LoadPart(ShippedConfig() / "parts/demo.toml");
  ASSERT_TRUE(part) << part.error().message;
  EXPECT_EQ(part->rows.bend_count(), 4u);
  const double length_mm = hal::SpineLength(part->rows);
  EXPECT_GT(length_mm, 500);
  EXPECT_LT(length_mm, 700);
  std::vector<Eigen::Vector3d> spine;
  for (const hal::SpineSegment& segment : hal::SpineSegments(part->rows, {})) {
    for (double at = 0; at < segment.length_mm; at += 1) spine.push_back(segment.PointAt(at));
  }
  const auto apart = static_cast<std::size_t>(8 * part->pipe_radius_mm);  // along the spine
  for (std::size_t i = 0; i < spine.size(); ++i) {
    for (std::size_t j = i + apart; j < spine.size(); ++j) {
      ASSERT_GT((spine[i] - spine[j]).norm(), 3 * part->pipe_radius_mm) << i << " and " << j;
    }
  }
}

// Two maps that share little: whatever reads an address from the wrong place shows with one.
TEST(Shipped, MapsDiffer) {
  const auto a = LoadRegisterMap(ShippedConfig() / "register-maps/default.toml");
  const auto b = LoadRegisterMap(ShippedConfig() / "register-maps/siemens-like.toml");
  ASSERT_TRUE(a) << a.error().message;
  ASSERT_TRUE(b) << b.error().message;
  EXPECT_NE(a->high_word_first, b->high_word_first);
  EXPECT_NE(a->mode.space, b->mode.space);
  EXPECT_NE(a->mode_idle, b->mode_idle);
  EXPECT_NE(a->row_length_mm.type, b->row_length_mm.type);
  EXPECT_NE(a->row_length_mm.address, b->row_length_mm.address);
  EXPECT_NE(a->rotation_cumulative, b->rotation_cumulative);
  EXPECT_NE(a->rotation_sign_reversed, b->rotation_sign_reversed);
  EXPECT_EQ(a->row_angle_deg.scale, 0.001);
  EXPECT_TRUE(a->commit);
}

// README.md lists every key with its default: `| key | unit | default | range | meaning |`.
TEST(Shipped, ReadmeListsEveryKeyWithItsDefault) {
  const std::string readme = ReadAll(ShippedConfig() / "README.md");
  const auto check = [&](const std::string& effective) {
    std::istringstream lines(effective);
    for (std::string line; std::getline(lines, line);) {
      const std::string path = line.substr(0, line.find(" = "));
      std::string value = line.substr(line.find(" = ") + 3);
      const std::size_t dot = path.rfind('.');
      const std::string key = dot == std::string::npos ? path : path.substr(dot + 1);
      const std::string table = dot == std::string::npos ? "" : path.substr(0, dot);
      std::size_t section = 0;
      if (!table.empty()) {
        section = readme.find("`[" + table + "]`");
        ASSERT_NE(section, std::string::npos) << "no section `[" << table << "]`";
      }
      const std::size_t row = readme.find("\n| `" + key + "` ", section);
      ASSERT_NE(row, std::string::npos) << "no row for " << path;
      const std::string text = readme.substr(row + 1, readme.find('\n', row + 1) - row - 1);
      if (value == "\"\"" || value == "none" || text.find("| required |") != std::string::npos) {
        continue;
      }
      if (value.front() == '"') value = value.substr(1, value.size() - 2);
      EXPECT_THAT(text, HasSubstr("| " + value + " |")) << path;
    }
  };
  TextWriter cell_writer;
  CellConfig cell;
  VisitCell(cell_writer, cell);
  check(cell_writer.text());
  TextWriter part_writer;
  PartConfig part;
  VisitPart(part_writer, part);
  std::string part_text = part_writer.text();
  check(part_text);
}

// A device may call itself "../../sda": only udev's own copy of its serial number, without slashes,
// may become a part of a path.
TEST(UdevRule, TakesNoDevicesWordIntoAPath) {
  std::ifstream file(ShippedConfig() / "70-bendloop-scanner.rules");
  std::size_t links = 0;
  for (std::string line; std::getline(file, line);) {
    const std::size_t link = line.find("SYMLINK+=");
    if (line.starts_with('#') || link == std::string::npos) continue;
    ++links;
    const std::string value = line.substr(link);
    EXPECT_EQ(value, "SYMLINK+=\"bendloop/scanner-$env{ID_SERIAL_SHORT}\"");
  }
  EXPECT_EQ(links, 1u);
}

TEST(Digest, IsTheSameForTheSameSettingsAndChangesWithThem) {
  const auto cell = LoadCell(ShippedConfig() / "cells/demo.toml");
  ASSERT_TRUE(cell) << cell.error().message;
  const std::string digest = Digest(*cell);
  EXPECT_EQ(digest.size(), 16u);
  EXPECT_EQ(digest, Digest(*cell));
  const auto changed = [&](auto change) {
    CellConfig other = *cell;
    change(other);
    return Digest(other) != digest;
  };
  EXPECT_TRUE(changed([](CellConfig& c) { c.correction.gain_angle += 1e-9; }));
  EXPECT_TRUE(changed([](CellConfig& c) { c.part.rows.rows[2].angle_deg += 1e-9; }));
  EXPECT_TRUE(changed([](CellConfig& c) { c.part.tolerance.surface_mm = 0.9; }));
  EXPECT_TRUE(changed([](CellConfig& c) { c.bender.register_map.rotation_cumulative = true; }));
  EXPECT_TRUE(changed([](CellConfig& c) { c.interlocks.max_gap_mm += 1; }));
  EXPECT_TRUE(changed([](CellConfig& c) { c.bender.link = BenderKind::kCanIsotp; }));
  EXPECT_FALSE(changed([](CellConfig& c) { c.bender.host = "elsewhere"; }));
  EXPECT_FALSE(changed([](CellConfig& c) { c.scanner.port += 1; }));
  EXPECT_FALSE(changed([](CellConfig& c) { c.state_dir = "/elsewhere"; }));
  EXPECT_FALSE(changed([](CellConfig& c) { c.record.directory = "/elsewhere"; }));
  EXPECT_FALSE(changed([](CellConfig& c) { c.part.file = "/elsewhere"; }));
}

// FNV-1a of a known text: the digest of a session must mean the same in ten years.
TEST(Digest, EffectiveTextIsReadable) {
  const auto cell = LoadCell(ShippedConfig() / "cells/demo.toml");
  ASSERT_TRUE(cell) << cell.error().message;
  const std::string text = EffectiveText(*cell);
  EXPECT_THAT(text, HasSubstr("\ncorrection.gain_angle = 0.8\n"));
  EXPECT_THAT(text, HasSubstr("\npart_file.row[2].angle_deg = 90\n"));
  EXPECT_THAT(text, HasSubstr("\nregister_map_file.row.angle_deg.scale = 0.001\n"));
}

}  // namespace
}  // namespace bendloop::config
