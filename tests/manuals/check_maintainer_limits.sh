#!/bin/sh
# Each limit of the maintainer's guide, as the source has it?
# usage: check_maintainer_limits.sh GUIDE ROOT
set -eu
top=$(dirname -- "$(realpath "$0")")/../..
# shellcheck disable=SC2016  # backquotes, and no command
# Of the rows `| what | 64 KB | `file`: `name` unit |`: file, name, the number and its unit, and the name's unit.
rows=$(sed -n 's/^|.*| \([0-9][0-9]*\) *\([A-Za-z]*\) | `\([^`]*\)`: `\([^`]*\)` *\([A-Za-z]*\) |$/\3 \4 \1 \2 \5/p' "$1")
[ "$(echo "$rows" | wc -l)" -ge 30 ] || { echo "$1: its table of limits was not found" >&2; exit 1; }

# In bytes, if it counts bytes.
bytes() {
  case $2 in
    KB) echo "$(($1 << 10))" ;;
    MB) echo "$(($1 << 20))" ;;
    GB) echo "$(($1 << 30))" ;;
    *) echo "$1" ;;
  esac
}

failed=0
while read -r file name number unit its_unit; do
  # `name = 1u << 20;`, `name{60};`, `name = std::size_t{1} << 30;`, `name = 5000ms;`, `Name=10`
  value=$(sed -nE "s/^(.*[ :])?$name *(=|\{) *(.*)\$/\3/p" "$top/$file" | head -n 1 |
    sed -E "s/[;}]+ *(\/\/.*)?\$//; s/'//g; s/[a-z_:]+\{([0-9]+)\}/\1/g; s/([0-9])[a-zA-Z]+/\1/g")
  if [ -z "$value" ]; then
    echo "$1: $file has no $name" >&2
    failed=1
    continue
  fi
  # shellcheck disable=SC2004  # an expression, not a number
  value=$(($value))
  if [ "$(bytes "$value" "$its_unit")" != "$(bytes "$number" "$unit")" ]; then
    echo "$1: $file has $name = $value, the guide says $number $unit" >&2
    failed=1
  fi
done <<END
$rows
END
exit "$failed"
