#!/bin/sh
# Packs a build, and looks at what came out: does each file have its place, does lintian find nothing?
# usage: package.sh BUILD      exits with 77 where there is no dpkg-dev or lintian
set -eu
build=$(realpath "$1")
for tool in dpkg-deb dpkg-shlibdeps lintian; do
  command -v "$tool" >/dev/null || {
    echo "############ NOT PACKED: $tool is missing; config/install-packages.sh test root ############" >&2
    exit 77
  }
done
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
fail() {
  echo "package.sh: $*" >&2
  exit 1
}

# there ROOT FILE...
there() {
  root=$1
  shift
  for file in "$@"; do [ -e "$root$file" ] || fail "$file is not installed"; done
}

echo "== cpack"
(cd "$build" && cpack -G DEB -B "$work/packages") >"$work/cpack.log" 2>&1 || fail "$(cat "$work/cpack.log")"
! grep -i 'warning\|error' "$work/cpack.log" || fail "cpack complains"
host=$(echo "$work"/packages/bendloop_*.deb)
demo=$(echo "$work"/packages/bendloop-demo_*.deb)
set -- "$host" "$demo"
# Where OpenCASCADE is, its reader has a package of its own.
if [ -x "$build/bin/bendloop-cad" ]; then
  cad=$(echo "$work"/packages/bendloop-cad_*.deb)
  set -- "$@" "$cad"
fi
for package in "$@"; do
  mkdir -p "$work/deb"
  dpkg-deb -x "$package" "$work/deb"
done
there "$work/deb" /usr/bin/bendloopd /usr/bin/bendloop-simbender /usr/lib/systemd/system/bendloopd.service \
  /usr/share/man/man1/bendloop-simbender.1.gz /usr/share/doc/bendloop/copyright \
  /usr/share/doc/bendloop-demo/copyright /usr/share/doc/bendloop/changelog.gz
if [ $# = 3 ]; then
  there "$work/deb" /usr/libexec/bendloop/bendloop-cad /usr/share/doc/bendloop-cad/copyright
  bom=$work/deb/usr/share/doc/bendloop-cad/bendloop-cad.spdx.json
  there "" "$bom"
  ! grep -o '"name": "[^"]*", "versionInfo": "[^"]*", "supplier.*"licenseConcluded": "NOASSERTION"' "$bom" ||
    fail "the licence of these is not known; systemd/licences.txt"
  dpkg-deb -f "$cad" Depends | grep -q libocct-data-exchange || fail "bendloop-cad does not depend on OpenCASCADE"
  # The two that read CAD files find each other where the packages put them.
  "$work/deb/usr/bin/bendloop" nominal "$build/CMakeCache.txt" 2>&1 | grep -q 'STEP' ||
    fail "the installed bendloop does not find bendloop-cad"
  ! "$work/deb/usr/bin/bendloop" nominal "$build/CMakeCache.txt" 2>&1 | grep 'not installed' ||
    fail "the installed bendloop does not find bendloop-cad"
fi
[ ! -e "$work/deb/etc/bendloop/cell.toml" ] || fail "a cell is nobody's but its owner's"
dpkg-deb -I "$host" conffiles | sort >"$work/conffiles"
(cd "$work/deb" && find etc -type f | sed 's#^#/#' | sort) >"$work/edited"
cmp "$work/conffiles" "$work/edited" || fail "what lies below /etc and the conffiles are not the same"
for library in libmicrohttpd libmodbus libusb libsqlite3 libsystemd; do
  dpkg-deb -f "$host" Depends | grep -q "$library" || fail "does not depend on $library: $(dpkg-deb -f "$host" Depends)"
done
[ "$(dpkg-deb -f "$demo" Depends | grep -c "bendloop (= $(dpkg-deb -f "$host" Version))")" = 1 ] ||
  fail "bendloop-demo goes with another version than its own"
for script in postinst prerm postrm; do
  dpkg-deb -I "$host" "$script" >"$work/$script"
  sh -n "$work/$script"
done
# Nothing is enabled or started, and what dpkg runs asks nobody. What it only says stands in here-documents.
sed '/<<.*[A-Z]$\|<<.*[A-Z].$/,/^[A-Z]*$/d' "$work/postinst" >"$work/done"
grep -q try-restart "$work/done" || fail "what the package does was not found: $(cat "$work/done")"
! grep -E '^[^#]*(systemctl|deb-systemd-(invoke|helper)) .*(enable|start)' "$work/done" | grep -v try-restart ||
  fail "the package starts something"

echo "== lintian"
lintian --allow-root --fail-on error,warning "$@" || exit 1
stat -c "%s bytes: %n" "$@" | sed "s#$work/packages/##"
