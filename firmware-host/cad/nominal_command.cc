// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/cad/nominal_command.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <iterator>
#include <memory>
#include <optional>
#include <ostream>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "config/load.h"
#include "config/part_writer.h"
#include "firmware-host/cad/body_join.h"
#include "firmware-host/cad/cad_helper.h"
#include "firmware-host/cad/developed.h"
#include "firmware-host/cad/nearest_tube.h"
#include "firmware-host/cad/nominal_text.h"
#include "firmware-host/cad/one_tube.h"
#include "firmware-host/cad/other_bodies.h"
#include "firmware-host/console/command_line.h"
#include "firmware-host/console/message.h"
#include "firmware-host/console/output_file.h"
#include "firmware-host/console/printable.h"
#include "firmware-host/console/whole_file.h"
#include "firmware-host/console/wrap.h"
#include "firmware-host/text/table.h"
#include "pipeline/tube/representations.h"

namespace bendloop::host {
namespace {

// Larger files are plants, not tubes.
constexpr std::size_t kMostFileBytes = std::size_t{1} << 30;

// Free surfaces are sampled so densely for their nearest lines and arcs, or more coarsely for pipes
// of more than three times this radius.
constexpr double kLeastStepMm = 1;

struct NominalArguments {
  std::string file;
  std::string out, json;
  std::string body;
  std::string name;
  std::optional<double> pipe_diameter_mm, wall_mm;
  std::uint32_t part_number = 1;
  bool list = false;
  bool reverse = false;
  bool nearest = false;
};

// What a file is that is no STEP and no IGES, with the mend; empty: it may be one of them.
std::string ForeignKind(std::string_view text) {
  struct Kind {
    std::string_view starts, what;
  };
  static constexpr Kind kKinds[] = {
      {"PK\x03\x04", "is a ZIP archive (STEP in ZIP is often called .stpz): unpack it first"},
      {"\x1f\x8b", "is compressed by gzip: unpack it first (gunzip)"},
      {"\xd0\xcf\x11\xe0", "is a document of a CAD system itself: save it there as STEP AP214"},
      {"solid ", "is an STL mesh: of a mesh, `bendloop reconstruct` measures the points"},
      {"glTF", "is a glTF mesh, not a CAD body: save the part as STEP AP214"},
      {"<?xml", "is XML: save the part as STEP AP214 (part 21, text)"},
      {"%PDF", "is a PDF: save the part as STEP AP214"},
      {"AC10", "is an AutoCAD drawing (DWG): save the part as STEP AP214"},
  };
  for (const Kind& kind : kKinds) {
    if (text.starts_with(kind.starts)) return std::string(kind.what);
  }
  return "";
}

// Whether a STEP file says what its lengths are counted in.
bool NamesUnit(std::string_view text) {
  constexpr std::string_view kLength = "LENGTH_UNIT";
  if (text.find("ISO-10303-21") == std::string_view::npos) return true;  // IGES has always one
  if (text.find("GLOBAL_UNIT_ASSIGNED_CONTEXT") == std::string_view::npos) return false;
  for (std::size_t at = text.find(kLength); at != std::string_view::npos;
       at = text.find(kLength, at + kLength.size())) {
    const std::size_t from = text.rfind('=', at), to = text.find(';', at);
    if (from == std::string_view::npos || to == std::string_view::npos) continue;
    const std::string_view entity = text.substr(from, to - from);
    if (entity.find("SI_UNIT") != std::string_view::npos ||
        entity.find("CONVERSION_BASED_UNIT") != std::string_view::npos) {
      return true;
    }
  }
  return false;
}

// What a STEP file says instead of faces; empty: nothing that is known.
std::string NotBuiltByOpenCascade(std::string_view text) {
  struct Kind {
    std::string_view entity, what;
  };
  static constexpr Kind kKinds[] = {
      {"SWEPT_DISK_SOLID", "SWEPT_DISK_SOLID (a disk along a centre line)"},
      {"CSG_SOLID", "CSG_SOLID (bodies added and subtracted)"},
      {"CSG_SHAPE_REPRESENTATION", "CSG_SHAPE_REPRESENTATION (bodies added and subtracted)"},
  };
  for (const Kind& kind : kKinds) {
    if (text.find(kind.entity) != std::string_view::npos) return std::string(kind.what);
  }
  return "";
}

// `step_mm`: how densely free surfaces are sampled; 0: enough to see what they are.
hal::Result<CadShape> LoadShape(const std::string& file, double step_mm = 0) {
  // Said here in plain words, and not by OpenCASCADE.
  const auto text = ReadWholeFile(file, kMostFileBytes);
  if (!text) return hal::Fail(text.error());
  if (text->empty())
    return hal::Fail(hal::ErrorKind::kBadInput, file + ": is empty; expected STEP or IGES");
  if (const std::string kind = ForeignKind(*text); !kind.empty()) {
    return hal::Fail(hal::ErrorKind::kBadInput, file + ": " + kind);
  }
  const auto fail = [&](hal::Error error) {
    const std::string entity = NotBuiltByOpenCascade(*text);
    if (error.kind == hal::ErrorKind::kBadInput && !entity.empty()) {
      error.message = file + ": has its shape as " + entity +
                      ", which OpenCASCADE does not build: export it as boundary surfaces (BREP, "
                      "a solid or shell of faces), as STEP AP214";
    }
    return hal::Fail(error);
  };
  const auto answer = RunCadHelper({"read", file, std::to_string(step_mm)}, "", file);
  if (!answer) return fail(answer.error());
  auto shape = ReadCadShape(*answer, file);
  if (!shape) return fail(shape.error());
  shape->names_unit = NamesUnit(*text);
  JoinBodies(*shape);
  return shape;
}

// A number of the list, or a name as it stands there: the part's, or what its assembly calls it.
hal::Result<CadTube> ByName(const std::vector<CadTube>& tubes, const std::string& wanted,
                            const std::string& file) {
  std::size_t number = 0;
  const auto [end, error] = std::from_chars(wanted.data(), wanted.data() + wanted.size(), number);
  std::vector<CadTube> named;
  for (const CadTube& tube : tubes) {
    if (tube.name == wanted) named.push_back(tube);
  }
  if (named.empty()) {
    std::copy_if(tubes.begin(), tubes.end(), std::back_inserter(named),
                 [&](const CadTube& tube) { return tube.occurrence == wanted; });
  }
  // The solid and its centre line have one name.
  if (named.size() > 1) std::erase_if(named, [](const CadTube& t) { return t.is_wire; });
  if (named.size() == 1) return named.front();
  if (named.empty() && error == std::errc() && end == wanted.data() + wanted.size() &&
      number >= 1 && number <= tubes.size()) {
    return tubes[number - 1];
  }
  return hal::Fail(hal::ErrorKind::kUsage,
                   "--body: '" + wanted + "' is " +
                       (named.empty() ? "no tube" : "the name of several tubes") + " of " + file +
                       "; expected a number or name of:\n" + TubeList(tubes));
}

// The part that all bent tubes of the file are.
std::optional<CadTube> OnePart(const std::vector<CadTube>& tubes) {
  std::optional<CadTube> part;
  std::size_t count = 0;
  for (const CadTube& tube : tubes) {
    if (tube.is_wire || (tube.problems.empty() && !tube.is_bent())) continue;
    if (!tube.problems.empty() || (part && !IsSamePart(*part, tube))) return std::nullopt;
    if (!part) part = tube;
    ++count;
  }
  if (!part) return std::nullopt;
  part->notes.push_back("the file holds it " + std::to_string(count) + " times");
  return part;
}

// What is round of them; all, where nothing is.
std::vector<CadTube> RoundOnes(const std::vector<CadTube>& tubes) {
  std::vector<CadTube> round;
  std::copy_if(tubes.begin(), tubes.end(), std::back_inserter(round),
               [](const CadTube& tube) { return tube.is_round; });
  return round.empty() ? tubes : round;
}

// The only bent tube, the only tube, the only centre line, in this order.
std::optional<CadTube> TheOne(const std::vector<CadTube>& tubes) {
  const auto only = [&](const auto& is) -> std::optional<CadTube> {
    const auto count = std::count_if(tubes.begin(), tubes.end(), is);
    if (count != 1) return std::nullopt;
    return *std::find_if(tubes.begin(), tubes.end(), is);
  };
  const auto is_broken = [](const CadTube& t) { return !t.is_wire && !t.problems.empty(); };
  const auto is_bent = [](const CadTube& t) { return !t.is_wire && t.is_bent(); };
  const auto is_solid = [](const CadTube& t) { return !t.is_wire; };
  const auto is_wire = [](const CadTube& t) { return t.is_wire; };
  if (std::none_of(tubes.begin(), tubes.end(), is_broken)) {
    if (auto tube = only(is_bent)) {
      for (const bool same : {true, false}) {
        const auto straight = std::count_if(tubes.begin(), tubes.end(), [&](const CadTube& t) {
          return is_solid(t) && !t.is_bent() && (t.body == tube->body) == same;
        });
        if (straight == 0) continue;
        tube->notes.push_back(std::string("straight tubes in ") +
                              (same ? "the same body" : "other bodies") +
                              ", left out (--list): " + std::to_string(straight));
      }
      return *tube;
    }
    const bool bent = std::any_of(tubes.begin(), tubes.end(), is_bent);
    if (auto tube = only(is_solid); tube && !bent) return *tube;
  }
  if (tubes.size() == 1) return tubes.front();
  if (auto tube = OnePart(tubes)) return tube;
  const bool all_wires = std::all_of(tubes.begin(), tubes.end(), is_wire);
  if (auto tube = only([&](const CadTube& t) { return t.is_bent(); }); tube && all_wires) {
    return *tube;
  }
  return std::nullopt;
}

// What the file is about, where that is clear.
hal::Result<CadTube> Choose(const std::vector<CadTube>& tubes, const NominalArguments& arguments) {
  if (tubes.empty()) {
    return hal::Fail(
        hal::ErrorKind::kBadInput,
        arguments.file +
            ": holds no round tube: no cylinders of some length and no tori that go "
            "around, and no centre line of lines and arcs; a triangulated part (STL in STEP) has "
            "none, either: export it as solid");
  }
  if (!arguments.body.empty()) return ByName(tubes, arguments.body, arguments.file);
  const std::vector<CadTube> round = RoundOnes(tubes);
  if (auto tube = TheOne(round)) {
    if (round.size() < tubes.size()) {
      tube->notes.push_back("profiles that are not round, left out (--list): " +
                            std::to_string(tubes.size() - round.size()));
    }
    return *tube;
  }
  const std::string goes_on =
      std::any_of(tubes.begin(), tubes.end(), [](const CadTube& t) { return t.goes_on; })
          ? ", some of them parts of one tube that changes its diameter, of which a part file has "
            "one"
          : "";
  return hal::Fail(hal::ErrorKind::kUsage, arguments.file + ": holds " +
                                               std::to_string(tubes.size()) + " tubes" + goes_on +
                                               "; choose one by --body:\n" + TubeList(tubes));
}

// Why the daemon takes no part with these rows; empty: they are no reason against it.
std::string NotForPartFile(const Nominal& nominal) {
  const auto& rows = nominal.program.program.rows;
  if (rows.size() == 1) {
    return "it is straight: a part file has a bend at least, since lengths between bends, "
           "rotations "
           "and angles are what is measured and corrected";
  }
  for (const bool first : {true, false}) {
    // A dome on a bend is no straight.
    const double dome_mm = (first ? nominal.tube.first : nominal.tube.last).fitting_mm;
    constexpr double kLeastStraightMm = 1e-6;
    const double straight_mm = (first ? rows.front() : rows.back()).length_mm - dome_mm;
    if (straight_mm > kLeastStraightMm) continue;
    return std::string("it ") + (first ? "begins" : "ends") +
           " with a bend, without a straight that a bender clamps and a scanner sees: give it "
           "one in CAD, of the length that is cut off afterwards";
  }
  return "";
}

// So that a file shows as many decimals: a product with 1e-7 has others.
double Rounded(double value, int decimals) {
  const double per_unit = std::pow(10.0, decimals);
  return std::round(value * per_unit) / per_unit;
}

// To what a file's rounding leaves: 1e-7 mm, 1e-9 degrees.
hal::BendProgram RoundedProgram(hal::BendProgram program) {
  constexpr double kPerMm = 1e7, kPerDeg = 1e9;
  for (hal::BendRow& row : program.rows) {
    row.length_mm = std::round(row.length_mm * kPerMm) / kPerMm + 0.0;
    row.rotation_deg = RoundedTurnDeg(row.rotation_deg, 9);
    row.angle_deg = std::round(row.angle_deg * kPerDeg) / kPerDeg;
    if (row.bend_radius_mm) row.bend_radius_mm = std::round(*row.bend_radius_mm * kPerMm) / kPerMm;
  }
  return program;
}

config::OpeningConfig ToConfig(const WallOpening& opening, double length_mm) {
  config::OpeningConfig config;
  const bool from_start = opening.along_mm <= length_mm / 2;
  (from_start ? config.from_start_mm : config.from_end_mm) =
      Rounded(from_start ? opening.along_mm : length_mm - opening.along_mm, 4);
  config.around_deg = RoundedTurnDeg(opening.around_deg, 3);
  config.width_mm = Rounded(opening.width_mm, 4);
  config.length_mm = opening.length_mm > 0 ? Rounded(opening.length_mm, 4) : config.width_mm;
  config.axis_deg = Rounded(opening.axis_deg, 3) + 0.0;
  config.lean_along_deg = Rounded(opening.lean_along_deg, 3) + 0.0;
  config.lean_around_deg = Rounded(opening.lean_around_deg, 3) + 0.0;
  return config;
}

// Cuts that are more oblique than a part file holds stand in its comments alone.
hal::EndCut ToConfig(const hal::EndCut& cut) {
  constexpr double kMostObliqueDeg = 60;
  if (cut.obliquity_deg > kMostObliqueDeg) return {};
  return {Rounded(cut.obliquity_deg, 3), RoundedTurnDeg(cut.around_deg, 2)};
}

std::string PartText(const Nominal& nominal, const NominalArguments& arguments) {
  config::PartConfig part;
  part.name = arguments.name.empty() ? PartName(nominal.tube, arguments.file) : arguments.name;
  part.part_number = arguments.part_number;
  part.pipe_radius_mm = Rounded(nominal.tube.pipe_radius_mm, 7);
  if (nominal.tube.wall_mm) part.wall_mm = Rounded(*nominal.tube.wall_mm, 7);
  part.rows = nominal.program.program;
  for (const WallOpening& opening : nominal.tube.openings) {
    auto& of_kind = opening.length_mm > 0 ? part.slots : part.holes;
    of_kind.push_back(ToConfig(opening, nominal.tube.spine.length_mm()));
  }
  part.ends.first = ToConfig(FirstCut(nominal.tube));
  part.ends.last = ToConfig(LastCut(nominal.tube));
  std::string comment =
      "From " + Printable(nominal.file) + ". Tolerances and material are defaults: set them.\n";
  for (const std::string& remark : Remarks(nominal.tube)) comment += remark + "\n";
  return config::PartToml(part, WrapLines(comment, 98));
}

// What the file does not show; what it shows is not talked over.
hal::Result<void> SetPipe(const NominalArguments& arguments, CadTube& tube) {
  const auto differs = [&](const char* option, const char* what, double given_mm, double shown_mm) {
    return hal::Fail(hal::ErrorKind::kUsage, arguments.file + ": " + option + " " +
                                                 Fixed(given_mm, 3) + ": the file shows a " + what +
                                                 " of " + Fixed(shown_mm, 3) + " mm; leave " +
                                                 option + " out, or mend the model");
  };
  const auto is_another = [](double a_mm, double b_mm) { return std::abs(a_mm - b_mm) > 5e-4; };
  if (const auto given_mm = arguments.pipe_diameter_mm) {
    const double shown_mm = 2 * tube.pipe_radius_mm;
    if (!tube.is_wire && is_another(*given_mm, shown_mm)) {
      return differs("--pipe-diameter", "pipe", *given_mm, shown_mm);
    }
    if (tube.is_wire) tube.pipe_radius_mm = *given_mm / 2;
  }
  if (const auto given_mm = arguments.wall_mm) {
    if (tube.wall_mm && is_another(*given_mm, *tube.wall_mm)) {
      return differs("--wall", "wall", *given_mm, *tube.wall_mm);
    }
    if (!tube.wall_mm) tube.wall_mm = given_mm;
  }
  return {};
}

// What the file holds beside the tube that was chosen.
void TellWhatIsBeside(const CadShape& shape, const std::vector<CadTube>& tubes, CadTube& tube) {
  const OtherBodyNotes others = NotesOfOtherBodies(shape, tubes, tube);
  const auto add = [](const std::vector<std::string>& more, std::vector<std::string>& notes) {
    notes.insert(notes.end(), more.begin(), more.end());
  };
  add(others.placed, tube.placed_notes);
  add(others.placed_reversed, tube.placed_notes_reversed);
  add(others.notes, tube.notes);
  if (const std::string note = CentreLineNote(tubes, tube); !note.empty()) {
    tube.notes.push_back(note);
  }
}

hal::Result<Nominal> Make(const NominalArguments& arguments, const CadShape& shape,
                          const std::vector<CadTube>& tubes) {
  auto tube = Choose(tubes, arguments);
  if (!tube) return hal::Fail(tube.error());
  const auto bad = [&](const std::string& what) {
    return hal::Fail(hal::ErrorKind::kBadInput,
                     arguments.file + ": " +
                         (BodyName(*tube).empty() ? "" : "'" + BodyName(*tube) + "': ") + what);
  };
  if (tube->is_wire && arguments.pipe_diameter_mm) {
    tube->pipe_radius_mm = *arguments.pipe_diameter_mm / 2;
  }
  const bool has_pipe = !tube->is_wire || tube->pipe_radius_mm > 0;
  if (!tube->problems.empty() && arguments.nearest && tube->has_nearest() && has_pipe) {
    auto dense = LoadShape(arguments.file, std::max(kLeastStepMm, tube->pipe_radius_mm / 3));
    if (!dense) return hal::Fail(dense.error());
    auto nearest = NearestTube(dense->bodies.at(tube->body), *tube);
    if (!nearest) return bad(nearest.error().message);
    tube = std::move(nearest);
    BeginNearOrigin(*tube);
  }
  if (!tube->problems.empty()) {
    std::string all;
    for (const std::string& problem : tube->problems) all += (all.empty() ? "" : "; ") + problem;
    return bad(all + (!tube->has_nearest() || (arguments.nearest && has_pipe)
                          ? ""
                          : "; --nearest gives the lines and arcs nearest to it" +
                                std::string(has_pipe ? "" : ", with --pipe-diameter MM")));
  }
  if (auto ok = SetPipe(arguments, *tube); !ok) return hal::Fail(ok.error());
  if (!(tube->pipe_radius_mm > 0)) {
    return hal::Fail(hal::ErrorKind::kUsage,
                     arguments.file + ": is a centre line without a pipe; give --pipe-diameter MM");
  }
  TellWhatIsBeside(shape, tubes, *tube);
  if (arguments.reverse) {
    tube->spine = tube->spine.Reversed();
    std::swap(tube->first, tube->last);
    std::swap(tube->openings, tube->openings_reversed);
    std::swap(tube->placed_notes, tube->placed_notes_reversed);
  }
  Nominal nominal;
  nominal.file = arguments.file;
  nominal.program = TubeFromSpine(tube->spine, tube->pipe_radius_mm);
  nominal.program.program = RoundedProgram(nominal.program.program);
  if (const auto checked = pipeline::CheckProgram(nominal.program.program); !checked) {
    return bad("its centre line is no tube: " + checked.error().message);
  }
  nominal.tube = std::move(*tube);
  return nominal;
}

// The exit code; what went wrong is on `err`.
int RunNominal(const NominalArguments& arguments, std::ostream& out, std::ostream& err) {
  const auto fail = [&](const hal::Error& error) {
    err << MessageText("bendloop", error.message, 0);
    return hal::ExitCode(error.kind);
  };
  auto shape = LoadShape(arguments.file);
  if (!shape) return fail(shape.error());
  std::vector<CadTube> tubes = TubesOf(*shape);
  if (!shape->names_unit) {
    for (CadTube& tube : tubes) {
      tube.notes.emplace_back("the file names no unit of length: its numbers are taken as mm");
    }
  }
  if (shape->lost_faces > 0) {
    for (CadTube& tube : tubes) {
      tube.notes.push_back(
          "faces of the file that cannot be built (it is damaged), or belong to "
          "no product: " +
          std::to_string(shape->lost_faces));
    }
  }
  if (arguments.list && !tubes.empty()) {
    out << TubeList(tubes);
    return 0;
  }
  const auto nominal = Make(arguments, *shape, tubes);
  if (!nominal) return fail(nominal.error());
  if (arguments.json != "-") out << NominalText(*nominal);
  if (!arguments.json.empty()) {
    const std::string json = Dump(NominalJson(*nominal), 2) + "\n";
    if (arguments.json == "-") {
      out << json;
    } else if (auto written = WriteOutputFile(arguments.json, json); !written) {
      return fail(written.error());
    }
  }
  out << std::flush;
  if (arguments.out.empty()) return 0;
  const std::string part = PartText(*nominal, arguments);
  std::string reason = NotForPartFile(*nominal);
  if (const auto checked = config::ParsePart(part, "the part"); reason.empty() && !checked) {
    reason = checked.error().message;
  }
  if (!reason.empty()) {
    return fail({hal::ErrorKind::kBadInput,
                 arguments.file + ": no part file can hold it, none is written: " + reason});
  }
  if (auto written = WriteOutputFile(arguments.out, part); !written) return fail(written.error());
  // Not among what scripts read.
  err << "wrote " << Printable(arguments.out) << "\n";
  return 0;
}

constexpr const char* kNominalFooter = R"(
Examples:
  bendloop nominal pipe.step                         what is in it
  bendloop nominal pipe.step --out part.toml --part-number 1201
  bendloop nominal rack.step --list                  the tubes of an assembly
  bendloop nominal rack.step --body "Return line" --out part.toml
  bendloop nominal line.igs --pipe-diameter 10 --wall 1
                                                     a centre line alone

STEP (AP203, AP214, AP242) and IGES in any unit; cylinders and tori of outer and
inner surface, or lines and arcs of a centre line, become lengths, rotations and
angles. The first end is the one nearer to the file's origin; --reverse takes
the other. Holes, slots and oblique ends become [[hole]], [[slot]] and [end];
what sits on the ends is told, and stands in the part file as comments. A part
that is no lines and arcs is refused with the reason; --nearest measures it as a
scan would be. Tolerances and material of the part file are defaults.
Exit codes: 2 several tubes and no --body; 3 no tube of lines and arcs, or a
damaged file; 4 bendloop-cad is not installed.)";

}  // namespace

