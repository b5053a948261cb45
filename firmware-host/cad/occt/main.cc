// SPDX-License-Identifier: Apache-2.0
// `bendloop-cad`: all that needs OpenCASCADE, in a process of its own, which `bendloop nominal` and
// `bendloop export` run with a time limit: whatever a damaged file does to it, they live on.
#include <signal.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <unistd.h>

#include <Message.hxx>
#include <Message_Messenger.hxx>
#include <Message_Printer.hxx>
#include <OSD.hxx>
#include <Standard_Failure.hxx>
#include <cstdio>
#include <exception>
#include <iostream>
#include <iterator>
#include <string>

#include "firmware-host/cad/occt/read_shape.h"
#include "firmware-host/cad/occt/write_step.h"

namespace {

using nlohmann::json;

// Of memory and of processor time: more than any tube needs, less than a workstation has.
constexpr rlim_t kMostMemoryBytes = rlim_t{4} << 30;
constexpr rlim_t kMostSeconds = 300;

void Limit() {
  const rlimit memory{kMostMemoryBytes, kMostMemoryBytes}, time{kMostSeconds, kMostSeconds};
  const rlimit core{0, 0};
  setrlimit(RLIMIT_AS, &memory);
  setrlimit(RLIMIT_CPU, &time);
  setrlimit(RLIMIT_CORE, &core);
}

// What OpenCASCADE complains about, for the error that it ends with.
class Complaints : public Message_Printer {
  DEFINE_STANDARD_RTTI_INLINE(Complaints, Message_Printer)
 public:
  std::string text;

 protected:
  void send(const TCollection_AsciiString& what, const Message_Gravity gravity) const override {
    if (gravity < Message_Alarm) return;
    std::string& all = const_cast<Complaints*>(this)->text;
    if (all.size() < 300) all += (all.empty() ? "" : "; ") + std::string(what.ToCString());
  }
};

json Answer(int argc, char** argv) {
  const std::string verb = argc > 1 ? argv[1] : "";
  if (verb == "read" && argc == 3) return bendloop::cad::ReadShape(argv[2]);
  if (verb == "read" && argc == 4) return bendloop::cad::ReadShape(argv[2], std::stod(argv[3]));
  if (verb == "write" && argc == 3) {
    const std::string text{std::istreambuf_iterator<char>(std::cin), {}};
    bendloop::cad::WriteStep(json::parse(text), argv[2]);
    return {{"written", argv[2]}};
  }
  return {{"usage",
           "bendloop-cad read FILE [STEP_MM], or bendloop-cad write FILE with a tube as JSON on "
           "standard input; bendloop nominal and bendloop export run it"}};
}

}  // namespace

int main(int argc, char** argv) {
  Limit();
  // OpenCASCADE speaks on standard output; that is for the answer alone.
  std::FILE* const out = fdopen(dup(STDOUT_FILENO), "w");
  if (out == nullptr || dup2(STDERR_FILENO, STDOUT_FILENO) < 0) return 5;
  const Handle(Message_Messenger) messenger = Message::DefaultMessenger();
  messenger->ChangePrinters().Clear();
  const Handle(Complaints) complaints = new Complaints;
  messenger->AddPrinter(complaints);
  json answer;
  try {
    OSD::SetSignal(false);  // a fault inside OpenCASCADE becomes a Standard_Failure
    answer = Answer(argc, argv);
  } catch (const Standard_Failure& failure) {
    const char* what = failure.GetMessageString();
    answer = {{"error", std::string("OpenCASCADE gave up: ") +
                            (what != nullptr && *what ? what : failure.DynamicType()->Name())}};
  } catch (const std::exception& error) {
    answer = {{"error", error.what()}};
  }
  if (answer.contains("error") && !complaints->text.empty()) answer["said"] = complaints->text;
  const std::string text = answer.dump(-1, ' ', false, json::error_handler_t::replace);
  std::fwrite(text.data(), 1, text.size(), out);
  std::fputc('\n', out);
  const bool written = std::fclose(out) == 0;
  _exit(written ? (answer.contains("usage") ? 2 : 0)
                : 4);  // its destructors may hang on what broke
}
