#!/bin/sh
# Version 0.1.0, from a package of its commit (old_package.sh), at work in a Debian under qemu, and upgraded there to the
# packages of a build: upgrade_guest.sh says what is tried.
# usage: appliance_upgrade.sh BUILD CACHE
# Needs root for the guest's disk, and the project's history for the old version. Exits with 77 where it cannot be tried.
set -eu
build=$1
cache=$2
here=$(dirname -- "$(realpath "$0")")
work=$(mktemp -d)
trap 'rm -rf --one-file-system "$work"' EXIT
old=$("$here/old_package.sh" "$cache")
image=$("$here/appliance_image.sh" "$build" "$cache" "$work")
export GUEST_DISK="$image" GUEST_MEMORY_MB=1024 GUEST_CPUS=1 GUEST_SECONDS="${GUEST_SECONDS:-1500}"
"$here/run_guest.sh" "$cache" "" "$here/upgrade_guest.sh" "$old" "$work"/packages/bendloop_*.deb "$here/guest_service.sh" \
  "$here/one_bend.toml"
