// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <ostream>
#include <string>

#include "pipeline/reconstruction.h"

namespace bendloop::host {

// "bend 3 seen, 41.2 +- 0.1 deg; 180 mm of 620 still missing", at last "620 mm of 620 seen".
// `expected_mm` is the length of the nominal's spine; empty: only what was seen is told. A bend is
// told of once it is whole.
std::string ProgressText(const pipeline::LiveView& view, std::optional<double> expected_mm);

// The one line that shows a running scan. On a terminal it is written over itself; elsewhere (a
// log, a pipe) a plain line is written at each new bend and at each further quarter of the tube.
class Progress {
 public:
  // `columns` of the terminal: a longer text is cut, because a wrapped line cannot be written over.
  Progress(std::ostream& out, bool terminal, std::size_t columns = 80)
      : out_(out), terminal_(terminal), columns_(columns) {}

  void Show(const pipeline::LiveView& view, std::optional<double> expected_mm);
  // Ends the line, so that what comes next starts on its own.
  void End();

 private:
  std::ostream& out_;
  bool terminal_;
  std::size_t columns_;
  std::string shown_;
  std::size_t bends_ = 0;
  int quarters_ = -1;
};

}  // namespace bendloop::host
