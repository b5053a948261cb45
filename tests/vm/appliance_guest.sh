#!/bin/sh
# The packages of a build in a real Debian with systemd, under qemu: appliance.sh says what is tried.
# usage: appliance_guest.sh BUILD CACHE [KILLS]
#   KILLS  how often the daemon is killed (default 3)
# Needs root for the guest's disk, which is made once and kept in CACHE. Exits with 77 where it cannot be
# tried.
set -eu
build=$1
cache=$2
kills=${3:-3}
here=$(dirname -- "$(realpath "$0")")
work=$(mktemp -d)
trap 'rm -rf --one-file-system "$work"' EXIT
image=$("$here/appliance_image.sh" "$build" "$cache" "$work")
echo "$kills" >"$work/kills.txt"
# On a busy host the proof takes up to a quarter of an hour, and a kill up to a minute.
export GUEST_DISK="$image" GUEST_MEMORY_MB=1024 GUEST_CPUS=1 \
  GUEST_SECONDS="${GUEST_SECONDS:-$((1200 + 60 * kills))}"
"$here/run_guest.sh" "$cache" "" "$here/appliance.sh" "$work"/packages/bendloop_*.deb \
  "$work"/packages/bendloop-demo_*.deb "$here/guest_service.sh" "$here/one_bend.toml" "$work/kills.txt"
