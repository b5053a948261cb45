#!/bin/sh
# Installs a build into a folder of its own: does each file have its place, do the programs and the examples
# work from there, do the READMEs' links hold?
# usage: install.sh BUILD
set -eu
build=$(realpath "$1")
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
fail() {
  echo "install.sh: $*" >&2
  exit 1
}

# there ROOT FILE...
there() {
  root=$1
  shift
  for file in "$@"; do [ -e "$root$file" ] || fail "$file is not installed"; done
}

echo "== cmake --install into a folder"
DESTDIR=$work/root flock "$build" cmake --install "$build" --prefix /usr/local >"$work/install.log" ||
  fail "$(tail -n 5 "$work/install.log")"
root=$work/root
there "$root" /usr/local/bin/bendloopd /usr/local/bin/bendloop /usr/local/bin/bendloop-simbender \
  /usr/local/bin/bendloop-simscanner /usr/local/bin/bendloop-usbscanner \
  /usr/local/lib/systemd/system/bendloopd.service /usr/local/lib/sysusers.d/bendloop.conf \
  /usr/local/lib/tmpfiles.d/bendloop.conf /usr/local/lib/udev/rules.d/70-bendloop-scanner.rules \
  /usr/local/share/doc/bendloop/README.md /usr/local/share/doc/bendloop/LICENSE \
  /usr/local/share/doc/bendloop/NOTICE.md /usr/local/share/doc/bendloop/bendloop.spdx.json \
  /usr/local/share/doc/bendloop/SECURITY.md /usr/local/share/doc/bendloop/systemd/MAINTAINER.md \
  /usr/local/share/doc/bendloop/drivers/INTEGRATOR.md /usr/local/share/doc/bendloop/firmware-host/cli/SETTER.md \
  /usr/local/share/man/man1/bendloop.1.gz /usr/local/share/man/man1/bendloop-demo.1.gz \
  /usr/local/share/man/man8/bendloopd.8.gz /usr/local/share/bash-completion/completions/bendloop \
  /usr/local/share/zsh/vendor-completions/_bendloop /etc/bendloop/register-maps/default.toml
[ ! -e "$root/usr/local/share/doc/bendloop/copyright" ] || fail "Debian's files belong into the packages only"
sed -n 's/^Exec[A-Za-z]*=[-+!]*\([^ ]*\).*/\1/p' "$root/usr/local/lib/systemd/system/bendloopd.service" |
  while read -r program; do
    case $program in /usr/*) ;; *) fail "the unit runs $program, and has nothing but /usr in its root folder" ;; esac
    [ "$program" = /usr/bin/sh ] || there "$root" "$program"  # the system's own
  done

bom=$root/usr/local/share/doc/bendloop/bendloop.spdx.json
! grep -o '"name": "[^"]*", "versionInfo": "[^"]*", "supplier.*"licenseConcluded": "NOASSERTION"' "$bom" ||
  fail "the licence of these is not known; systemd/licences.txt"
grep -q '"relationshipType": "STATIC_LINK", "relatedSpdxElement": "SPDXRef-libceres-dev"' "$bom" ||
  fail "the bill of materials lacks what was linked: $(wc -c <"$bom") bytes"

echo "== The shipped files, where they were installed"
bendloop=$root/usr/local/bin/bendloop
examples=$root/usr/local/share/doc/bendloop/examples
"$bendloop" check "$examples"/cells/*.toml "$examples"/parts/*.toml "$examples"/register-maps/*.toml \
  "$examples"/object-dictionaries/*.eds "$root"/etc/bendloop/*/* >"$work/check.log" 2>&1 ||
  fail "$(cat "$work/check.log")"

# A cell on the network, by the words of systemd/README.md: the unit alone does not let the daemon reach it,
# which the daemon says; with the cell's drop-in it is content.
cell=$root/etc/bendloop/cell.toml
sed 's#"\.\./#"#' "$examples/cells/press-shop.toml" >"$cell"
granted() { sed -n 's/^Environment="BENDLOOP_GRANTED=\(.*\)"$/\1/p' "$1"; }
code=0
BENDLOOP_GRANTED=$(granted "$root/usr/local/lib/systemd/system/bendloopd.service") \
  "$root/usr/local/bin/bendloopd" --config "$cell" >"$work/refused" 2>&1 || code=$?
[ "$code" = 3 ] || fail "expected exit code 3 of a daemon that the unit does not let out, got $code"
grep -q 'the cell needs 192.168.10.20: bendloop check --unit-drop-in' "$work/refused" || fail "$(cat "$work/refused")"
"$bendloop" check --unit-drop-in "$cell" >"$work/drop-in"
BENDLOOP_GRANTED=$(granted "$work/drop-in") "$root/usr/local/bin/bendloopd" --config "$cell" --check-only \
  >"$work/accepted" 2>&1 || fail "$(cat "$work/accepted")"

# Links from one README to another hold there, too.
doc=$root/usr/local/share/doc/bendloop
(cd "$doc" && grep -o '](\([^)#:]*\.\(md\|svg\|png\)\)' -r . --include='*.md') | while IFS=: read -r page link; do
  link=${link#](}
  [ -e "$doc/$(dirname "$page")/$link" ] || fail "$page: its link to $link leads nowhere"
done
