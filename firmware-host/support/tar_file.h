// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <string_view>

#include "hal/result.h"

struct archive;

namespace bendloop::host {

// Writes one tar, compressed by gzip (libarchive). Errors are kDevice.
class TarWriter {
 public:
  static hal::Result<TarWriter> Create(const std::filesystem::path& path);

  hal::Result<void> AddText(const std::string& name, std::string_view text);
  // As long as the file is now; one that grows meanwhile is cut there, one that shrinks is filled
  // up with zeros.
  hal::Result<void> AddFile(const std::string& name, const std::filesystem::path& file);
  // The last call: without it the tar is not whole.
  hal::Result<void> Finish();

 private:
  struct Close {
    void operator()(archive* writer) const;
  };
  TarWriter(archive* writer, std::filesystem::path path)
      : archive_(writer), path_(std::move(path)) {}
  hal::Result<void> Begin(const std::string& name, std::uint64_t bytes);
  hal::Error Failed() const;

  std::unique_ptr<archive, Close> archive_;
  std::filesystem::path path_;
};

// Whether it is an archive and no session; by its first bytes, not by its name.
bool IsTar(const std::filesystem::path& path);

// Unpacks the plain files of a tar, compressed or not, below `into`. A stranger may have made it:
// names that lead elsewhere, links, devices and more than `most_bytes` are refused (kBadInput).
hal::Result<void> Unpack(const std::filesystem::path& tar, const std::filesystem::path& into,
                         std::uint64_t most_bytes);

}  // namespace bendloop::host
