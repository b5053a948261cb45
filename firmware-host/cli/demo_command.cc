// SPDX-License-Identifier: Apache-2.0
#include <unistd.h>

#include <memory>
#include <string>

#include "firmware-host/cli/command.h"
#include "firmware-host/cli/demo/demo.h"
#include "firmware-host/console/command_line.h"
#include "firmware-host/text/style.h"

namespace bendloop::host {
namespace {

constexpr const char* kDemoFooter = R"(
Examples:
  bendloop demo
  bendloop demo --parts 5 --seed 7 --out /tmp/demo
  bendloop demo --link can --can-interface vcan0    (a CAN bus without hardware:
    ip link add vcan0 type vcan && ip link set vcan0 up)
  bendloop demo --scanner usb     (as root; a USB device port without hardware:
    modprobe dummy_hcd)

Three processes beside this one: a simulated bender (Modbus TCP, CANopen or
ISO-TP) whose steel springs back more than the part file says, a simulated
scanner, and the daemon. Each part is bent, scanned while it is measured,
inspected and corrected; the next one is bent with the corrected program. The
folder --out gets cell.toml, part.toml, results/, sessions/ and report.html;
what an earlier demo left there is removed. Exit code 1 when the second part is
not better than the first.)";

struct MachineWords {
  std::string link = "tcp";
  std::string scanner = "tcp";
};

}  // namespace

CLI::App* AddDemoCommand(CLI::App& app, Run& run) {
  auto options = std::make_shared<DemoOptions>();
  auto words = std::make_shared<MachineWords>();
  auto no_color = std::make_shared<bool>(false);
  CLI::App* command = app.add_subcommand(
      "demo", "The whole main job on simulated hardware: bend, scan, measure, correct, bend again");
  command->footer(kDemoFooter);
  command->add_option("--out", options->out, "Folder for everything it makes")
      ->type_name("DIR")
      ->capture_default_str();
  command->add_option("--part", options->part, "Part file; without it the shipped demo part")
      ->type_name("PART.toml")
      ->check(CLI::ExistingFile);
  command
      ->add_option("--link", words->link,
                   "To the bender: tcp (Modbus on loopback), can (CANopen), can-isotp")
      ->check(CLI::IsMember({"tcp", "can", "can-isotp"}).description(""))
      ->type_name("LINK")
      ->capture_default_str();
  command->add_option("--can-interface", options->can_interface, "For --link can: up already")
      ->capture_default_str();
  command
      ->add_option("--scanner", words->scanner,
                   "tcp: on loopback; usb: a USB device, on a device port that leads back to this "
                   "machine")
      ->check(CLI::IsMember({"tcp", "usb"}).description(""))
      ->type_name("KIND")
      ->capture_default_str();
  command->add_option("--parts", options->parts, "How many are bent")
      ->check(CLI::Range(1, 1000))
      ->capture_default_str();
  command->add_option("--seed", options->seed, "Of bender and scanner")->capture_default_str();
  command->add_flag("--no-color,--no-colour", *no_color, "Plain text");
  command->add_option("--spacing", options->spacing_mm, "Between profiles [mm]")
      ->check(NumberWithin(0.1, 10.0))
      ->capture_default_str();
  command->add_option("--rays", options->rays, "Points of a profile, at most")
      ->check(CLI::Range(50, 5000))
      ->capture_default_str();
  command->add_flag("--quick", options->quick,
                    "Scan as fast as it goes instead of at a hand's pace");
  command->callback([options, words, no_color, &run] {
    run = [options, words, no_color] {
      if (words->link == "can") options->link = DemoLink::kCanopen;
      if (words->link == "can-isotp") options->link = DemoLink::kCanIsotp;
      if (words->scanner == "usb") options->scanner = DemoScanner::kUsb;
      options->colour = !*no_color && ColourAllowed(STDOUT_FILENO);
      const auto done = RunDemo(*options);
      return done ? 0 : Report(done.error());
    };
  });
  return command;
}

}  // namespace bendloop::host
