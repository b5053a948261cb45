#!/bin/sh
# Makes the pictures of the guides anew, from what the programs really print:
#   firmware-host/cli/rehearsal.svg            the terminal of `bendloop demo`, the first tube
#   firmware-host/cli/rehearsal-report.png     the report of the same, as far as the rows
# usage: pictures.sh BUILD     needs script (bsdutils), and for the report Debian's chromium and pngquant
set -eu
build=$(realpath "$1")
here=$(dirname -- "$(realpath "$0")")
top=$here/../..
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"

# The part file stands in the guide.
awk -v out="$work" -f "$here/extract.awk" "$top/firmware-host/cli/SETTER.md"
sed -n '/^schema = "bendloop.part/,/^END$/p' steps.sh | sed '/^END$/,$d' >elbow.toml
stty_columns='stty cols 100'
TERM=xterm script -qec "$stty_columns; '$build/bin/bendloop' demo --part elbow.toml --parts 2 --quick --out rehearsal" /dev/null |
  tr -d '\r' >printed
command='bendloop demo --part /etc/bendloop/parts/elbow.toml --parts 2 --quick --out rehearsal'
# Of the first tube; what counts up while it is scanned is drawn over and over, and left out.
sed -n '/^part .*committed/,/least sure/p; /least sure/q' printed |
  "$here/terminal_svg.sh" "$command" >"$top/firmware-host/cli/rehearsal.svg"

# Of this height head, tube and rows of the guide's part.
chromium --headless=new --no-sandbox --use-gl=angle --use-angle=swiftshader --enable-unsafe-swiftshader \
  --hide-scrollbars --virtual-time-budget=6000 --user-data-dir="$work/chromium" --window-size=1200,1630 \
  --screenshot="$work/report.png" "file://$work/rehearsal/report.html#part-1" 2>/dev/null
pngquant --strip --speed 1 64 --output "$work/small.png" "$work/report.png"
cp "$work/small.png" "$top/firmware-host/cli/rehearsal-report.png"
