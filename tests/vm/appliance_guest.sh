#!/bin/sh
# The packages of a build in a real Debian with systemd, under qemu: appliance.sh says what is tried.
# usage: appliance_guest.sh BUILD CACHE [KILLS]      KILLS: how often the daemon is killed (default 3)
# Needs root for the guest's disk, which is made once and kept in CACHE. Exits with 77 where it cannot be
# tried.
set -eu
build=$(realpath "$1")
cache=$2
kills=${3:-3}
here=$(dirname -- "$(realpath "$0")")
PATH=$PATH:/usr/sbin:/sbin
work=$(mktemp -d)
trap 'rm -rf --one-file-system "$work"' EXIT
(cd "$build" && cpack -G DEB -B "$work/packages") >"$work/cpack.log" 2>&1 || {
  cat "$work/cpack.log" >&2
  exit 1
}
set -- "$work"/packages/bendloop_*.deb "$work"/packages/bendloop-demo_*.deb
tar=$("$here/debian_root.sh" "$cache" "$@")
image=${tar%.tar}.ext4
if [ ! -e "$image" ]; then
  rm -f "$cache"/debian-root-*.ext4
  mkdir "$work/root"
  tar -C "$work/root" -xf "$tar"
  # Sparse: what the packages and the recordings need, and no more.
  mke2fs -q -t ext4 -d "$work/root" "$image.new" 2G
  mv "$image.new" "$image"
  rm -rf "$work/root"
fi
echo "$kills" >"$work/kills.txt"
export GUEST_DISK="$image" GUEST_MEMORY_MB=1024 GUEST_CPUS=2
"$here/run_guest.sh" "$cache" "" "$here/appliance.sh" "$@" "$here/one_bend.toml" "$work/kills.txt"