CLI::App* AddNominalCommand(CLI::App& app, std::function<int()>& run, std::ostream& out,
                            std::ostream& err) {
  auto a = std::make_shared<NominalArguments>();
  CLI::App* command = app.add_subcommand("nominal", "A part's nominal from CAD: STEP or IGES");
  command->add_option("FILE", a->file, "STEP or IGES")->required();
  command->add_option("--out", a->out, "Part file to write")->type_name("PART.toml");
  command->add_option("--json", a->json, "The same as JSON; - is standard output")
      ->type_name("FILE");
  command->add_flag("--list", a->list, "List the file's tubes and end");
  command->add_option("--body", a->body, "Which tube: its number or name in the list");
  command->add_flag("--reverse", a->reverse, "Begin at the other end");
  command->add_flag("--nearest", a->nearest,
                    "Of a part that is no lines and arcs, those nearest to it");
  command->add_option("--name", a->name, "Of the part; not given: the body's, or the file's");
  command->add_option("--part-number", a->part_number, "What the bender knows it by")
      ->capture_default_str();
  command
      ->add_option("--pipe-diameter", a->pipe_diameter_mm,
                   "Outer, in mm, where the file has a centre line alone")
      ->check(NumberWithin(1, 1000));
  command->add_option("--wall", a->wall_mm, "In mm, where the file does not show it")
      ->check(NumberWithin(0.05, 100));
  command->footer(kNominalFooter);
  command->callback(
      [a, &run, &out, &err] { run = [a, &out, &err] { return RunNominal(*a, out, err); }; });
  return command;
}

}  // namespace bendloop::host
