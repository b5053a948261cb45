// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/acquisition/realtime.h"

#include <malloc.h>
#include <pthread.h>
#include <sched.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <unistd.h>

#include <cerrno>
#include <system_error>

namespace bendloop::host {
namespace {

std::string Text(int error_number) { return std::generic_category().message(error_number); }

// 0 or errno. Pages are locked as they are touched (the ring's are touched at start), so that
// thread stacks do not cost their full size. Future pages only without a limit: with one, a later
// allocation would fail instead of being unlocked.
int LockMemory() {
  rlimit limit{};
  getrlimit(RLIMIT_MEMLOCK, &limit);
  int flags = MCL_CURRENT | MCL_ONFAULT;
  if (limit.rlim_cur == RLIM_INFINITY || geteuid() == 0) flags |= MCL_FUTURE;
  return mlockall(flags) == 0 ? 0 : errno;
}

}  // namespace

hal::Result<std::string> ApplyRealtime(const RealtimePolicy& policy) {
  if (!policy.enabled) return std::string();
  std::string note;
  const auto missing = [&note](const std::string& what) {
    if (!note.empty()) note += "; ";
    note += what;
  };

  if (const int why = LockMemory(); why != 0) {
    missing("memory is not locked (mlockall: " + Text(why) +
            "): set LimitMEMLOCK=infinity in the unit or raise RLIMIT_MEMLOCK");
  }
  sched_param parameter{};
  parameter.sched_priority = policy.priority;
  if (const int why = pthread_setschedparam(pthread_self(), SCHED_FIFO, &parameter); why != 0) {
    missing("acquisition runs without SCHED_FIFO priority " + std::to_string(policy.priority) +
            " (" + Text(why) + "): set LimitRTPRIO in the unit or grant CAP_SYS_NICE");
  }
  if (policy.cpu >= 0) {
    cpu_set_t cpus;
    CPU_ZERO(&cpus);
    CPU_SET(static_cast<std::size_t>(policy.cpu), &cpus);
    if (const int why = pthread_setaffinity_np(pthread_self(), sizeof cpus, &cpus); why != 0) {
      missing("acquisition is not pinned to CPU " + std::to_string(policy.cpu) + " (" + Text(why) +
              "): name a CPU that exists in [realtime] cpu");
    }
  }
  if (policy.required && !note.empty()) {
    return hal::Fail(hal::ErrorKind::kDevice, "[realtime] is required but " + note);
  }
  return note;
}

hal::Result<std::string> FavourPipeline(const RealtimePolicy& policy) {
  if (!policy.enabled) return std::string();
  // On Linux this is the calling thread alone.
  if (setpriority(PRIO_PROCESS, static_cast<id_t>(gettid()), kPipelineNice) == 0) {
    return std::string();
  }
  std::string note = "the pipeline runs without nice " + std::to_string(kPipelineNice) + " (" +
                     Text(errno) + "): set LimitNICE=" + std::to_string(kPipelineNice) +
                     " in the unit or grant CAP_SYS_NICE";
  if (policy.required) {
    return hal::Fail(hal::ErrorKind::kDevice, "[realtime] is required but " + note);
  }
  return note;
}

void KeepMemory() {
  mallopt(M_MMAP_THRESHOLD, 32 << 20);   // the largest that glibc takes
  mallopt(M_TRIM_THRESHOLD, 256 << 20);  // below it nothing goes back
  mallopt(M_ARENA_MAX, 2);               // short-lived threads share what there is
}

}  // namespace bendloop::host
