// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/console/suggestion.h"

#include <algorithm>
#include <cstddef>

namespace bendloop::host {
namespace {

// Letters put in, left out, changed or swapped with the next one (optimal string alignment).
std::size_t Edits(std::string_view a, std::string_view b) {
  std::vector<std::vector<std::size_t>> edits(a.size() + 1, std::vector<std::size_t>(b.size() + 1));
  for (std::size_t i = 0; i <= a.size(); ++i) edits[i][0] = i;
  for (std::size_t j = 0; j <= b.size(); ++j) edits[0][j] = j;
  for (std::size_t i = 1; i <= a.size(); ++i) {
    for (std::size_t j = 1; j <= b.size(); ++j) {
      const std::size_t changed = edits[i - 1][j - 1] + (a[i - 1] == b[j - 1] ? 0 : 1);
      edits[i][j] = std::min({edits[i - 1][j] + 1, edits[i][j - 1] + 1, changed});
      if (i > 1 && j > 1 && a[i - 1] == b[j - 2] && a[i - 2] == b[j - 1]) {
        edits[i][j] = std::min(edits[i][j], edits[i - 2][j - 2] + 1);
      }
    }
  }
  return edits[a.size()][b.size()];
}

constexpr std::size_t kLongestWord = 64;  // what is longer was not mistyped

}  // namespace

std::string Nearest(std::string_view typed, const std::vector<std::string>& words) {
  if (typed.size() > kLongestWord) return "";
  std::string nearest;
  std::size_t fewest = 0;
  for (const std::string& word : words) {
    const bool begun = typed.size() >= 3 && std::string_view(word).starts_with(typed);
    const std::size_t edits = begun ? 1 : Edits(typed, word);
    if (3 * edits > std::max(word.size(), std::size_t{3})) continue;
    if (nearest.empty() || edits < fewest) {
      nearest = word;
      fewest = edits;
    }
  }
  return nearest;
}

}  // namespace bendloop::host
