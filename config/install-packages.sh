#!/bin/sh
# Installs the Debian packages of the given sections of debian-packages.txt that are missing.
# usage: install-packages.sh SECTION...        e.g. install-packages.sh build test
set -eu

list=$(dirname -- "$0")/debian-packages.txt

# The package names of one section.
section() {
  awk -v wanted="[$1]" '
    /^\[/ { here = ($1 == wanted); found = found || here; next }
    here && NF && $1 !~ /^#/ { print $1 }
    END { exit !found }' "$list" || {
    echo "install-packages.sh: no section [$1] in $list" >&2
    return 2
  }
}

if [ $# -eq 0 ]; then
  echo "usage: install-packages.sh SECTION...   (sections of $list)" >&2
  exit 2
fi

missing=
for name in "$@"; do
  packages=$(section "$name")
  for package in $packages; do
    state=$(dpkg-query -W -f '${db:Status-Status}' "$package" 2>/dev/null || true)
    [ "$state" = installed ] || missing="$missing $package"
  done
done
if [ -z "$missing" ]; then
  echo "== Packages: nothing missing"
  exit 0
fi

echo "== Packages: installing$missing"
if [ "$(id -u)" -eq 0 ]; then
  as_root=
elif command -v sudo >/dev/null 2>&1; then
  as_root=sudo
else
  echo "These packages are missing, and only root or sudo can install them. As root:" >&2
  echo "  apt-get update && apt-get install$missing" >&2
  exit 4
fi
$as_root apt-get -q update </dev/null
# shellcheck disable=SC2086  # the names are separate words
$as_root env DEBIAN_FRONTEND=noninteractive \
  apt-get -q -y --no-install-recommends install $missing </dev/null
