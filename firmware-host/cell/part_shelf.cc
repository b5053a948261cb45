// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/cell/part_shelf.h"

#include <algorithm>
#include <filesystem>
#include <string>
#include <system_error>
#include <vector>

#include "config/load.h"
#include "firmware-host/cell/tube_rules.h"
#include "hal/folder.h"

namespace bendloop::host {
namespace {

namespace fs = std::filesystem;

// Somebody may be adding the file.
constexpr std::chrono::seconds kLookAgain{2};
// A folder with more is none of parts.
constexpr std::size_t kMostFiles = 10'000;

std::vector<fs::path> FilesOf(const fs::path& folder, std::error_code& error) {
  std::vector<fs::path> files;
  for (fs::path& path : hal::PathsIn(folder, error)) {
    if (path.extension() == ".toml" && files.size() < kMostFiles) files.push_back(std::move(path));
  }
  std::sort(files.begin(), files.end());
  return files;
}

}  // namespace

const PartShelf::Choice& PartShelf::Select(std::uint32_t number) {
  if (number == 0) number = own_->part_number;
  if (const auto known = known_.find(number); known != known_.end()) return known->second;
  const auto now = clock_.Now();
  if (missing_ == number && now - looked_at_ < kLookAgain) return last_;
  Choice found = Find(number);
  if (found.part) return known_.emplace(number, std::move(found)).first->second;
  looked_at_ = now;
  missing_ = number;
  last_ = std::move(found);
  return last_;
}

PartShelf::Choice PartShelf::Find(std::uint32_t number) const {
  const std::string what = "part number " + std::to_string(number);
  Choice choice;
  if (number == own_->part_number) choice.part = own_;
  if (cell_.parts_dir.empty()) {
    if (!choice.part) choice.detail = what + ": the cell file has no parts_dir";
    return choice;
  }
  std::error_code error;
  fs::path where = cell_.part_file;
  std::string spoilt;
  for (const fs::path& file : FilesOf(cell_.parts_dir, error)) {
    std::error_code none;
    if (fs::equivalent(file, cell_.part_file, none)) continue;
    auto part = config::LoadPart(file);
    if (!part) {
      if (spoilt.empty()) spoilt = "; " + part.error().message;
      continue;
    }
    if (part->part_number != number) continue;
    if (choice.part) {
      return {nullptr, AlarmCode::kAmbiguousPart,
              what + " stands in " + where.string() + " and in " + file.string()};
    }
    config::CellConfig cell = cell_;
    cell.part = std::move(*part);
    cell.part_file = where = file;
    const auto fits = config::CheckPartFits(cell);
    auto plan = fits ? MakePartPlan(cell) : hal::Fail(fits.error());
    if (!plan) return {nullptr, AlarmCode::kUnknownPart, plan.error().message};
    if (!WhyNothingIsCorrected(cell).empty()) plan->corrects = false;
    choice.part = std::make_shared<const PartPlan>(std::move(*plan));
  }
  if (choice.part) return choice;
  choice.detail = what + ": no file of " + cell_.parts_dir.string() + " has it" +
                  (error ? ", which cannot be read: " + error.message() : "") + spoilt;
  return choice;
}

}  // namespace bendloop::host
