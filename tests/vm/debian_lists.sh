#!/bin/sh
# Leaves in a Debian root's package lists only what it has installed or in apt's cache: apt in a guest in software
# reads 50 MB of others for a minute.
# usage: debian_lists.sh ROOT
set -eu
root=$1
{
  sed -n 's/^Package: //p' "$root/var/lib/dpkg/status"
  find "$root/var/cache/apt/archives" -name '*.deb' -printf '%f\n' | sed 's/_.*//'
} | sort -u >"$root/kept"
for list in "$root"/var/lib/apt/lists/*_Packages; do
  awk -v kept="$root/kept" '
    BEGIN { while ((getline name < kept) > 0) is_kept[name] = 1; RS = ""; ORS = "\n\n" }
    is_kept[substr($0, 10, index($0 "\n", "\n") - 10)]' "$list" >"$list.kept"
  mv "$list.kept" "$list"
done
rm -f "$root/kept" "$root"/var/cache/apt/*pkgcache.bin
chroot "$root" apt-cache stats >/dev/null
