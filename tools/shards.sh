#!/bin/sh
# tools/shards.sh DATA SHARDS VENV: print the numbers of a dataset's shards, 0 1 2 …: of as many as SHARDS asks for, else as the dataset
# has; nothing where neither says. The Makefile asks before anything is installed: only object storage needs VENV.
set -eu
data=$1 shards=$2 venv=$3 limit='a whole number, 1 to 9999'
case $data in '~' | '~/'*) data=${HOME-}${data#'~'} ;; esac  # vt-pipeline does the same; not every shell has done it before

fail() {
    printf '%s\n' "$1" >&2
    exit 1
}

in_range() {
    case $1 in '' | *[!0-9]* | 0* | ?????*) return 1 ;; esac
}

if [ -n "$shards" ]; then
    in_range "$shards" || fail "SHARDS is $shards; it must be $limit"
elif case $data in *://*) ;; *) false ;; esac then
    [ -e "$venv/installed" ] || fail "DATA is in object storage, and nothing is installed yet that could look there: run \`make setup\` first"
    shards=$("$venv/bin/python" -c 'import sys; from pipeline.store.directory import DataDirectory; print(DataDirectory(sys.argv[1]).shards() or "")' "$data") ||
        fail "$data cannot be reached; see the message above"
elif [ -e "$data/dataset.json" ]; then
    if [ -f "$data/dataset.json" ]; then
        shards=$(head -c 1000 <"$data/dataset.json" | tr -d '\000 \t\r\n')
        shards=${shards#'{"shards":'} shards=${shards%'}'}
    fi
    in_range "$shards" || fail "$data/dataset.json is damaged: it must be {\"shards\": N}, N $limit, as the records of its shards are named"
else  # it was lost: the names of the records tell
    for record in "$data"/*/[0-9][0-9][0-9][0-9]-of-[0-9][0-9][0-9][0-9].json; do
        number=${record##*-of-} number=${number%.json}
        number=${number#"${number%%[!0]*}"}
        if [ -e "$record" ] && [ "$number" != "$shards" ]; then
            [ -z "$shards" ] || fail "$data/dataset.json is missing; write {\"shards\": N} into it, N as the records are named: $shards, $number"
            shards=$number
        fi
    done
    [ -z "$shards" ] || in_range "$shards" || fail "$data has a record of $shards shards; it must be $limit"
fi
[ -z "$shards" ] || seq -s ' ' 0 $((shards - 1))
