#!/bin/sh
# Runs a shell script in a guest with Debian's own kernel under qemu: real CAN, whatever the host has.
# usage: run_guest.sh CACHE MODULES SCRIPT [PROGRAM[:PLACE]]...
#   CACHE    folder for the kernel, outside the sources; kept, and shared by all runs
#   MODULES  kernel modules to load in the guest, with what they need: "vcan can-raw"
#   SCRIPT   for busybox's sh; the exit code comes back
#   PROGRAM  to take along, with its libraries; to /usr/bin or to PLACE
# With GUEST_DISK=IMAGE, an ext4 file system with a Debian, the guest runs that one's systemd, and the script
# with its sh as /root/script; programs and files named lie in /root. What it changes on the disk is lost.
# GUEST_DISK_STAYS=1 keeps it; GUEST_WRITES=LOG also writes down each of its writes and flushes, in order (the
# format of dm-log-writes), for power_cut.py.
# GUEST_NET=1: a network of its own, on which 10.0.2.2 is the host's 127.0.0.1.
# GUEST_SERIAL=/dev/pts/N: what its second serial port is connected with.
# GUEST_PID=FILE gets qemu's process number: who kills it takes the guest's power.
# GUEST_MEMORY_MB (512) and GUEST_CPUS (1) are the guest's.
# Exits with the script's code, 124 if the guest hangs, 125 if it dies, 137 if it was killed, 77 if there is no qemu or no
# kernel to be had.
set -eu

no_guest() {
  echo "############ NOT TESTED IN A GUEST: $* ############" >&2
  exit 77
}
say() { echo "run_guest: $*" >&2; }

cache=$1
modules=$2
script=$3
shift 3
for tool in qemu-system-x86_64 busybox cpio modprobe dpkg-deb apt-get xz flock; do
  command -v "$tool" >/dev/null || PATH=$PATH:/usr/sbin:/sbin command -v "$tool" >/dev/null ||
    no_guest "$tool is missing; config/install-packages.sh test"
done
PATH=$PATH:/usr/sbin:/sbin
[ "$(uname -m)" = x86_64 ] || no_guest "only x86_64 guests are made"

mkdir -p "$cache"
cache=$(realpath "$cache")
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT INT TERM

# vmlinux BZIMAGE: unpacks the kernel that Debian packs with xz; booting it so saves half the time.
unpack_vmlinux() {
  number() { od -An -v -j "$2" -N "$3" -t "u$3" "$1" | tr -d ' '; }
  start=$((($(number "$1" 497 1) + 1) * 512 + $(number "$1" 584 4)))
  size=$(number "$1" 588 4)
  tail -c +$((start + 1)) "$1" | head -c "$size" | xz -dc --single-stream 2>/dev/null >"$2" || true
  [ "$(head -c 4 "$2" | od -An -c | tr -d ' ')" = '177ELF' ]
}

