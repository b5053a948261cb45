// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/daemon/http_answer.h"

#include <algorithm>
#include <optional>

#include "hal/text.h"

namespace bendloop::host {
namespace {

std::string Answer(const char* status, const char* type, const std::string& body, bool has_body) {
  return std::string("HTTP/1.1 ") + status + "\r\nContent-Type: " + type +
         "\r\nContent-Length: " + std::to_string(body.size()) +
         "\r\nConnection: close\r\nCache-Control: no-store\r\nX-Content-Type-Options: "
         "nosniff\r\n\r\n" +
         (has_body ? body : "");
}

std::string Refusal(const char* status, const std::string& why) {
  return Answer(status, "text/plain", why + "\n", true);
}

std::string_view TakeLine(std::string_view& text) {
  const std::size_t end = std::min(text.find('\n'), text.size());
  std::string_view line = text.substr(0, end);
  text.remove_prefix(std::min(end + 1, text.size()));
  if (line.ends_with('\r')) line.remove_suffix(1);
  return line;
}

std::string_view TakeWord(std::string_view& text) {
  const std::size_t end = std::min(text.find(' '), text.size());
  const std::string_view word = text.substr(0, end);
  text.remove_prefix(std::min(end + 1, text.size()));
  return word;
}

// What the lines of the head say under `name` (small letters).
std::optional<std::string> HeaderOf(std::string_view head, std::string_view name) {
  while (!head.empty()) {
    const std::string_view line = TakeLine(head);
    const std::size_t colon = line.find(':');
    if (colon == std::string_view::npos) continue;
    if (hal::Lower(hal::Trimmed(line.substr(0, colon))) == name) {
      return hal::Lower(hal::Trimmed(line.substr(colon + 1)));
    }
  }
  return std::nullopt;
}

// With any port: who comes through a tunnel has another one.
bool IsThisMachine(std::string_view host) {
  const std::size_t bracket = host.find(']');
  const std::size_t colon = host.rfind(':');
  if (colon != std::string_view::npos && (bracket == std::string_view::npos || colon > bracket)) {
    host = host.substr(0, colon);
  }
  return host == "127.0.0.1" || host == "localhost" || host == "[::1]";
}

}  // namespace

bool IsWholeRequest(std::string_view request) {
  return request.find("\r\n\r\n") != std::string_view::npos ||
         request.find("\n\n") != std::string_view::npos;
}

std::string AnswerTo(std::string_view request, const HttpPages& pages, bool check_host) {
  std::string_view line = TakeLine(request);
  const std::string_view method = TakeWord(line);
  std::string_view target = TakeWord(line);
  if (!line.starts_with("HTTP/1.")) {
    return Refusal("400 Bad Request", "expected GET PATH HTTP/1.1");
  }
  if (method != "GET" && method != "HEAD") {
    return Refusal("405 Method Not Allowed", "expected GET or HEAD");
  }
  const auto host = HeaderOf(request, "host");
  if (check_host && host && !IsThisMachine(*host)) {
    return Refusal("403 Forbidden", "expected Host 127.0.0.1 or localhost");
  }
  target = target.substr(0, target.find('?'));
  const auto page = pages.find(target);
  if (page == pages.end()) {
    std::string known;
    for (const auto& [path, each] : pages) known += " " + path;
    return Refusal("404 Not Found", "expected one of" + known);
  }
  return Answer("200 OK", page->second.type, page->second.text(), method == "GET");
}

}  // namespace bendloop::host
