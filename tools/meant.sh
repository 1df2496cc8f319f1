#!/bin/sh
# tools/meant.sh NAME KNOWN…: print the known name that NAME was probably meant to be, in whatever case: few letters of it have to change
name=$1
shift
printf '%s\n' "$@" | NAME=$name awk '
function least(a, b) { return a < b ? a : b }
function distance(a, b,    i, j, row, corner, above) { # letters to insert, remove and replace
    for (j = 0; j <= length(b); j++) row[j] = j
    for (i = 1; i <= length(a); i++) {
        corner = row[0]
        row[0] = i
        for (j = 1; j <= length(b); j++) {
            above = row[j]
            row[j] = least(corner + (substr(a, i, 1) != substr(b, j, 1)), least(above, row[j - 1]) + 1)
            corner = above
        }
    }
    return row[length(b)]
}
BEGIN { name = toupper(substr(ENVIRON["NAME"], 1, 50)); best = 1 + length(name) / 3 }
{ far = distance(name, $0); if (far < best) { best = far; found = $0 } }
END { if (found) print found }'
