# shellcheck shell=sh disable=SC2034,SC2154
# A guest's disk on which apt has installed packages: made here, in a moment, where a guest in software would take a minute.
# Sourced, with work set, the folder for it; needs root.
root=$work/root
inside() { chroot "$root" /usr/bin/env -i PATH=/usr/sbin:/usr/bin:/sbin:/bin DEBIAN_FRONTEND=noninteractive "$@" </dev/null; }
# root_with TAR PACKAGE...: that Debian in root, with these; what apt says is in work/install.log
root_with() {
  mkdir "$root"
  tar -C "$root" -xf "$1" || {
    echo "############ NOT TRIED: a Debian cannot be unpacked here ############" >&2
    exit 77
  }
  shift
  mount -t proc proc "$root/proc" || {
    echo "############ NOT TRIED: nothing can be mounted here ############" >&2
    exit 77
  }
  names=
  for package in "$@"; do names="$names ./$(basename "$package")"; done
  cp "$@" "$root/root"
  inside sh -c "cd /root && apt-get -q -y install$names" >"$work/install.log" 2>&1 || {
    cat "$work/install.log" >&2
    return 1
  }
}
# root_to DISK: an image of it, in place of the folder
root_to() {
  root_off
  mke2fs -q -t ext4 -d "$root" "$1" 2G >&2
  rm -rf --one-file-system "$root"
}
# root_off: for whoever cleans up
root_off() {
  if mountpoint -q "$root/proc"; then umount "$root/proc"; fi
}
