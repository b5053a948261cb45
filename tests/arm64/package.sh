#!/bin/sh
# The Debian packages of the build for arm64: they are made, they name arm64's libraries with the
# versions that they need, and the programs in them run.
# usage: package.sh BUILD EMULATOR...
set -eu
build=$1
shift
fail() {
  echo "package.sh: $*" >&2
  exit 1
}
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$build"
rm -f packages/*.deb
cpack -G DEB >"$work/log" 2>&1 || {
  cat "$work/log" >&2
  fail "cpack failed"
}
for name in bendloop bendloop-demo; do
  package=$(echo packages/"$name"_*_arm64.deb)
  [ -e "$package" ] || fail "$package was not made"
  [ "$(dpkg-deb -f "$package" Architecture)" = arm64 ] || fail "$package is not for arm64"
  dpkg-deb -f "$package" Depends | grep -q 'libc6 (>= ' || fail "$package does not say which libc6"
  dpkg-deb -x "$package" "$work"
done
# Whatever a program loads is in the sysroot because some package of the dependencies brings it.
needs=$(dpkg-deb -f packages/bendloop_*_arm64.deb Depends)
for library in libmodbus5 libsqlite3-0 libusb-1.0-0 libmicrohttpd12; do
  case $needs in *"$library"*) ;; *) fail "does not depend on $library: $needs" ;; esac
done
"$@" "$work/usr/bin/bendloop" --version
for manual in bendloop.1 bendloop-simbender.1; do
  [ -s "$work/usr/share/man/man1/$manual.gz" ] || fail "no manual page $manual"
done
grep -q 'arch=arm64' "$work/usr/share/doc/bendloop/bendloop.spdx.json" || fail "the SBOM does not name arm64's packages"
