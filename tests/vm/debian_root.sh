#!/bin/sh
# A bare Debian 12 with systemd, and in its apt's cache all that the given packages depend on, so that
# they can be installed there without a network. Made once, and again when the packages depend on others.
# usage: debian_root.sh CACHE PACKAGE.deb...     prints the name of the tar file; needs root
# Exits with 77 where none can be made. MIRROR in the environment: instead of the host's mirror.
set -eu
cache=$1
shift
say() { echo "debian_root: $*" >&2; }
skip() {
  echo "############ NO DEBIAN ROOT: $* ############" >&2
  exit 77
}
[ "$(id -u)" -eq 0 ] || skip "only root can make one"
command -v mmdebstrap >/dev/null || skip "mmdebstrap is missing; config/install-packages.sh test"
mkdir -p "$cache"
cache=$(realpath "$cache")
exec 9>"$cache/root-lock"
flock 9

needs=$(for package in "$@"; do dpkg-deb -f "$package" Depends Recommends; done)
root=$cache/debian-root-$(echo "2 $needs" | sha256sum | cut -c 1-12).tar
if [ ! -e "$root" ]; then
  rm -f "$cache"/debian-root-*
  # shellcheck source=config/host-apt.sh
  . "$(dirname -- "$0")/../../config/host-apt.sh"
  settings=$(mktemp)
  trap 'rm -f "$settings" "$root.new"' EXIT
  host_apt_settings >"$settings"
  say "making $(basename "$root")"
  names=
  for package in "$@"; do names="$names /root/$(basename "$package")"; done
  # It has apt run `cat >&FD`, and the shell knows no number of two digits: descriptors that ctest and our
  # locks leave open would make its own one.
  # shellcheck disable=SC2016  # $1 is the new root, for mmdebstrap
  timeout 300 mmdebstrap --quiet --variant=minbase --format=tar --include=systemd,systemd-sysv,udev,dbus --skip=cleanup/apt \
    --aptopt="$settings" --customize-hook="copy-in $* /root" \
    --customize-hook='chroot "$1" apt-get clean' \
    --customize-hook='chroot "$1" apt-get -qq -y --download-only install'"$names" \
    --customize-hook='rm "$1"/root/*.deb' --customize-hook="$(dirname -- "$(realpath "$0")")/debian_lists.sh"' "$1"' \
    bookworm "$root.new" "$(host_mirror)" >&2 3>&- 4>&- 5>&- 6>&- 7>&- 8>&- 9>&- ||
    skip "mmdebstrap failed, or took longer than 300 s"
  mv "$root.new" "$root"
fi
echo "$root"
