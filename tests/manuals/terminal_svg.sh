#!/bin/sh
# A terminal's text with its colours as an SVG picture, dark or light as the reader's page is.
# usage: terminal_svg.sh TITLE <TEXT >PICTURE.svg     TEXT may have the colours that our programs write
set -eu
exec awk -v title="$1" '
function escaped(text) { gsub(/&/, "\\&amp;", text); gsub(/</, "\\&lt;", text); gsub(/>/, "\\&gt;", text); return text }
# The code of a colour, as of firmware-host/text/style.cc, to a class.
function class_of(code) {
  if (code == "1") return "strong"
  if (code == "2") return "faint"
  if (code == "32") return "good"
  if (code == "1;31") return "bad"
  if (code == "33") return "warning"
  return ""
}
{
  gsub(/\r/, "")
  text = ""; plain = ""; rest = $0; class = ""
  while (match(rest, /\033\[[0-9;]*m/)) {
    piece = substr(rest, 1, RSTART - 1)
    if (piece != "") text = text (class == "" ? escaped(piece) : "<tspan class=\"" class "\">" escaped(piece) "</tspan>")
    plain = plain piece
    class = class_of(substr(rest, RSTART + 2, RLENGTH - 3))
    rest = substr(rest, RSTART + RLENGTH)
  }
  text = text (class == "" ? escaped(rest) : "<tspan class=\"" class "\">" escaped(rest) "</tspan>")
  plain = plain rest
  lines[NR] = text
  if (length(plain) > widest) widest = length(plain)
}
END {
  if (length(title) + 2 > widest) widest = length(title) + 2
  width = int(widest * 7.83) + 40; height = NR * 17 + 62
  printf "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"%d\" height=\"%d\" viewBox=\"0 0 %d %d\">\n", width, height, width, height
  print "<style>.frame { fill: #f6f8fa; stroke: #d0d7de } text { font: 13px ui-monospace, \"DejaVu Sans Mono\", Menlo, Consolas, monospace; fill: #1f2328; white-space: pre } .title, .faint { fill: #656d76 } .strong { font-weight: bold } .good { fill: #1a7f37 } .bad { fill: #cf222e; font-weight: bold } .warning { fill: #9a6700 } @media (prefers-color-scheme: dark) { .frame { fill: #0d1117; stroke: #30363d } text { fill: #e6edf3 } .title, .faint { fill: #8d96a0 } .good { fill: #3fb950 } .bad { fill: #ff7b72 } .warning { fill: #d29922 } }</style>"
  printf "<rect class=\"frame\" x=\"0.5\" y=\"0.5\" width=\"%d\" height=\"%d\" rx=\"8\"/>\n", width - 1, height - 1
  printf "<text class=\"title\" x=\"20\" y=\"26\" xml:space=\"preserve\">$ %s</text>\n", escaped(title)
  for (i = 1; i <= NR; ++i) if (lines[i] != "") printf "<text x=\"20\" y=\"%d\" xml:space=\"preserve\">%s</text>\n", 34 + 17 * i, lines[i]
  print "</svg>"
}'
