#!/bin/sh
# Version 0.1.0 as a Debian package, built from its commit once and kept in CACHE. It had none of its own: programs,
# simulators, unit, user, folders, the shipped parts and maps lie where its systemd/README.md had them put.
# usage: old_package.sh CACHE      prints the package's name; exits with 77 where its sources are not to be had
set -eu
commit=803fbb2
mkdir -p "$1"
cache=$(realpath "$1")
here=$(dirname -- "$(realpath "$0")")
package=$cache/bendloop_0.1.0_$(dpkg --print-architecture).deb
skip() {
  echo "############ NOT TRIED: $* ############" >&2
  exit 77
}
if [ -e "$package" ]; then
  echo "$package"
  exit 0
fi
command -v dpkg-shlibdeps >/dev/null || skip "dpkg-shlibdeps is missing; config/install-packages.sh build"
source=$cache/bendloop-0.1.0
if [ ! -e "$source/CMakeLists.txt" ]; then
  mkdir -p "$source.new"
  git -c safe.directory='*' -C "$here/../.." archive "$commit" 2>/dev/null | tar -C "$source.new" -x 2>/dev/null ||
    skip "commit $commit is not in this checkout's history"
  mv "$source.new" "$source"
fi
echo "old_package: building version 0.1.0, some minutes" >&2
build=$source/build/release
cmake -S "$source" -B "$build" -G Ninja -DCMAKE_BUILD_TYPE=Release -DBUILD_TESTING=OFF -DBENDLOOP_BENCH=OFF >&2
cmake --build "$build" --target bendloop bendloopd bendloop-simbender bendloop-simscanner >&2

root=$cache/bendloop-0.1.0-root
rm -rf "$root"
put() { install -D -m "$1" "$2" "$root$3"; }
for program in bendloop bendloopd bendloop-simbender bendloop-simscanner; do
  put 755 "$build/bin/$program" "/usr/bin/$program"
done
put 644 "$source/systemd/bendloopd.service" /lib/systemd/system/bendloopd.service
put 644 "$source/systemd/bendloop.sysusers.conf" /usr/lib/sysusers.d/bendloop.conf
put 644 "$source/systemd/bendloop.tmpfiles.conf" /usr/lib/tmpfiles.d/bendloop.conf
put 644 "$source/config/70-bendloop-scanner.rules" /usr/lib/udev/rules.d/70-bendloop-scanner.rules
for file in "$source"/config/parts/*.toml "$source"/config/register-maps/*.toml; do
  put 644 "$file" "/usr/share/bendloop/$(basename "$(dirname "$file")")/$(basename "$file")"
done
mkdir -p "$root/DEBIAN" "$root.needs/debian"
printf 'Source: bendloop\n\nPackage: bendloop\nArchitecture: any\n' >"$root.needs/debian/control"
needs=$(cd "$root.needs" && dpkg-shlibdeps -O "$root"/usr/bin/* 2>/dev/null | sed -n 's/^shlibs:Depends=//p')
cat >"$root/DEBIAN/control" <<CONTROL
Package: bendloop
Version: 0.1.0
Architecture: $(dpkg --print-architecture)
Maintainer: bendloop maintainers <maintainers@bendloop.invalid>
Depends: systemd, $needs
Description: tube inspection and correction beside a bending cell, version 0.1.0
CONTROL
for script in postinst prerm; do put 755 "$here/../../systemd/debian/$script" "/DEBIAN/$script"; done
dpkg-deb -Zgzip --root-owner-group -b "$root" "$package.new" >&2
rm -rf "$root" "$root.needs"
mv "$package.new" "$package"
echo "$package"
