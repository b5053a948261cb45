// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/daemon/setter_box.h"

#include <fcntl.h>
#include <pwd.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <cstdlib>
#include <utility>
#include <vector>

#include "firmware-host/console/output_file.h"
#include "firmware-host/console/whole_file.h"
#include "firmware-host/ledger/moment.h"
#include "firmware-host/result/json.h"
#include "firmware-host/result/json_reader.h"
#include "hal/folder.h"

namespace bendloop::host {
namespace {

namespace fs = std::filesystem;

constexpr const char* kRequestEnd = ".request.json";
constexpr const char* kAnswerEnd = ".answer.json";
constexpr std::size_t kMostBytes = 65536;

std::string UserName(uid_t id) {
  char buffer[1024];
  passwd entry{};
  passwd* found = nullptr;
  if (::getpwuid_r(id, &entry, buffer, sizeof buffer, &found) == 0 && found != nullptr) {
    return found->pw_name;
  }
  return "uid " + std::to_string(id);
}

hal::ErrorKind KindOf(std::size_t code) {
  switch (code) {
    case 1:
      return hal::ErrorKind::kRefused;
    case 3:
      return hal::ErrorKind::kBadInput;
    case 4:
      return hal::ErrorKind::kDevice;
    default:
      return hal::ErrorKind::kInternal;
  }
}

hal::Result<SetterAnswer> ReadAnswer(const fs::path& file) {
  const auto text = ReadWholeFile(file, kMostBytes);
  if (!text) return hal::Fail(text.error());
  const Json json = Json::parse(*text, nullptr, false);
  std::optional<hal::Error> error;
  const JsonReader reader(json, file.string(), error);
  SetterAnswer answer;
  const std::size_t code = reader.At("exit_code").Count();
  answer.text = reader.At("text").Text();
  if (code != 0) answer.error = KindOf(code);
  if (error) return hal::Fail(*error);
  return answer;
}

// As the request's file says; its owner is who asked.
hal::Result<SetterRequest> ReadRequest(const fs::path& file) {
  struct stat facts {};
  if (::lstat(file.c_str(), &facts) != 0 || !S_ISREG(facts.st_mode)) {
    return hal::Fail(hal::ErrorKind::kBadInput, file.string() + ": expected a plain file");
  }
  const auto text = ReadWholeFile(file, kMostBytes);
  if (!text) return hal::Fail(text.error());
  const Json json = Json::parse(*text, nullptr, false);
  std::optional<hal::Error> error;
  const JsonReader reader(json, file.string(), error);
  SetterRequest request;
  const auto wish = WishNamed(reader.At("request").Text());
  if (!wish) reader.At("request").WrongText("\"lot new\", \"undo\" or another request");
  if (reader.Has("part_number")) request.part_number = reader.At("part_number").Count32();
  if (error) return hal::Fail(*error);
  request.wish = *wish;
  request.who = UserName(facts.st_uid);
  request.time = UtcText(SystemMoment().unix_ms);
  return request;
}

std::string AnswerText(const SetterAnswer& answer) {
  const Json json = {{"schema", "bendloop.answer/1"},
                     {"exit_code", answer.error ? hal::ExitCode(*answer.error) : 0},
                     {"text", answer.text}};
  return Dump(json) + "\n";
}

// What is answered where memory ends in the middle of granting: made before the request is taken,
// and given without any.
class CutAnswer {
 public:
  explicit CutAnswer(const fs::path& answer)
      : place_(answer.string()),
        beside_(place_ + ".new"),
        text_(AnswerText({hal::ErrorKind::kDevice,
                          "out of memory in the middle of it: it may be done, or not; see "
                          "'bendloop status' and 'bendloop lot show' before you ask again"})) {}

  void Give() const noexcept {
    const int file = ::open(beside_.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0666);
    if (file < 0) return;
    const bool is_whole =
        ::write(file, text_.data(), text_.size()) == static_cast<ssize_t>(text_.size());
    ::close(file);
    is_whole ? ::rename(beside_.c_str(), place_.c_str()) : ::unlink(beside_.c_str());
  }

 private:
  const std::string place_, beside_, text_;
};

}  // namespace

std::string OwnUser() {
  const char* caller = std::getenv("SUDO_USER");
  const std::string own = UserName(::geteuid());
  return caller != nullptr && *caller != '\0' ? std::string(caller) + " as " + own : own;
}

hal::Result<SetterAnswer> SetterBox::Ask(SetterWish wish, std::uint32_t part_number,
                                         std::chrono::nanoseconds patience,
                                         hal::Clock& clock) const {
  const std::string name =
      std::to_string(SystemMoment().unix_ms) + "-" + std::to_string(::getpid());
  const fs::path request = box_ / (name + kRequestEnd);
  const fs::path answer = box_ / (name + kAnswerEnd);
  Json json = {{"schema", "bendloop.request/1"}, {"request", Name(wish)}};
  if (part_number != 0) json["part_number"] = part_number;
  if (::access(box_.c_str(), W_OK) != 0 && errno == EACCES) {
    return hal::Fail(hal::ErrorKind::kDevice,
                     box_.string() + ": " + OwnUser() +
                         " may not ask this daemon; root may, and the members of its group: "
                         "'adduser NAME bendloop', and log in again");
  }
  if (auto written = WriteOutputFile(request, Dump(json) + "\n"); !written) {
    return hal::Fail(written.error());
  }
  const auto deadline = clock.Now() + patience;
  std::error_code none;
  bool is_taken = false;
  while (!fs::exists(answer, none)) {
    is_taken = is_taken || !fs::exists(request, none);
    // What is taken will be answered: by the bender's timeouts at the latest.
    if (clock.Now() > deadline + (is_taken ? patience : std::chrono::nanoseconds{0})) {
      const bool is_withdrawn = fs::remove(request, none);
      return hal::Fail(hal::ErrorKind::kDevice,
                       std::string(is_withdrawn ? "the daemon did not take the request, which is "
                                                  "withdrawn"
                                                : "the daemon took the request and has not "
                                                  "answered; see its log") +
                           ": it serves requests between two parts");
    }
    clock.SleepFor(std::chrono::milliseconds(20));
  }
  auto read = ReadAnswer(answer);
  fs::remove(answer, none);
  return read;
}

void SetterBox::Serve(const std::function<bool(const SetterRequest&)>& may_be_granted,
                      const std::function<SetterAnswer(const SetterRequest&)>& grant) const {
  std::error_code error;
  std::vector<fs::path> waiting;
  for (fs::path& path : hal::PathsIn(box_, error)) {
    if (path.filename().string().ends_with(kRequestEnd)) waiting.push_back(std::move(path));
  }
  std::sort(waiting.begin(), waiting.end());  // by their time
  for (const fs::path& file : waiting) {
    const auto request = ReadRequest(file);
    if (request && !may_be_granted(*request)) continue;
    std::string name = file.filename().string();
    name.resize(name.size() - std::string_view(kRequestEnd).size());
    const fs::path place = box_ / (name + kAnswerEnd);
    const CutAnswer cut(place);
    // Gone before it is granted: what is granted twice would be sent twice.
    if (!fs::remove(file, error)) continue;
    try {
      const SetterAnswer answer =
          request ? grant(*request) : SetterAnswer{request.error().kind, request.error().message};
      // Nobody may be waiting any more; the log has it in any case.
      static_cast<void>(WriteOutputFile(place, AnswerText(answer)));
    } catch (...) {
      cut.Give();
      throw;
    }
  }
}

}  // namespace bendloop::host
