#!/bin/sh
# Packs a build into WORK/packages, and prints the name of a disk image with a bare Debian that can install
# them without a network; made once and kept in CACHE, not to be written to.
# usage: appliance_image.sh BUILD CACHE WORK       needs root; exits with 77 where none can be made
#   BUILD  a build folder, or one with packages that were made before
set -eu
build=$(realpath "$1")
cache=$2
work=$3
here=$(dirname -- "$(realpath "$0")")
PATH=$PATH:/usr/sbin:/sbin
mkdir -p "$cache"
# Two tests may come at once; each packs what the build's folder is needed for.
exec 8>"$cache/image-lock"
flock 8
if [ -e "$build/CPackConfig.cmake" ]; then
  (cd "$build" && cpack -G DEB -B "$work/packages") >"$work/cpack.log" 2>&1 || {
    cat "$work/cpack.log" >&2
    exit 1
  }
else
  mkdir "$work/packages"
  cp "$build"/bendloop_*.deb "$build"/bendloop-demo_*.deb "$work/packages"
fi
tar=$("$here/debian_root.sh" "$cache" "$work"/packages/bendloop_*.deb "$work"/packages/bendloop-demo_*.deb)
image=${tar%.tar}.ext4
if [ ! -e "$image" ]; then
  rm -f "$cache"/debian-root-*.ext4
  mkdir "$work/root"
  tar -C "$work/root" -xf "$tar" || {
    echo "############ NOT TRIED: a Debian cannot be unpacked here ############" >&2
    exit 77
  }
  # Sparse: what the packages and the recordings need, and no more.
  mke2fs -q -t ext4 -d "$work/root" "$image.new" 2G >&2
  mv "$image.new" "$image"
  rm -rf "$work/root"
fi
echo "$image"
