#!/bin/sh
# The packages' life in a bare Debian 12 of their own (a chroot): installed by apt, tried, upgraded,
# removed, installed again, purged. What the service does is seen in a guest (tests/vm).
# usage: package_root.sh BUILD CACHE     needs root; exits with 77 where no Debian can be made
set -eu
build=$(realpath "$1")
cache=$2
here=$(dirname -- "$(realpath "$0")")
work=$(mktemp -d)
root=$work/root
# shellcheck disable=SC2317  # called by the trap
cleanup() {
  if mountpoint -q "$root/proc"; then umount "$root/proc"; fi
  rm -rf --one-file-system "$work"
}
trap cleanup EXIT
fail() {
  echo "package_root.sh: $*" >&2
  exit 1
}
step() { echo "== $*"; }
inside() { chroot "$root" /usr/bin/env -i LANG=C.UTF-8 PATH=/usr/sbin:/usr/bin:/sbin:/bin DEBIAN_FRONTEND=noninteractive "$@" </dev/null; }

step "Packing this version, and one that is newer"
(cd "$build" && cpack -G DEB -B "$work/packages") >"$work/cpack.log" 2>&1 || fail "$(cat "$work/cpack.log")"
# The reader of CAD files is a program without state; its OpenCASCADE is not in this root.
rm -f "$work"/packages/bendloop-cad_*.deb
version=$(dpkg-deb -f "$work"/packages/bendloop_*.deb Version)
newer() { # newer PACKAGE: the same, as a later version
  mkdir "$work/repack"
  dpkg-deb -R "$1" "$work/repack"
  sed -i "s/^Version: .*/Version: $version+1/; s/bendloop (= $version)/bendloop (= $version+1)/" "$work/repack/DEBIAN/control"
  if [ -d "$work/repack/etc" ]; then
    echo "# a later version says more" >>"$work/repack/etc/bendloop/register-maps/default.toml"
  fi
  dpkg-deb -Zgzip --root-owner-group -b "$work/repack" "$work/newer" >/dev/null
  rm -rf "$work/repack"
}
mkdir "$work/newer"
for package in "$work"/packages/*.deb; do newer "$package"; done

step "A bare Debian 12"
tar=$("$here/../vm/debian_root.sh" "$cache" "$work"/packages/bendloop_*.deb "$work"/packages/bendloop-demo_*.deb)
mkdir "$root"
tar -C "$root" -xf "$tar"
mount -t proc proc "$root/proc"
cp "$work"/packages/*.deb "$root/root"
mkdir "$root/root/newer"
cp "$work"/newer/*.deb "$root/root/newer"

step "apt install ./bendloop*.deb"
inside sh -c 'cd /root && apt-get -q -y install ./bendloop*.deb' >"$work/install" 2>&1 || fail "$(cat "$work/install")"
grep -q 'no cell is configured yet, and nothing was started' "$work/install" || fail "does not say what to do next: $(cat "$work/install")"
inside id bendloop
[ "$(inside stat -c '%U %G %a' /var/lib/bendloop)" = "bendloop bendloop 750" ] || fail "/var/lib/bendloop: $(stat -c '%U %G %a' "$root/var/lib/bendloop")"
inside systemd-analyze verify bendloopd.service >"$work/verify" 2>&1 || fail "$(cat "$work/verify")"
[ ! -s "$work/verify" ] || fail "$(cat "$work/verify")"
[ ! -e "$root/etc/systemd/system/multi-user.target.wants/bendloopd.service" ] || fail "the service was enabled"

step "bendloop demo, as a user of no rights"
inside setpriv --reuid nobody --regid nogroup --clear-groups sh -c 'cd /tmp && bendloop demo --quick --no-color' >"$work/demo" || fail "$(cat "$work/demo")"
tail -n 5 "$work/demo"
[ -s "$root/tmp/demo-out/report.html" ] || fail "no report"

step "A cell by the installer's own words"
# Its line, not a copy of it here.
command=$(sed -n 's/^ *\(sed .*cell\.toml\)$/\1/p' "$work/install")
inside sh -c "$command"
inside bendloop check /etc/bendloop/cell.toml || fail "the example is wrong"
inside bendloopd --config /etc/bendloop/cell.toml --check-only

step "A stop that may last longer is told with the unit's own time, until the cell's drop-in has more"
cat >"$root/tmp/slow.toml" <<'END'
schema = "bendloop.cell/1"
name = "Slow"
part = "/etc/bendloop/parts/demo.toml"
[scanner]
kind = "stream"
port = 9
[bender]
link = "modbus-tcp"
port = 9
register_map = "/etc/bendloop/register-maps/default.toml"
commit_timeout_ms = 40000
END
stop_told() { # stop_told WORDS TIMES: by both programs together
  inside bendloop check /tmp/slow.toml >"$work/stop" 2>&1 || fail "$(cat "$work/stop")"
  inside bendloopd --config /tmp/slow.toml --check-only >>"$work/stop" 2>&1 || fail "$(cat "$work/stop")"
  [ "$(grep -c "$1" "$work/stop")" = "$2" ] || fail "not told $2 times, $1: $(cat "$work/stop")"
}
stop_told 'ended after 20000 ms (/usr/lib/systemd/system/bendloopd.service)' 2
drop_in=$root/etc/systemd/system/bendloopd.service.d
mkdir -p "$drop_in"
inside bendloop check --unit-drop-in /tmp/slow.toml >"$drop_in/50-cell.conf"
stop_told 'ended after' 0
printf '[Service]\nTimeoutStopSec=1min\n' >"$drop_in/60-site.conf"
stop_told 'ended after' 0
printf '[Service]\nTimeoutStopSec=3s\n' >"$drop_in/60-site.conf"
stop_told 'ended after 3000 ms (/etc/systemd/system/bendloopd.service.d/60-site.conf)' 2
rm -r "$drop_in"

step "Who is in the group may ask the daemon, and nobody else"
cat >"$root/tmp/asked.toml" <<'END'
schema = "bendloop.cell/1"
name = "Asked"
part = "/etc/bendloop/parts/demo.toml"
[scanner]
kind = "stream"
port = 9
[bender]
link = "none"
END
# As the unit does. Not `inside`, which would be a process between this one and the daemon.
chroot "$root" /usr/bin/setpriv --reuid bendloop --regid bendloop --clear-groups \
  sh -c 'umask 027; exec bendloopd --config /tmp/asked.toml --status-port 0' >"$work/daemon" 2>&1 </dev/null &
daemon=$!
tries=100
until grep -q 'info status:' "$work/daemon" || [ "$tries" = 0 ]; do
  tries=$((tries - 1))
  sleep 0.1
done
inside setpriv --reuid nobody --regid nogroup --groups bendloop bendloop lot hold --config /tmp/asked.toml ||
  fail "a member of the group may not ask: $(cat "$work/daemon")"
code=0
inside setpriv --reuid nobody --regid nogroup --clear-groups bendloop lot release --config /tmp/asked.toml \
  >"$work/stranger" 2>&1 || code=$?
if [ "$code" != 4 ] || ! grep -q 'may not ask this daemon' "$work/stranger"; then fail "a stranger asked: $(cat "$work/stranger")"; fi
kill "$daemon"
wait "$daemon" || fail "the daemon did not stop as it should: $(cat "$work/daemon")"

step "Upgrade: settings and data stay"
echo '# mine' >>"$root/etc/bendloop/register-maps/default.toml"
inside setpriv --reuid bendloop --regid bendloop --clear-groups sh -c 'echo kept > /var/lib/bendloop/data'
before=$(sha256sum "$root/etc/bendloop/cell.toml" "$root/etc/bendloop/register-maps/default.toml" "$root/var/lib/bendloop/data")
same() { [ "$(sha256sum "$root/etc/bendloop/cell.toml" "$root/etc/bendloop/register-maps/default.toml" "$root/var/lib/bendloop/data")" = "$before" ] || fail "$1 changed settings or data"; }
inside sh -c 'cd /root/newer && apt-get -q -y -o Dpkg::Options::=--force-confold install ./bendloop*.deb' >"$work/upgrade" 2>&1 || fail "$(cat "$work/upgrade")"
same "the upgrade"
[ -e "$root/etc/bendloop/register-maps/default.toml.dpkg-dist" ] || fail "the new register map is not laid beside the edited one"
! grep -q 'no cell is configured' "$work/upgrade" || fail "a configured cell is told to configure itself"

step "Copied by hand, as version 0.1.0 had it: told, and mended by the installer's own words"
copied="systemd/system/bendloopd.service tmpfiles.d/bendloop.conf"
for file in $copied; do
  mkdir -p "$root/etc/$(dirname "$file")"
  sed '/^Environment=\|root/d' "$root/usr/lib/$file" >"$root/etc/$file"
done
! grep -q 'by hand' "$work/upgrade" || fail "copies are told where none are: $(cat "$work/upgrade")"
inside bendloop doctor --json >"$work/doctor"
! grep -q 'etc/udev/rules.d' "$work/doctor" || fail "a copy that is not there: $(cat "$work/doctor")"
for file in $copied; do
  grep -q "/etc/$file is used in place of /usr/lib/$file" "$work/doctor" || fail "the doctor does not see it: $(cat "$work/doctor")"
done
inside sh -c 'cd /root/newer && apt-get -q -y -o Dpkg::Options::=--force-confold --reinstall install ./bendloop_*.deb' \
  >"$work/copies" 2>&1 || fail "$(cat "$work/copies")"
[ "$(grep -c '^  mv /etc/' "$work/copies")" = 2 ] || fail "does not tell the two copies: $(cat "$work/copies")"
# Its lines, not a copy of them here. No service manager runs here that would be asked.
sed -n '/^  mv \/etc/p; s/^  \(dpkg-reconfigure bendloop\) &&.*/\1/p' "$work/copies" >"$root/tmp/mend"
rm -rf "$root/run/bendloop"
inside sh -e /tmp/mend >"$work/mended" 2>&1 || fail "the mend: $(cat "$work/mended")"
! grep -q 'by hand' "$work/mended" || fail "still told: $(cat "$work/mended")"
[ -d "$root/run/bendloop/root" ] || fail "the daemon's root folder is not made: $(cat "$work/mended")"
inside bendloop doctor --json >"$work/doctor"
! grep -q 'is used in place of' "$work/doctor" || fail "the doctor still tells it: $(cat "$work/doctor")"
for file in $copied; do
  [ -e "$root/etc/$file.old" ] || fail "the copy of $file is lost"
  rm "$root/etc/$file.old"
done
same "the mend"

step "Remove: settings and data stay; install again: they are taken up"
inside apt-get -q -y remove bendloop bendloop-demo >"$work/remove" 2>&1 || fail "$(cat "$work/remove")"
same "removing"
[ ! -e "$root/usr/bin/bendloopd" ] || fail "bendloopd stayed"
inside sh -c 'cd /root/newer && apt-get -q -y -o Dpkg::Options::=--force-confold install ./bendloop*.deb' >"$work/again" 2>&1 || fail "$(cat "$work/again")"
same "installing again"

step "Purge: nothing stays"
inside apt-get -q -y purge bendloop bendloop-demo >"$work/purge" 2>&1 || fail "$(cat "$work/purge")"
left=$(find "$root/etc" "$root/usr" "$root/var/lib" -name '*bendloop*' ! -path '*/var/lib/dpkg/*' ! -path '*/var/lib/apt/*')
[ -z "$left" ] || fail "left behind: $left"
step "done"
