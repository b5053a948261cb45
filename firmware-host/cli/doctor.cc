// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/cli/doctor.h"

#include <pthread.h>
#include <sched.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <sys/timex.h>
#include <unistd.h>

#include <cerrno>
#include <fstream>
#include <optional>
#include <system_error>
#include <thread>

#include "firmware-host/acquisition/realtime.h"
#include "firmware-host/retention/free_space.h"

namespace bendloop::host {
namespace {

namespace fs = std::filesystem;

constexpr int kPriority = 50;
constexpr std::uint64_t kWantedDisk = 2ull << 30;

Finding Kernel(const DoctorPlaces& places) {
  const std::string release = FirstLine(places.proc / "sys/kernel/osrelease");
  const bool rt = FirstLine(places.sys / "kernel/realtime") == "1";
  if (rt) return Good("kernel", release + ", PREEMPT_RT");
  return Bad("kernel", release + ", not PREEMPT_RT",
             "fine for scans up to about 1 kHz; for the last milliseconds of jitter: apt install "
             "linux-image-rt-amd64");
}

// Tried, not guessed from limits: a capability grants it as well.
Finding Priority() {
  int why = 0;
  std::thread trial([&why] {
    sched_param parameter{};
    parameter.sched_priority = kPriority;
    why = pthread_setschedparam(pthread_self(), SCHED_FIFO, &parameter);
  });
  trial.join();
  rlimit limit{};
  getrlimit(RLIMIT_RTPRIO, &limit);
  const std::string found = "SCHED_FIFO " + std::to_string(kPriority) +
                            (why == 0 ? " granted" : " refused") + ", RLIMIT_RTPRIO " +
                            std::to_string(limit.rlim_cur);
  if (why == 0) return Good("real-time priority", found);
  return Bad("real-time priority", found,
             "the shipped unit grants it (LimitRTPRIO=99); for a shell: add '@bendloop - rtprio "
             "99' to /etc/security/limits.d/bendloop.conf and log in again");
}

Finding PipelinePriority() {
  int why = 0;
  std::thread trial([&why] {
    if (setpriority(PRIO_PROCESS, static_cast<id_t>(gettid()), kPipelineNice) != 0) why = errno;
  });
  trial.join();
  const std::string found =
      "nice " + std::to_string(kPipelineNice) + (why == 0 ? " granted" : " refused");
  if (why == 0) return Good("pipeline priority", found);
  return Bad("pipeline priority", found,
             "the shipped unit grants it (LimitNICE=-10); for a shell: add '@bendloop - nice -10' "
             "to /etc/security/limits.d/bendloop.conf and log in again");
}

Finding MemoryLock() {
  rlimit limit{};
  getrlimit(RLIMIT_MEMLOCK, &limit);
  const bool unlimited = limit.rlim_cur == RLIM_INFINITY;
  const std::string found = unlimited
                                ? "RLIMIT_MEMLOCK unlimited"
                                : "RLIMIT_MEMLOCK " + std::to_string(limit.rlim_cur >> 20) + " MB";
  if (unlimited || geteuid() == 0 || limit.rlim_cur >= (512u << 20)) {
    return Good("locked memory", found);
  }
  return Bad("locked memory", found,
             "the shipped unit grants it (LimitMEMLOCK=infinity); for a shell: add '@bendloop - "
             "memlock unlimited' to /etc/security/limits.d/bendloop.conf and log in again");
}

Finding Governor(const DoctorPlaces& places) {
  std::error_code error;
  std::size_t cpus = 0;
  std::string slow;
  for (fs::directory_iterator it(places.sys / "devices/system/cpu", error), end;
       !error && it != end; it.increment(error)) {
    const std::string governor = FirstLine(it->path() / "cpufreq/scaling_governor");
    if (governor.empty()) continue;
    ++cpus;
    if (governor != "performance") slow = it->path().filename().string() + " " + governor;
  }
  if (cpus == 0) return Good("CPU frequency", "no frequency scaling here");
  if (slow.empty()) return Good("CPU frequency", "governor performance");
  return Bad("CPU frequency", "governor of " + slow,
             "cpupower frequency-set -g performance (package linux-cpupower)");
}

Finding ClockSource(const DoctorPlaces& places) {
  const std::string source =
      FirstLine(places.sys / "devices/system/clocksource/clocksource0/current_clocksource");
  if (source == "tsc" || source == "kvm-clock" || source == "arch_sys_counter" ||
      source.rfind("hyperv", 0) == 0) {
    return Good("clock source", source);
  }
  return Bad("clock source", source.empty() ? "unknown" : source,
             "reading the time is slow with this one: boot with clocksource=tsc if dmesg calls "
             "the TSC reliable");
}

Finding TimeOfDay() {
  timex time{};
  const int state = adjtimex(&time);
  const bool synchronised = state >= 0 && state != TIME_ERROR && (time.status & STA_UNSYNC) == 0;
  if (synchronised) return Good("time of day", "synchronised");
  return Bad("time of day", "not synchronised",
             "recordings carry the date: install chrony or enable systemd-timesyncd");
}

Finding Usb(const DoctorPlaces& places) {
  std::error_code error;
  std::size_t devices = 0;
  std::string closed;
  const fs::path bus = places.dev / "bus/usb";
  for (fs::recursive_directory_iterator it(bus, error), end; !error && it != end;
       it.increment(error)) {
    if (it->is_directory(error)) continue;
    ++devices;
    if (access(it->path().c_str(), R_OK | W_OK) != 0) closed = it->path().string();
  }
  if (devices == 0) {
    return Bad("USB", "no USB devices in " + bus.string(),
               "needed by USB scanners only: check cable, and modprobe usbcore");
  }
  if (closed.empty()) return Good("USB", std::to_string(devices) + " devices, all may be opened");
  return Bad("USB", closed + " may not be opened",
             "needed by USB scanners only: install the udev rule of config/ and join group "
             "bendloop");
}

Finding Can(const DoctorPlaces& places) {
  std::error_code error;
  std::string found;
  for (fs::directory_iterator it(places.sys / "class/net", error), end; !error && it != end;
       it.increment(error)) {
    if (FirstLine(it->path() / "type") != "280") continue;  // ARPHRD_CAN
    found += (found.empty() ? "" : ", ") + it->path().filename().string() + " " +
             FirstLine(it->path() / "operstate");
  }
  if (!found.empty()) return Good("CAN", found);
  return Bad("CAN", "no CAN interface",
             "needed by CAN benders only: ip link set can0 up type can bitrate 500000");
}

Finding Disk(const DoctorPlaces& places) {
  fs::path directory = places.state_dir;
  std::error_code error;
  while (!fs::exists(directory, error) && directory.has_relative_path()) {
    directory = directory.parent_path();
  }
  const std::optional<FreeSpace> free = FreeSpaceAt(directory);
  if (!free) {
    return Bad("disk", directory.string() + ": cannot be looked at",
               "check that it is mounted, and its rights");
  }
  const std::string found = directory.string() + ": " + std::to_string(free->bytes >> 20) + " MB";
  if (free->names < kLeastFreeNames) {
    return Bad("disk", found + " and " + std::to_string(free->names) + " files (inodes) free",
               "no file can be made for long: 'df -i' and 'du --inodes' show who has them");
  }
  if (free->bytes >= kWantedDisk) return Good("disk", found + " free");
  return Bad("disk", found + " free",
             "recordings need room: free at least 2 GB, or lower [record] disk_budget_mb");
}

}  // namespace

std::string FirstLine(const fs::path& path) {
  std::string line;
  std::ifstream file(path);
  std::getline(file, line);
  return line;
}

Finding Good(std::string name, std::string found) {
  return {std::move(name), true, std::move(found), ""};
}
Finding Bad(std::string name, std::string found, std::string mend) {
  return {std::move(name), false, std::move(found), std::move(mend)};
}

std::vector<Finding> Examine(const DoctorPlaces& places) {
  return {Kernel(places),      Priority(),  PipelinePriority(), MemoryLock(), Governor(places),
          ClockSource(places), TimeOfDay(), Usb(places),        Can(places),  Disk(places)};
}

}  // namespace bendloop::host
