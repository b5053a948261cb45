#!/bin/sh
# Follows guides word by word: installs a build into a folder of its own, runs each guide's steps there in
# order, and compares what they print with what the guide shows. README.md here has the conventions.
# usage: run_guides.sh BUILD GUIDE...
set -eu
build=$(realpath "$1")
shift
here=$(dirname -- "$(realpath "$0")")
work=$(mktemp -d)

# Ends what a guide has left running.
end_all() {
  if [ -s "$1/run/bendloopd.pid" ]; then kill -KILL "$(cat "$1/run/bendloopd.pid")" 2>/dev/null || :; fi
  if [ -s "$1/run/group" ]; then kill -s KILL -- "-$(cat "$1/run/group")" 2>/dev/null || :; fi
}
# shellcheck disable=SC2317  # called by the trap
cleanup() {
  for root in "$work"/*/root; do end_all "$root"; done
  rm -rf "$work"
}
trap cleanup EXIT

# A port of this machine that is free.
free_port() { "$build/bin/bendloop-simscanner" --port 0 </dev/null | sed -n 's/^listening //p'; }

# Places and ports of the guide to those of the test, and back.
to_test() {
  sed -E "s#(^|[[:blank:]=\"'<>(])/(etc|var|usr)/#\1$root/\2/#g; s/\b7420\b/$scanner_port/g; s/\b1502\b/$bender_port/g
    s/\b7480\b/$status_port/g"
}
to_guide() { sed "s#$root/#/#g; s#$folder/home/#~/#g"; }

# options_known FILE: steps that are not run name at least no option that bendloop has not.
options_known() {
  sh -n "$1" || return 1
  grep -o 'bendloopd\? [^|;&#]*' "$1" | while read -r program words; do
    case $program in
      bendloop) help=$("$build/bin/bendloop" "${words%% *}" --help) || exit 1 ;;
      *) help=$("$build/bin/$program" --help) || continue ;;
    esac
    for word in $words; do
      case $word in
        --*) case $help in *"$word"*) ;; *) echo "$program has no $word" && exit 1 ;; esac ;;
      esac
    done
  done
}

# shown EXPECTED PRINTED
shown() {
  "$here/mask.sh" <"$1" >"$folder/expected.masked"
  to_guide <"$2" | "$here/mask.sh" >"$folder/printed.masked"
  awk -f "$here/compare.awk" "$folder/expected.masked" "$folder/printed.masked"
}

# guide FILE: its name is the folder's
guide() {
  folder=$work/$(basename "$1" .md)
  root=$folder/root
  mkdir -p "$folder/home" "$root/run" "$root/etc/systemd/system" "$root/var/lib"
  # The unit is made on the way, in the build's folder: one at a time.
  DESTDIR=$root flock "$build" cmake --install "$build" --prefix /usr >"$folder/install.log" || { cat "$folder/install.log"; return 1; }
  find "$root/etc" "$root/usr" -type f | sed "s#^$root##" >"$root/run/installed"
  scanner_port=$(free_port)
  bender_port=$(free_port)
  status_port=$(free_port)
  awk -v out="$folder" -f "$here/extract.awk" "$1" || return 1
  for file in "$folder"/hands-*.sh; do
    [ -e "$file" ] || continue
    options_known "$file" || { echo "$1: line $(basename "$file" .sh): not understood" >&2; return 1; }
  done

  {
    echo "set -eu"
    echo "echo \$\$ >'$root/run/group'"
    echo ". '$here/hands.sh'"
    # What comes after is the output of step N, which begins at this line of the guide.
    echo "step() { exec >>'$folder/'\$1.printed 2>&1; echo \"\$1 \$2\" >'$folder/at'; }"
    echo "step 0 0"
    to_test <"$folder/steps.sh"
  } >"$folder/script.sh"
  if ! (cd "$folder/home" && exec env -i HOME="$folder/home" USER="$(id -un)" LANG=C.UTF-8 TERM=dumb COLUMNS=100 \
    PATH="$here/standins:$root/usr/bin:$PATH" GUIDE_ROOT="$root" GUIDE_SCANNER_PORT="$scanner_port" \
    GUIDE_BENDER_PORT="$bender_port" GUIDE_STATUS_PORT="$status_port" timeout --foreground 150 setsid --wait sh "$folder/script.sh" </dev/null); then
    read -r step line <"$folder/at"
    echo "$1:$line: the step failed; its last words:" >&2
    tail -n 20 "$folder/$step.printed" | to_guide >&2
    return 1
  fi
  code=0
  for file in "$folder"/*.expected; do
    [ -e "$file" ] || continue
    step=$(basename "$file" .expected)
    line=$(sed -n "s/^step $step //p" "$folder/steps.sh")
    missing=$(shown "$file" "$folder/$step.printed") || {
      echo "$1:$line: what the step prints does not agree with what the guide shows, first at (numbers masked):" >&2
      echo "    $missing" >&2
      echo "  it printed:" >&2
      to_guide <"$folder/$step.printed" | sed 's/^/    /' >&2
      code=1
    }
  done
  for file in "$folder"/*.picture; do
    [ -e "$file" ] || continue
    step=$(basename "$file" .picture)
    picture=$(dirname "$1")/$(cat "$file")
    { echo ...; sed -n 's/<style>.*//; s/<[^>]*>//g; /^\$ /d; s/&lt;/</g; s/&gt;/>/g; s/&amp;/\&/g; p' "$picture"; echo ...; } >"$folder/picture.text"
    missing=$(shown "$folder/picture.text" "$folder/$step.printed") || {
      echo "$1: its picture $picture shows what is printed no more: $missing; make it anew (tests/manuals/README.md)" >&2
      code=1
    }
  done
  alarms=$(grep -o 'BL[0-9]\{4\}' "$1" | sort -u)
  for alarm in $alarms; do
    grep -q "^| $alarm |" "$here/../../firmware-host/alarms/README.md" || { echo "$1: there is no alarm $alarm" >&2; code=1; }
  done
  for check in "$here/check_$(basename "$1" .md | tr '[:upper:]' '[:lower:]')"*.sh; do
    [ -e "$check" ] || continue
    "$check" "$1" "$root" || code=1
  done
  end_all "$root"
  return "$code"
}

failed=0
for page in "$@"; do
  if guide "$page"; then echo "$page: each step did what it says"; else failed=1; fi
done
exit "$failed"
