#!/bin/sh
# Runs a command where programs for arm64 start as others do, also those that tests start themselves.
# usage: with_emulator.sh SYSROOT COMMAND...
# Where the machine does not start them already (Debian's qemu-user-static does, once systemd has read
# what it brings), qemu-user is registered for this command alone, in a user namespace of its own.
set -eu
QEMU_LD_PREFIX=$(realpath -- "$1")
export QEMU_LD_PREFIX
shift
mine=/proc/sys/fs/binfmt_misc
if [ -e $mine/qemu-aarch64 ]; then exec "$@"; fi
if ! unshare --map-root-user --mount mount -t binfmt_misc binfmt_misc $mine 2>/dev/null; then
  echo "with_emulator.sh: arm64 programs do not start here, and this kernel (before Linux 6.7, or without" \
    "user namespaces) does not let one command have that alone; as root: systemctl restart systemd-binfmt" >&2
  exit 1
fi
# Root keeps being all users there, as tests become others; whoever else is, is root and nobody else.
maps=--map-root-user
sync=
if [ "$(id -u)" = 0 ]; then
  maps=--user
  sync=$(mktemp -d)
  mkfifo "$sync/pid" "$sync/mapped"
  {
    read -r pid <"$sync/pid"
    for kind in uid gid; do echo "0 0 65536" >"/proc/$pid/${kind}_map"; done
    echo >"$sync/mapped"
    rm -r "$sync"
  } &
fi
# The shell that waits has lost its rights, as it began as nobody: the next one has them.
# shellcheck disable=SC2016  # for the inner shells
exec unshare $maps --mount sh -euc '
  if [ -n "$0" ]; then
    echo $$ >"$0/pid"
    read -r _ <"$0/mapped" || :
  fi
  exec sh -euc "$@"' "$sync" '
  mount -t binfmt_misc binfmt_misc "$0"
  grep -v "^#" /usr/lib/binfmt.d/qemu-aarch64.conf >"$0/register"
  exec "$@"' $mine "$@"
