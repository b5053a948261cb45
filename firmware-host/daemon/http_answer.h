// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <functional>
#include <map>
#include <string>
#include <string_view>

namespace bendloop::host {

// One page: its type, and what makes its text.
struct HttpPage {
  const char* type;
  std::function<std::string()> text;
};

using HttpPages = std::map<std::string, HttpPage, std::less<>>;  // by path

// A request without a body is not longer.
inline constexpr std::size_t kMostRequestBytes = 8192;

// Whether the head of a request is all there: it ends with an empty line.
bool IsWholeRequest(std::string_view request);

// The answer to a whole request, to be sent before the connection is closed. Only GET and HEAD,
// and, with `check_host`, only of this machine by its own name: a web page elsewhere that has a
// browser resolve its name to 127.0.0.1 (DNS rebinding) still says its own name in Host.
std::string AnswerTo(std::string_view request, const HttpPages& pages, bool check_host);

}  // namespace bendloop::host
