// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/convert/convert_command.h"

#include <cerrno>
#include <filesystem>
#include <fstream>
#include <istream>
#include <map>
#include <memory>
#include <optional>
#include <ostream>
#include <string>
#include <system_error>

#include "firmware-host/console/command_line.h"
#include "firmware-host/convert/tube_table.h"

namespace bendloop::host {
namespace {

using pipeline::FeedCount;
using pipeline::RotationCount;

const std::map<std::string, TableKind> kKinds = {{"xyz", TableKind::kXyz},
                                                 {"lra", TableKind::kLra},
                                                 {"ybc", TableKind::kYbc},
                                                 {"pose", TableKind::kPose}};
const std::map<std::string, TableFormat> kFormats = {
    {"text", TableFormat::kText}, {"csv", TableFormat::kCsv}, {"json", TableFormat::kJson}};
const std::map<std::string, FeedCount> kLengths = {{"incremental", FeedCount::kIncremental},
                                                   {"cumulative", FeedCount::kAlongSpine},
                                                   {"straights", FeedCount::kStraights}};
const std::map<std::string, RotationCount> kRotations = {
    {"incremental", RotationCount::kIncremental}, {"cumulative", RotationCount::kCumulative}};
const std::map<std::string, int> kSigns = {{"+1", 1}, {"1", 1}, {"-1", -1}};

// The words of the command line; every one is checked by CLI11 before Run sees it.
struct CommandWords {
  std::string file = "-";
  std::string to;
  std::string from = "auto";
  std::string format = "text";
  std::string units = "mm";
  std::optional<double> bend_radius_mm;
  std::optional<int> decimals;
  bool reverse = false;
  std::string order = "nominal";
  std::string length = "incremental", rotation = "incremental", sign = "+1";
  std::string out_length, out_rotation, out_sign;  // empty: see OutStyle
};

template <class Map>
CLI::Validator OneOf(const Map& map) {
  std::vector<std::string> words;
  words.reserve(map.size());
  for (const auto& [word, value] : map) words.push_back(word);
  return CLI::IsMember(words);
}

pipeline::YbcStyle InStyle(const CommandWords& words) {
  return {kLengths.at(words.length), kRotations.at(words.rotation), kSigns.at(words.sign)};
}

// The plain options say how the machine counts. When its table is read, what is written counts as
// LRA does unless --out-... says otherwise.
pipeline::YbcStyle OutStyle(const CommandWords& words, TableKind read) {
  pipeline::YbcStyle style = read == TableKind::kYbc ? pipeline::YbcStyle{} : InStyle(words);
  if (!words.out_length.empty()) style.feed = kLengths.at(words.out_length);
  if (!words.out_rotation.empty()) style.rotation = kRotations.at(words.out_rotation);
  if (!words.out_sign.empty()) style.rotation_sign = kSigns.at(words.out_sign);
  return style;
}

hal::Result<std::string> ReadAll(const std::string& file, std::istream& standard_in) {
  const auto bad = [&](const std::string& what) {
    return hal::Fail(hal::ErrorKind::kBadInput, file + ": " + what);
  };
  std::ifstream opened;
  if (file != "-") {
    std::error_code error;
    if (std::filesystem::is_directory(file, error)) {
      return bad("is a directory, expected a file with a table");
    }
    opened.open(file, std::ios::binary);
    if (!opened) return bad("cannot be opened: " + std::generic_category().message(errno));
  }
  std::istream& in = file == "-" ? standard_in : opened;
  std::string text;
  char block[1 << 16];
  while (in.read(block, sizeof block) || in.gcount() > 0) {
    text.append(block, static_cast<std::size_t>(in.gcount()));
    if (text.size() > kMaxTableBytes) break;  // refused by its reader
  }
  if (in.bad()) return bad("cannot be read: " + std::generic_category().message(errno));
  return text;
}

hal::Result<std::string> Convert(const CommandWords& words, std::istream& in, std::ostream& err) {
  const std::string name = words.file == "-" ? "standard input" : words.file;
  TableReadOptions read;
  if (words.from != "auto") read.from = kKinds.at(words.from);
  const auto units = UnitsFromName(words.units);
  if (!units) return hal::Fail(units.error());
  read.units = *units;
  read.bend_radius_mm = words.bend_radius_mm;
  read.style = InStyle(words);
  read.in_scan_order = words.order == "scan";
  TableWriteOptions write;
  write.to = kKinds.at(words.to);
  write.format = kFormats.at(words.format);
  write.decimals = words.decimals;

  const auto text = ReadAll(words.file, in);
  if (!text) return hal::Fail(text.error());
  auto table = ReadTubeTable(*text, name, read);
  if (!table) return hal::Fail(table.error());
  write.style = OutStyle(words, table->kind);

  // Between points and lengths stand the tangent lengths, which take the radii.
  const bool points_in = table->kind == TableKind::kXyz;
  const bool points_out = write.to == TableKind::kXyz;
  if (points_in != points_out && !table->radii_known) {
    return hal::Fail(hal::ErrorKind::kUsage,
                     name + ": a bend has no bend radius, which " + words.to +
                         " needs; give --bend-radius MM, or a column bend_radius_mm (0 for sharp "
                         "corners)");
  }
  for (const std::string& note : table->notes)
    err << "bendloop: note: " << name << ": " << note << "\n";
  if (words.reverse) table->tube = pipeline::ReverseTube(table->tube);
  auto written = WriteTubeTable(table->tube, write);
  if (!written) return hal::Fail(written.error().kind, name + ": " + written.error().message);
  return written;
}

int Run(const CommandWords& words, std::istream& in, std::ostream& out, std::ostream& err) {
  const auto written = Convert(words, in, err);
  if (!written) {
    err << "bendloop: " << written.error().message << "\n";
    return hal::ExitCode(written.error().kind);
  }
  out << *written << std::flush;  // main() asks whether it arrived
  return 0;
}

constexpr const char* kFooter = R"(The kinds of table
  xyz   points: both ends, and where neighbouring straights would meet
  lra   length, rotation, angle: straight between bends, rotation about the feed
        (right-handed, -180 to 180), bend angle; n bends are n + 1 rows
  ybc   the same as a machine counts it: --length, --rotation, --rotation-sign
  pose  start point, orientation (quaternion w x y z) and lra

A line with column names says what a table is (x y z; length rotation angle;
y b c; with a bend radius as bend_radius, radius or clr); JSON says it in its
keys, results of bendloop too. Without names say --from. Each row has as many
cells as the names or the first row; numbers with decimal commas need
semicolons, tabs or blanks between them. Output is in mm and degrees.

A result is read in the nominal's order where it knows one, otherwise as it was
scanned; standard error says which. --order scan takes the scan's all the same.

--length, --rotation and --rotation-sign describe the machine's table: the one
that is read if that is ybc, otherwise the one that is written. From ybc to ybc,
the --out-... options describe the second; they default to the counting of lra.

Examples
  bendloop convert --to lra --from xyz --bend-radius 35 points.txt
  bendloop convert --to xyz --format csv result.json > points.csv
  bendloop convert --to lra result.json
  bendloop convert --to ybc --rotation cumulative --length cumulative lra.csv
  bendloop convert --from ybc --rotation-sign -1 --to lra --reverse machine.txt)";

}  // namespace

