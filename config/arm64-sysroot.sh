#!/bin/sh
# What an arm64 build reads and its programs load: Debian's arm64 packages of the libraries, unpacked
# into a folder and not installed. So this machine's own packages stay as they are, and it does not
# matter which -dev packages refuse to be installed for two architectures. Made once, and again when
# the list of packages has changed.
# usage: arm64-sysroot.sh FOLDER      MIRROR in the environment: instead of the host's Debian mirror
set -eu
folder=$(realpath -m -- "$1")
here=$(cd -- "$(dirname -- "$0")" && pwd -P)

# The libraries of the build. Which BLAS and LAPACK is said here, as apt may take any that provides them.
wanted=$(awk '/^\[/ { here = ($1 == "[build]"); next }
  here && ($1 ~ /^lib/ || $1 ~ /-dev$/) { print $1 }' "$here/debian-packages.txt")
wanted="$wanted libc6-dev libblas-dev liblapack-dev"
stamp=$(echo "$folder $wanted" | cat - "$0" | sha256sum | cut -c 1-16)
[ "$(cat "$folder/.bendloop-stamp" 2>/dev/null || true)" != "$stamp" ] || exit 0

# shellcheck source=config/host-apt.sh
. "$here/host-apt.sh"
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
host_apt_settings >"$work/apt"

# dpkg's own records of what lies there, by the names that files have here: dpkg-shlibdeps (for the
# packages' dependencies) and sbom.sh ask them.
cat >"$work/records" <<'HOOK'
set -eu
database=$1/var/lib/dpkg
mkdir -p "$database/info"
echo 1 >"$database/info/format"
for package in "$1"/var/cache/apt/archives/*.deb; do
  name=$(dpkg-deb -f "$package" Package)
  if [ "$(dpkg-deb -f "$package" Multi-Arch)" = same ]; then name=$name:arm64; fi
  dpkg-deb --fsys-tarfile "$package" | tar -t | sed "s#/\$##; s#^\.#$1#" >"$database/info/$name.list"
  dpkg-deb --control "$package" "$1/control"
  for file in symbols shlibs md5sums; do
    [ ! -e "$1/control/$file" ] || mv "$1/control/$file" "$database/info/$name.$file"
  done
  { sed '1a Status: install ok installed' "$1/control/control" && echo; } >>"$database/status"
  rm -rf "$1/control"
done
HOOK

echo "== Libraries for arm64: $folder"
rm -rf "$folder"
mkdir -p "$folder"
mmdebstrap --quiet --architectures=arm64 --variant=extract --aptopt="$work/apt" \
  --include="$(echo "$wanted" | xargs | tr ' ' ,)" --extract-hook="sh $work/records \"\$1\"" \
  bookworm "$folder" "$(host_mirror)"

# qemu-user looks there for every file first: no device, no /etc and no /tmp but the machine's.
find "$folder" -mindepth 1 -maxdepth 1 ! -name usr ! -name 'lib*' ! -name var -exec rm -rf --one-file-system {} +
# What the packages' own scripts would have done: the loader finds no library in a folder of its own,
# and links are to stay below the folder.
libraries=$folder/usr/lib/aarch64-linux-gnu
for library in blas/libblas lapack/liblapack; do
  for ending in so so.3; do ln -sf "$library.$ending" "$libraries/$(basename "$library").$ending"; done
done
find "$folder" -type l -lname '/*' | while read -r link; do
  ln -sfn --relative -- "$folder$(readlink "$link")" "$link"
done
# CMake packages find themselves wherever they lie, but Ceres' names other libraries by where they would.
# shellcheck disable=SC2016  # CMake's variable
find "$libraries/cmake" -name '*.cmake' -exec sed -i 's#;/usr/lib/#;${CMAKE_SYSROOT}/usr/lib/#g' {} +
echo "$stamp" >"$folder/.bendloop-stamp"
