// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/support/tar_file.h"

#include <archive.h>
#include <archive_entry.h>

#include <algorithm>
#include <array>
#include <ctime>
#include <fstream>
#include <system_error>
#include <vector>

namespace bendloop::host {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kPiece = 64u << 10;

hal::Error ErrorOf(archive* tar, const fs::path& path, hal::ErrorKind kind) {
  const char* const words = tar == nullptr ? nullptr : archive_error_string(tar);
  return {kind, path.string() + ": " + (words == nullptr ? "out of memory" : words)};
}

// A name that stays below the folder that it is unpacked to.
bool IsHarmless(const fs::path& name) {
  return !name.empty() && name.is_relative() &&
         std::none_of(name.begin(), name.end(), [](const fs::path& step) { return step == ".."; });
}

struct FreeReader {
  void operator()(archive* reader) const { archive_read_free(reader); }
};
using Reader = std::unique_ptr<archive, FreeReader>;

hal::Result<Reader> OpenTar(const fs::path& path) {
  Reader reader(archive_read_new());
  archive_read_support_filter_gzip(reader.get());
  archive_read_support_filter_zstd(reader.get());
  archive_read_support_format_tar(reader.get());
  if (archive_read_open_filename(reader.get(), path.c_str(), kPiece) != ARCHIVE_OK) {
    return hal::Fail(ErrorOf(reader.get(), path, hal::ErrorKind::kBadInput));
  }
  return reader;
}

hal::Result<void> UnpackEntry(archive* reader, const fs::path& tar, const fs::path& to,
                              std::uint64_t& left) {
  std::error_code error;
  fs::create_directories(to.parent_path(), error);
  std::ofstream file(to, std::ios::binary);
  std::vector<char> piece(kPiece);
  for (;;) {
    const auto bytes = archive_read_data(reader, piece.data(), piece.size());
    if (bytes < 0) return hal::Fail(ErrorOf(reader, tar, hal::ErrorKind::kBadInput));
    if (bytes == 0) break;
    if (static_cast<std::uint64_t>(bytes) > left) {
      return hal::Fail(hal::ErrorKind::kBadInput, tar.string() + ": is too large when unpacked");
    }
    left -= static_cast<std::uint64_t>(bytes);
    file.write(piece.data(), bytes);
  }
  if (file.flush()) return {};
  return hal::Fail(hal::ErrorKind::kDevice, to.string() + ": cannot be written; check the disk");
}

}  // namespace

void TarWriter::Close::operator()(archive* writer) const { archive_write_free(writer); }

hal::Error TarWriter::Failed() const {
  return ErrorOf(archive_.get(), path_, hal::ErrorKind::kDevice);
}

hal::Result<TarWriter> TarWriter::Create(const fs::path& path) {
  TarWriter writer(archive_write_new(), path);
  archive* const tar = writer.archive_.get();
  if (tar == nullptr || archive_write_add_filter_gzip(tar) != ARCHIVE_OK ||
      archive_write_set_format_pax_restricted(tar) != ARCHIVE_OK ||
      archive_write_open_filename(tar, path.c_str()) != ARCHIVE_OK) {
    return hal::Fail(writer.Failed());
  }
  return writer;
}

hal::Result<void> TarWriter::Begin(const std::string& name, std::uint64_t bytes) {
  const std::unique_ptr<archive_entry, void (*)(archive_entry*)> entry(archive_entry_new(),
                                                                       archive_entry_free);
  archive_entry_set_pathname(entry.get(), name.c_str());
  archive_entry_set_size(entry.get(), static_cast<la_int64_t>(bytes));
  archive_entry_set_filetype(entry.get(), AE_IFREG);
  archive_entry_set_perm(entry.get(), 0640);
  archive_entry_set_mtime(entry.get(), std::time(nullptr), 0);
  if (archive_write_header(archive_.get(), entry.get()) != ARCHIVE_OK) return hal::Fail(Failed());
  return {};
}

hal::Result<void> TarWriter::AddText(const std::string& name, std::string_view text) {
  if (auto begun = Begin(name, text.size()); !begun) return begun;
  if (archive_write_data(archive_.get(), text.data(), text.size()) < 0) return hal::Fail(Failed());
  return {};
}

hal::Result<void> TarWriter::AddFile(const std::string& name, const fs::path& path) {
  std::error_code error;
  const std::uint64_t bytes = fs::file_size(path, error);
  std::ifstream file(path, std::ios::binary);
  if (error || !file) {
    return hal::Fail(hal::ErrorKind::kDevice,
                     path.string() + ": cannot be read" + (error ? ": " + error.message() : ""));
  }
  if (auto begun = Begin(name, bytes); !begun) return begun;
  std::vector<char> piece(kPiece);
  for (std::uint64_t left = bytes; left > 0;) {
    file.read(piece.data(), static_cast<std::streamsize>(std::min<std::uint64_t>(left, kPiece)));
    if (file.gcount() == 0) break;
    const auto got = static_cast<std::size_t>(file.gcount());
    if (archive_write_data(archive_.get(), piece.data(), got) < 0) return hal::Fail(Failed());
    left -= got;
  }
  // Fills up what is missing.
  if (archive_write_finish_entry(archive_.get()) != ARCHIVE_OK) return hal::Fail(Failed());
  return {};
}

hal::Result<void> TarWriter::Finish() {
  if (archive_write_close(archive_.get()) != ARCHIVE_OK) return hal::Fail(Failed());
  return {};
}

bool IsTar(const fs::path& path) {
  const auto reader = OpenTar(path);
  archive_entry* entry = nullptr;
  return reader && archive_read_next_header(reader->get(), &entry) == ARCHIVE_OK;
}

hal::Result<void> Unpack(const fs::path& tar, const fs::path& into, std::uint64_t most_bytes) {
  const auto reader = OpenTar(tar);
  if (!reader) return hal::Fail(reader.error());
  std::uint64_t left = most_bytes;
  archive_entry* entry = nullptr;
  int read = ARCHIVE_OK;
  while ((read = archive_read_next_header(reader->get(), &entry)) == ARCHIVE_OK) {
    const char* const text = archive_entry_pathname(entry);
    const fs::path name = text == nullptr ? "" : text;
    if (archive_entry_filetype(entry) == AE_IFDIR) continue;
    if (archive_entry_filetype(entry) != AE_IFREG || archive_entry_hardlink(entry) != nullptr ||
        !IsHarmless(name)) {
      return hal::Fail(hal::ErrorKind::kBadInput,
                       tar.string() + ": '" + name.string() +
                           "' in it is no plain file below it; it is no support bundle");
    }
    if (auto done = UnpackEntry(reader->get(), tar, into / name, left); !done) return done;
  }
  if (read == ARCHIVE_EOF) return {};
  return hal::Fail(ErrorOf(reader->get(), tar, hal::ErrorKind::kBadInput));
}

}  // namespace bendloop::host