CLI::App* AddConvertCommand(CLI::App& app, std::function<int()>& run, std::istream& in,
                            std::ostream& out, std::ostream& err) {
  auto words = std::make_shared<CommandWords>();
  CLI::App* command =
      app.add_subcommand("convert", "Turn XYZ, LRA, YBC and pose tables into each other");
  command->add_option("FILE", words->file, "text, CSV or JSON; - is standard input")
      ->capture_default_str();
  command->add_option("--to", words->to, "what to write")->required()->check(OneOf(kKinds));
  command->add_option("--from", words->from, "what is read; auto: its names or keys say so")
      ->check(CLI::IsMember({"auto", "xyz", "lra", "ybc", "pose"}))
      ->capture_default_str();
  command->add_option("--format", words->format, "of what is written")
      ->check(OneOf(kFormats))
      ->capture_default_str();
  command->add_option("--units", words->units, "of the lengths read from text")
      ->check(CLI::IsMember({"mm", "m", "in"}))
      ->capture_default_str();
  command
      ->add_option("--bend-radius", words->bend_radius_mm,
                   "CLR in mm where the table has none; 0: sharp corners")
      ->check(NumberWithin(0.0, 1e6));
  command->add_option("--decimals", words->decimals, "4 in text, 6 in CSV and JSON if not given")
      ->check(CLI::Range(0, 9));
  command
      ->add_option("--order", words->order,
                   "of a result's rows: the nominal's, where known, or the scan's")
      ->check(CLI::IsMember({"nominal", "scan"}))
      ->capture_default_str();
  command->add_flag("--reverse", words->reverse, "feed the tube from its other end");
  command
      ->add_option(
          "--length", words->length,
          "y of ybc: incremental, cumulative (straights and arcs) or straights (their sum)")
      ->check(OneOf(kLengths))
      ->capture_default_str();
  command
      ->add_option("--rotation", words->rotation,
                   "b of ybc: incremental (-180 to 180) or cumulative (0 to 360)")
      ->check(OneOf(kRotations))
      ->capture_default_str();
  command
      ->add_option("--rotation-sign", words->sign,
                   "b of ybc: +1 right-handed about the feed, -1 the other way")
      ->check(OneOf(kSigns))
      ->capture_default_str();
  command->add_option("--out-length", words->out_length, "--length of what is written, ybc to ybc")
      ->check(OneOf(kLengths));
  command->add_option("--out-rotation", words->out_rotation, "--rotation of what is written")
      ->check(OneOf(kRotations));
  command->add_option("--out-rotation-sign", words->out_sign, "--rotation-sign of what is written")
      ->check(OneOf(kSigns));
  command->footer(kFooter);
  command->callback([words, &run, &in, &out, &err] {
    run = [words, &in, &out, &err] { return Run(*words, in, out, err); };
  });
  return command;
}

}  // namespace bendloop::host
