#!/bin/sh
# For maintainers: does the README hold on a bare Debian 12? Makes a new minimal root (apt and git,
# nothing else), clones the current commit into it, runs ./demo and ./check there and says how it
# went. Needs root, mmdebstrap, a few GB and, for ./check, up to half an hour.
# usage: fresh_root.sh [--keep] [--dir FOLDER] [STEP...]
#   STEP    packages | configure | demo | check; without one: demo check
#   --keep  leave the root for a look; the next run with the same --dir goes on with it
#   --dir   where the root goes (default: a new folder below ${TMPDIR:-/tmp})
# MIRROR in the environment is used instead of the mirror of the host's apt sources.
set -eu

keep=
root=
steps=
while [ $# -gt 0 ]; do
  case $1 in
    --keep) keep=yes ;;
    --dir)
      root=${2:?--dir needs a folder}
      shift
      ;;
    packages | configure | demo | check) steps="$steps $1" ;;
    *)
      sed -n '5,9s/^# \{0,1\}//p' "$0" >&2
      exit 2
      ;;
  esac
  shift
done
[ -n "$steps" ] || steps="demo check"

[ "$(id -u)" -eq 0 ] || { echo "fresh_root.sh: must run as root (chroot)" >&2; exit 2; }
source_dir=$(cd -- "$(dirname -- "$0")/../.." && pwd -P)
"$source_dir/config/install-packages.sh" root
[ -n "$root" ] || root=$(mktemp -d "${TMPDIR:-/tmp}/bendloop-root-XXXXXX")
mkdir -p "$root"
root=$(cd -- "$root" && pwd -P)

marker=.bendloop-fresh-root
if [ -n "$(ls -A "$root")" ] && [ ! -e "$root/$marker" ]; then
  echo "fresh_root.sh: $root holds other files, expected an empty folder or a root of ours" >&2
  exit 2
fi
touch "$root/$marker"

say() { echo "== $*"; }

# shellcheck disable=SC2317  # called by the trap
cleanup() {
  for folder in proc dev/pts dev/shm dev sys; do
    if mountpoint -q "$root/$folder"; then umount "$root/$folder"; fi
  done
  if [ -z "$keep" ]; then
    # Never through a mount that would not go away.
    rm -rf --one-file-system "$root"
  else
    say "The root stays in $root"
  fi
}
trap cleanup EXIT
trap 'exit 130' INT TERM

# shellcheck source=config/host-apt.sh
. "$source_dir/config/host-apt.sh"
mirror=$(host_mirror)

if [ -e "$root/etc/debian_version" ]; then
  say "Going on with the root in $root"
else
  say "Making a minimal Debian 12 root from $mirror"
  settings=$(mktemp)
  host_apt_settings >"$settings"
  rm "$root/$marker"  # mmdebstrap wants an empty folder
  mmdebstrap --quiet --variant=apt --include=git,ca-certificates \
    --aptopt="$settings" bookworm "$root" "$mirror"
  touch "$root/$marker"
  rm -f "$settings"
fi
mount --bind /dev "$root/dev"
if mountpoint -q /dev/shm; then mount --bind /dev/shm "$root/dev/shm"; fi
mount -t proc proc "$root/proc"
if [ -e /etc/resolv.conf ]; then cp -L /etc/resolv.conf "$root/etc/resolv.conf"; fi

say "Cloning $(git -c safe.directory="$source_dir" -C "$source_dir" rev-parse --short HEAD)"
rm -rf "$root/root/bendloop"
git -c safe.directory='*' clone -q "$source_dir" "$root/root/bendloop"

# inside COMMAND: in the clone, with an empty environment, as a new user would type it.
inside() {
  chroot "$root" /usr/bin/env -i HOME=/root LANG=C.UTF-8 \
    http_proxy="${http_proxy:-}" https_proxy="${https_proxy:-}" \
    PATH=/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin \
    /bin/sh -c "cd /root/bendloop && $1" </dev/null
}

outcome=0
report=
for step in $steps; do
  case $step in
    packages) command="config/install-packages.sh build test" ;;
    configure) command="cmake --preset release && cmake --preset asan" ;;
    *) command="./$step" ;;
  esac
  say "In the new root: $command"
  begun=$(date +%s)
  if inside "$command" >"$root/root/$step.log" 2>&1; then
    result=passed
  else
    result=FAILED
    outcome=1
  fi
  tail -n 15 "$root/root/$step.log"
  left=$(inside "git status --porcelain")
  if [ -n "$left" ]; then
    result="$result, but left the tree changed: $(echo "$left" | tr '\n' ' ')"
    outcome=1
  fi
  report="$report$step: $result in $(($(date +%s) - begun)) s
"
done
say "Outcomes"
printf '%s' "$report"
[ "$outcome" -eq 0 ] || keep=yes
exit "$outcome"
