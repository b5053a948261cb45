#!/bin/sh
# The limits that files set: is each range of config/README.md, to which the maintainer's guide sends, the
# loader's?
# usage: check_maintainer_ranges.sh GUIDE ROOT
set -eu
config=$(dirname -- "$(realpath "$0")")/../../config
# `v.Number("key", ..., {A, B})` and `v.Integer("key", ..., A, B)`: key, A, B. A slot's length and width stand in
# a sentence; a row's angle may be 0 in the last row only, and else begins at 0.1.
ranges=$(cat "$config/cell_fields.cc" "$config/part_fields.cc" | grep -v ' slot\.\| row\.angle_deg' |
  sed -nE 's/^.*(Number|Integer|Milliseconds)\((v, )?"([a-z0-9_]+)", [^,]+, \{?(-?[0-9.]+), ([0-9a-fx.]+)[,})].*/\3 \4 \5/p')
[ "$(echo "$ranges" | wc -l)" -ge 65 ] || { echo "check_maintainer_ranges.sh: finds the loader's ranges no more" >&2; exit 1; }
failed=0
while read -r key least most; do
  case $most in 0x*) most=$((most)) ;; esac
  grep -E "^\| .*\`$key\`.* \|" "$config/README.md" | grep -qE "\| $least to (below )?$most(,[^|]*)? \|" || {
    echo "config/README.md: no row \`$key\` has the loader's range $least to $most" >&2
    failed=1
  }
done <<END
$ranges
END
exit "$failed"
