// SPDX-License-Identifier: Apache-2.0
// Stands in for libFuzzer where that is not to be had: gives the fuzz target the empty input, every
// seed, and a fixed set of truncated and altered copies of each seed, the same on every run.
#include <algorithm>
#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <random>
#include <vector>

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size);

namespace {

using Bytes = std::vector<std::uint8_t>;

constexpr std::size_t kBytesPerSeed = 4 << 20;  // copies of long seeds are fewer

void RunOne(const Bytes& bytes) {
  // A copy of the exact size lets the address sanitizer see a read past the end.
  const Bytes exact(bytes.begin(), bytes.end());
  LLVMFuzzerTestOneInput(exact.data(), exact.size());
}

std::size_t RunSeed(const Bytes& seed) {
  RunOne(seed);
  if (seed.empty()) return 1;
  const std::size_t copies = std::clamp<std::size_t>(kBytesPerSeed / seed.size(), 4, 200);
  std::mt19937 random(static_cast<std::mt19937::result_type>(seed.size()));
  for (std::size_t i = 0; i < copies; ++i) {
    Bytes copy = seed;
    if (i % 4 == 0) copy.resize(random() % copy.size());
    const std::size_t changes = copy.empty() ? 0 : random() % 4 + (i % 4 == 0 ? 0 : 1);
    for (std::size_t j = 0; j < changes; ++j) {
      static constexpr std::uint8_t kTelling[] = {0x00, 0x01, 0x7f, 0x80, 0xff, '\n', '9', '-'};
      // The start of a file holds its header: half of the changes go there.
      const std::size_t reach =
          random() % 2 ? copy.size() : std::min<std::size_t>(copy.size(), 256);
      const std::size_t at = random() % reach;
      copy[at] = random() % 2 ? kTelling[random() % std::size(kTelling)]
                              : static_cast<std::uint8_t>(copy[at] ^ (1u << random() % 8));
    }
    RunOne(copy);
  }
  return copies + 1;
}

}  // namespace

int main(int argc, char** argv) {
  namespace fs = std::filesystem;
  std::vector<fs::path> files;
  for (int i = 1; i < argc; ++i) {
    std::error_code none;
    if (fs::is_directory(argv[i], none)) {
      for (const auto& entry : fs::recursive_directory_iterator(argv[i])) {
        if (entry.is_regular_file()) files.push_back(entry.path());
      }
    } else if (fs::exists(argv[i], none)) {
      files.emplace_back(argv[i]);
    }
  }
  std::sort(files.begin(), files.end());
  RunOne({});
  std::size_t inputs = 1;
  for (const fs::path& file : files) {
    std::ifstream stream(file, std::ios::binary);
    inputs += RunSeed(Bytes(std::istreambuf_iterator<char>(stream), {}));
  }
  std::printf("%zu inputs from %zu seeds\n", inputs, files.size());
  return 0;
}
