# shellcheck shell=sh disable=SC2034,SC2154
# How a script here tells what it does, and what went wrong. A failure's last lines are what one sees of it: they say in
# which step it was, and what was awaited; before them stand the last lines of the log, and what the daemon says.
# Sourced, with work set, and log where there is one in it (a file's name). Whoever sources it calls tell_end first in
# what it traps at its end.
began_s=$(date +%s)
now_step='its begin'
failure=''
step() { # step WHAT...: what is tried now
  now_step=$*
  echo "== [$(($(date +%s) - began_s)) s] $*"
}
fail() {
  failure=$*
  echo "$(basename "$0"): $*" >&2 # what `$(...)` runs has a shell of its own, which tells nobody at its end
  exit 1
}
tell_more() { :; } # what else there is to tell of a failure
tell_end() { # tell_end CODE: of the script, before anything is cleaned up, in which no signal comes any more
  trap '' HUP INT TERM
  case $1 in 0 | 77) return 0 ;; esac
  [ -n "$failure" ] || failure="a command of it ended with $1; what it said stands above"
  if [ -n "${log:-}" ]; then
    echo "-- the last lines of $log:"
    tail -n 15 "$work/$log" | tr -d '\r' | cut -c 1-240
  fi
  tell_more
  echo "-- $(basename "$0") FAILED after $(($(date +%s) - began_s)) s, in step: $now_step"
  echo "-- $failure"
}
trap 'exit 129' HUP
trap 'exit 130' INT
trap 'exit 143' TERM
