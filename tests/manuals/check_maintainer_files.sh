#!/bin/sh
# Each file that is installed, or that a cell keeps, in the maintainer's guide; and each that the guide says is
# always there, there?
# usage: check_maintainer_files.sh GUIDE ROOT
set -eu
guide=$1
root=$2
# shellcheck disable=SC2016  # backquotes, and no command
sed -n 's/^| `\(\/[^`]*\)` | [^|]* | \([^|]*\) |.*/\1 \2/p' "$guide" >"$root/run/table"
[ "$(wc -l <"$root/run/table")" -ge 30 ] || { echo "$guide: its table of files was not found" >&2; exit 1; }
sort -u "$root/run/installed" "$root/run/files" >"$root/run/all"
failed=0
while read -r file; do
  known=
  while read -r pattern _; do
    # shellcheck disable=SC2254  # a pattern it is
    case $file in $pattern) known=yes; break ;; esac
  done <"$root/run/table"
  [ -n "$known" ] || { echo "$guide: its table does not have $file" >&2; failed=1; }
done <"$root/run/all"
while read -r pattern there; do
  case $there in always | "while it runs" | "after a part" | "after a request") ;; *) continue ;; esac
  found=
  while read -r file; do
    # shellcheck disable=SC2254
    case $file in $pattern) found=yes; break ;; esac
  done <"$root/run/all"
  [ -n "$found" ] || { echo "$guide: $pattern is said to be there ($there), and is not" >&2; failed=1; }
done <"$root/run/table"
exit "$failed"