fetch_kernel() {
  # Asking apt takes seconds: again only when it has newer lists.
  known=$cache/kernel-package
  # shellcheck disable=SC3013  # dash and busybox know -nt
  if [ "$known" -nt /var/lib/apt/lists ]; then
    package=$(cat "$known")
  else
    package=$(apt-cache depends linux-image-amd64 2>/dev/null |
      awk '/Depends: linux-image-/ { print $2; exit }')
    echo "$package" >"$known"
  fi
  if [ -z "$package" ]; then
    # Without package lists (a machine off the net): what was fetched before does.
    for old in "$cache"/linux-image-*; do [ -e "$old/vmlinux" ] && package=${old##*/}; done
    [ -n "$package" ] || no_guest "apt knows no linux-image-amd64 (apt-get update?)"
  fi
  kernel=$cache/$package
  [ ! -e "$kernel/vmlinux" ] || return 0
  say "fetching $package"
  rm -rf "$kernel" "$cache/new"
  mkdir -p "$cache/new"
  (cd "$cache/new" && apt-get -qq download "$package" 2>"$work/apt") ||
    no_guest "$package cannot be fetched: $(tail -n 1 "$work/apt")"
  dpkg-deb -x "$cache"/new/*.deb "$cache/new"
  rm "$cache"/new/*.deb
  [ -d "$cache/new/lib" ] || mv "$cache/new/usr/lib" "$cache/new/lib"
  release=$(basename "$cache"/new/lib/modules/*)
  depmod -b "$cache/new" "$release"
  unpack_vmlinux "$cache/new/boot/vmlinuz-$release" "$cache/new/vmlinux" ||
    cp "$cache/new/boot/vmlinuz-$release" "$cache/new/vmlinux"
  mv "$cache/new" "$kernel"
}

# take FILE PLACE: with the libraries that it is linked with
take() {
  mkdir -p "$root$(dirname "$2")"
  cp -L "$1" "$root$2"
  ldd "$1" 2>/dev/null | grep -o '/[^ ]*' | while read -r library; do
    mkdir -p "$root$(dirname "$library")"
    [ -e "$root$library" ] || cp -L "$library" "$root$library"
  done
}

pack() { (cd "$1" && find . -print0 | cpio --null -o -H newc --quiet) >"$2"; }

# boot ACCELERATOR SECONDS INITRD: the guest writes its exit code c to a port; qemu exits with 2c+1. no_timer_check: on a
# busy host the kernel counts too few ticks of an emulated timer, and gives up.
boot() {
  qemu=0
  cpu=max
  [ "$1" = kvm ] || cpu=qemu64 # emulated wide registers cost more than they save
  # shellcheck disable=SC2086  # disk's and network's options are separate words
  timeout "$2" qemu-system-x86_64 -accel "$1" -cpu "$cpu" -M q35 -m "${GUEST_MEMORY_MB:-512}" \
    -smp "${GUEST_CPUS:-1}" $disk $net -nodefaults -no-user-config -display none -serial stdio $serial -no-reboot \
    -device isa-debug-exit,iobase=0xf4,iosize=0x04 -kernel "$kernel/vmlinux" -initrd "$3" \
    -append "console=ttyS0 quiet panic=-1 no_timer_check systemd.mask=serial-getty@ttyS0.service" </dev/null || qemu=$?
  case $qemu in 124 | 137) return "$qemu" ;; esac
  [ $((qemu % 2)) = 1 ] || return 125
  return $((qemu / 2))
}

# The host may offer KVM and yet not boot with it; once a start of the host it is tried.
choose_accelerator() {
  known=$cache/accelerator-$(cat /proc/sys/kernel/random/boot_id)
  if [ ! -e "$known" ]; then
    rm -f "$cache"/accelerator-*
    echo tcg >"$work/accelerator"
    if [ -r /dev/kvm ] && [ -w /dev/kvm ]; then
      mkdir -p "$work/try/bin" "$work/try/dev"
      cp "$(command -v busybox)" "$work/try/bin/busybox"
      {
        echo '#!/bin/busybox sh'
        echo '/bin/busybox mount -t devtmpfs dev /dev'
        echo 'echo -n "*" | /bin/busybox dd of=/dev/port bs=1 seek=244 count=1 2>/dev/null'  # 42
      } >"$work/try/init"
      chmod +x "$work/try/init"
      pack "$work/try" "$work/try.cpio"
      tried=0
      boot kvm 10 "$work/try.cpio" >/dev/null 2>&1 || tried=$?
      [ "$tried" != 42 ] || echo kvm >"$work/accelerator"
    fi
    cp "$work/accelerator" "$known"
  fi
  cat "$known"
}

disk=
net=
serial=
(
  flock 9
  fetch_kernel
  choose_accelerator >"$work/chosen"
  echo "$kernel" >"$work/kernel"
) 9>"$cache/lock"
kernel=$(cat "$work/kernel")
accelerator=$(cat "$work/chosen")

root=$work/root
mkdir -p "$root/bin" "$root/dev" "$root/proc" "$root/sys" "$root/tmp" "$root/run" "$root/modules"
cp "$(command -v busybox)" "$root/bin/busybox"
cp "$script" "$root/script"
for program in "$@"; do
  place=${program#*:}
  program=${program%%:*}
  if [ -n "${GUEST_DISK:-}" ]; then
    mkdir -p "$root/take"
    cp "$program" "$root/take"
    continue
  fi
  [ "$place" != "$program" ] || place=/usr/bin/$(basename "$program")
  take "$program" "$place"
done
if [ -n "${GUEST_DISK:-}" ]; then
  disk="-drive file=$GUEST_DISK,if=virtio,format=raw,snapshot=on"
  [ -z "${GUEST_DISK_STAYS:-}" ] || disk="-drive file=$GUEST_DISK,if=virtio,format=raw"
  if [ -n "${GUEST_WRITES:-}" ]; then
    : >"$GUEST_WRITES"
    disk="-blockdev driver=blklogwrites,node-name=disk,file.driver=file,file.filename=$GUEST_DISK,log.driver=file"
    disk="$disk,log.filename=$GUEST_WRITES -device virtio-blk-pci,drive=disk"
  fi
  modules="$modules virtio_pci virtio_blk ext4"
  mkdir -p "$root/disk" "$root/take"
  cat >"$root/take/guest-script.service" <<'UNIT'
[Unit]
Description=The test in this guest
After=basic.target dbus.service
[Service]
Type=oneshot
ExecStart=/bin/sh /root/run-script
StandardOutput=tty
StandardError=tty
TTYPath=/dev/ttyS0
UNIT
  cat >"$root/take/run-script" <<'RUN'
cd /root
export HOME=/root
code=0
sh /root/script || code=$?
echo "run_guest: exit $code after $(cut -d ' ' -f 1 /proc/uptime) s, Linux $(uname -r)"
printf "\\$(printf %03o "$code")" | dd of=/dev/port bs=1 seek=244 count=1 2>/dev/null
RUN
fi
if [ -n "${GUEST_NET:-}" ]; then
  net="-netdev user,id=net -device virtio-net-pci,netdev=net,romfile="
  modules="$modules virtio_pci virtio_net"
fi
[ -z "${GUEST_SERIAL:-}" ] || serial="-serial $GUEST_SERIAL"
[ -z "${GUEST_PID:-}" ] || net="$net -pidfile $GUEST_PID"
release=$(basename "$kernel"/lib/modules/*)
: >"$root/modules/order"
for module in $modules; do
  modprobe -d "$kernel" -S "$release" --show-depends "$module" |
    awk '$1 == "insmod" { print $2 }' | while read -r file; do
    name=$(basename "$file")
    [ ! -e "$root/modules/$name" ] || continue
    cp "$file" "$root/modules/$name"
    echo "$name" >>"$root/modules/order"
  done
done
cat >"$root/init" <<'INIT'
#!/bin/busybox sh
/bin/busybox mkdir -p /bin /sbin /usr/bin
/bin/busybox --install -s /bin
export PATH=/usr/bin:/bin HOME=/tmp
mount -t proc proc /proc
mount -t sysfs sys /sys
mount -t devtmpfs dev /dev
mount -t tmpfs tmp /tmp
code=0
while read -r module; do
  # Of what ext4 may use some is for other processors; whether the disk can be had, it will show.
  insmod "/modules/$module" 2>/tmp/insmod || [ -e /disk ] || { cat /tmp/insmod; code=126; }
done </modules/order
if [ "$code" = 0 ] && [ -e /disk ]; then
  tries=0
  until [ -b /dev/vda ] || [ "$tries" = 50 ]; do usleep 100000; tries=$((tries + 1)); done
  mount -t ext4 /dev/vda /disk || code=126
fi
if [ -e /sys/class/net/eth0 ]; then
  ip addr add 10.0.2.15/24 dev eth0
  ip link set eth0 up
  ip route add default via 10.0.2.2
fi
if [ "$code" = 0 ] && [ -e /disk ]; then
  cp /take/* /script /disk/root
  mkdir -p /disk/etc/systemd/system/multi-user.target.wants
  mv /disk/root/guest-script.service /disk/etc/systemd/system
  # What an appliance has no use for costs a guest in software half of its boot.
  for unit in apt-daily.timer apt-daily-upgrade.timer dpkg-db-backup.timer e2scrub_all.timer e2scrub_reap.service \
    fstrim.timer getty.target systemd-logind.service systemd-user-sessions.service systemd-update-utmp.service \
    systemd-update-utmp-runlevel.service systemd-pstore.service proc-sys-fs-binfmt_misc.automount dev-hugepages.mount \
    dev-mqueue.mount sys-fs-fuse-connections.mount sys-kernel-debug.mount sys-kernel-tracing.mount; do
    ln -sf /dev/null "/disk/etc/systemd/system/$unit"
  done
  ln -sf ../guest-script.service /disk/etc/systemd/system/multi-user.target.wants
  mount --move /dev /disk/dev
  umount /proc /sys /tmp
  exec switch_root /disk /lib/systemd/systemd
fi
if [ "$code" = 0 ]; then sh /script || code=$?; fi
echo "run_guest: exit $code after $(cut -d ' ' -f 1 /proc/uptime) s, Linux $(uname -r)"
printf "\\x$(printf %02x "$code")" | dd of=/dev/port bs=1 seek=244 count=1 2>/dev/null
poweroff -f
INIT
chmod +x "$root/init"
pack "$root" "$work/initrd"
code=0
boot "$accelerator" "${GUEST_SECONDS:-120}" "$work/initrd" || code=$?
say "$accelerator guest: $code"
exit "$code"
