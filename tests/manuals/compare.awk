# Does what was printed agree with what a guide shows? Both masked by mask.sh. A line `...` of the guide
# stands for any lines, `...` within a line for any text.
# usage: awk -f compare.awk EXPECTED PRINTED     prints the first line that is not there
FNR == NR { wanted[++wants] = $0; next }
{ found[++finds] = $0 }
# "..." in a line stands for anything.
function agree(want, line,    pieces, count, i, at) {
  count = split(want, pieces, /\.\.\./)
  if (count == 1) return want == line
  if (index(line, pieces[1]) != 1) return 0
  line = substr(line, length(pieces[1]) + 1)
  for (i = 2; i < count; ++i) {
    at = index(line, pieces[i])
    if (!at) return 0
    line = substr(line, at + length(pieces[i]))
  }
  return length(line) >= length(pieces[count]) && substr(line, length(line) - length(pieces[count]) + 1) == pieces[count]
}
# Do the wanted lines first to last stand from `at` on?
function stands(first, last, at,    i) {
  for (i = first; i <= last; ++i) if (!agree(wanted[i], found[at + i - first])) { missing = wanted[i]; return 0 }
  return 1
}
END {
  at = 1
  i = 1
  while (i <= wants) {
    floats = 0
    while (i <= wants && wanted[i] == "...") { floats = 1; ++i }
    if (i > wants) exit 0
    for (last = i; last < wants && wanted[last + 1] != "..."; ++last) { }
    count = last - i + 1
    if (!floats) ok = at + count - 1 <= finds && stands(i, last, at)
    else {
      ok = 0
      for (; at + count - 1 <= finds && !ok; ++at) ok = stands(i, last, at)
      if (ok) --at
    }
    if (!ok) { print missing == "" ? wanted[i] : missing; exit 1 }
    at += count
    i = last + 1
  }
  if (at <= finds) { print "(the guide shows no more, but there is:) " found[at]; exit 1 }
}
