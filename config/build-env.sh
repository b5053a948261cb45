# shellcheck shell=sh
# Sourced by ./demo and ./check in the top folder: how this machine builds.

# One compiler a core, but not more than the memory bears: a file full of Eigen takes about 1.2 GB.
build_jobs() {
  cores=$(nproc)
  memory_mb=$(awk '/^MemAvailable:/ { print int($2 / 1024) }' /proc/meminfo 2>/dev/null || true)
  by_memory=$((${memory_mb:-4000} / 1200))
  [ "$by_memory" -ge 1 ] || by_memory=1
  if [ "$cores" -lt "$by_memory" ]; then echo "$cores"; else echo "$by_memory"; fi
}

if command -v ccache >/dev/null 2>&1; then
  CMAKE_C_COMPILER_LAUNCHER=${CMAKE_C_COMPILER_LAUNCHER-ccache}
  CMAKE_CXX_COMPILER_LAUNCHER=${CMAKE_CXX_COMPILER_LAUNCHER-ccache}
  # Precompiled headers may be kept, says ccache's manual, if it need not look at their times.
  CCACHE_SLOPPINESS=pch_defines,time_macros
  export CMAKE_C_COMPILER_LAUNCHER CMAKE_CXX_COMPILER_LAUNCHER CCACHE_SLOPPINESS
fi

# A build folder that was copied or moved from elsewhere still points there: begin it anew.
fresh_build_folder() {
  cache=build/$1/CMakeCache.txt
  [ -f "$cache" ] || return 0
  if ! grep -qxF "CMAKE_HOME_DIRECTORY:INTERNAL=$(pwd -P)" "$cache"; then
    echo "== build/$1 belongs to another folder: beginning it anew"
    rm -rf "build/$1"
  fi
}

# configure PRESET [-DNAME=VALUE...]: quiet unless it fails.
configure() {
  preset=$1
  shift
  fresh_build_folder "$preset"
  mkdir -p build
  if ! cmake --preset "$preset" "$@" >"build/configure-$preset.log" 2>&1; then
    cat "build/configure-$preset.log" >&2
    echo "cmake --preset $preset failed: the reason stands above" >&2
    return 1
  fi
}
