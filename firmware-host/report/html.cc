// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/report/html.h"

#include <algorithm>
#include <bit>
#include <cmath>

namespace bendloop::host {

std::string Escape(std::string_view text) {
  std::string out;
  out.reserve(text.size());
  for (const char c : text) {
    switch (c) {
      case '&':
        out += "&amp;";
        break;
      case '<':
        out += "&lt;";
        break;
      case '>':
        out += "&gt;";
        break;
      case '"':
        out += "&quot;";
        break;
      case '\'':
        out += "&#39;";
        break;
      default:
        if (static_cast<unsigned char>(c) >= 0x20 || c == '\n' || c == '\t') out += c;
    }
  }
  return out;
}

std::string ScriptSafe(std::string json) {
  // "<" only ever stands inside a string of JSON text, where its escape means the same.
  for (std::size_t at = 0; (at = json.find('<', at)) != std::string::npos; at += 6) {
    json.replace(at, 1, "\\u003c");
  }
  return json;
}

std::string Base64(std::span<const float> values) {
  static constexpr char kDigits[] =
      "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string out;
  out.reserve(values.size() * 6);
  std::uint32_t group = 0;
  int bytes = 0;
  const auto flush = [&] {
    for (int i = 0; i < 4; ++i) {
      out += i <= bytes ? kDigits[(group >> (18 - 6 * i)) & 63] : '=';
    }
    group = 0;
    bytes = 0;
  };
  for (const float value : values) {
    const auto bits = std::bit_cast<std::uint32_t>(value);
    for (int shift = 0; shift < 32; shift += 8) {
      group |= ((bits >> shift) & 255) << (16 - 8 * bytes);
      if (++bytes == 3) flush();
    }
  }
  if (bytes > 0) flush();
  return out;
}

int TickDecimals(double value) {
  double ten = 1;
  for (int decimals = 0; decimals < 4; ++decimals, ten *= 10) {
    const double half = value / 2 * ten;
    if (std::abs(half - std::round(half)) < 1e-6 * std::max(1.0, std::abs(half))) return decimals;
  }
  return 4;
}

StateMark MarkOf(pipeline::ToleranceState state) {
  switch (state) {
    case pipeline::ToleranceState::kIn:
      return {"in", "\u2713", "in"};
    case pipeline::ToleranceState::kOut:
      return {"out", "\u2717", "out"};
    case pipeline::ToleranceState::kUndecided:
      return {"undecided", "?", "undecided"};
    case pipeline::ToleranceState::kNotJudged:
      return {"none", "", ""};
  }
  return {"none", "", ""};
}

StateMark MarkOf(pipeline::Verdict verdict) {
  switch (verdict) {
    case pipeline::Verdict::kPass:
      return {"in", "\u2713", "Pass"};
    case pipeline::Verdict::kFail:
      return {"out", "\u2717", "Fail"};
    case pipeline::Verdict::kUndecided:
      return {"undecided", "?", "Undecided"};
  }
  return {"none", "", ""};
}

}  // namespace bendloop::host
