#!/bin/sh
# Fails if a program does not load each of the libraries.
# usage: needs.sh PROGRAM LIBRARY...
set -eu
program=$1
shift
needed=$(readelf -dW "$program" | sed -n 's/.*(NEEDED).*\[\(.*\)\]/\1/p')
failed=0
for library in "$@"; do
  if ! printf '%s\n' "$needed" | grep -q "^${library}[-.]"; then
    echo "$program does not load $library; it loads: $(echo "$needed" | tr '\n' ' ')" >&2
    failed=1
  fi
done
exit "$failed"
