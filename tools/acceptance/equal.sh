#!/usr/bin/env bash
# What may and what may not change the light: equal.sh MODEL.obj [QUALITY] [bytes|near].
#
# bytes: byte-equal exports of stages by hand, tasks in shuffled order, any number of workers, link cache, memory
# and schedule. near: equal within tolerance: other groupings and orders. One line per case; exit code 1
# if one fails. CLERESTORY names the program.
set -uo pipefail
here=$(cd "$(dirname "$0")" && pwd)
model=$(realpath "$1") quality=${2:-draft} part=${3:-all}
declare -A tolerances=([preview]=0.1 [draft]=0.05 [standard]=0.02 [final]=0.01)
tolerance=${tolerances[$quality]}
export CLERESTORY=${CLERESTORY:-clerestory}
work=$(mktemp -d) failed=0
trap 'rm -rf "$work"' EXIT
cd "$work"

solve() { # solve NAME FLAG...: `run` into NAME.clr
    local name=$1
    shift
    "$CLERESTORY" run "$model" --store "$name.clr" --quality "$quality" -q "$@" || echo "exit $? of run $*"
}

by_hand() { # the tour, two solve-groups at a time
    echo x,y,z,nx,ny,nz >none.csv
    "$here/../tour.sh" "$model" "$1.clr" none.csv --quality "$quality" >/dev/null
}

shuffled() { # one solve-group per group, in an order that changes each iteration
    local store=$1.clr groups
    "$CLERESTORY" ingest "$store" "$model" -q && "$CLERESTORY" visibility "$store" -q
    "$CLERESTORY" partition "$store" -q
    groups=$("$CLERESTORY" status "$store" --json | grep -o '"groups_total": *[0-9]*' | grep -o '[0-9]*$')
    for iteration in $(seq 200); do
        for group in $(seq 0 $((groups - 1)) | shuf --random-source=<(yes "$iteration")); do
            "$CLERESTORY" solve-group "$store" --group "$group" --quality "$quality" -q || return 1
        done
        if "$CLERESTORY" merge "$store" --json | grep -Eq '"converged": *true'; then break; fi
    done
}

export_all() {
    for format in csv glb ply; do
        "$CLERESTORY" export "$1.clr" -o "$1.$format" --force -q || echo "exit $? of export $1.$format"
    done
}

verdict() { # verdict WORDS: passes where the last command did
    if [ $? -eq 0 ]; then echo "pass  $*"; else echo "FAIL  $*"; failed=1; fi
}

same_bytes() { # same_bytes NAME HOW ARGUMENT...
    local name=$1
    "$2" "$name" "${@:3}"
    export_all "$name"
    cmp reference.csv "$name.csv" && cmp reference.glb "$name.glb" && cmp reference.ply "$name.ply"
    verdict "$name: same bytes"
    rm -rf "$name".*
}

near() { # near NAME FLAG...
    local name=$1 said
    solve "$@"
    "$CLERESTORY" sample "$name.clr" --points reference.csv -o "$name.points.csv" -q
    said=$("$here/nrms.py" reference.csv reference.points.csv "$name.points.csv" "$tolerance")
    verdict "$name: $said, limit $tolerance"
    rm -rf "$name".*
}

solve reference --workers 2
export_all reference
if [ "$part" != near ]; then
    groups=$("$CLERESTORY" partition reference.clr --json | grep -o '"groups": *[0-9]*' | grep -o '[0-9]*$')
    same_bytes by_hand by_hand
    same_bytes shuffled_tasks shuffled
    same_bytes one_worker solve --workers 1
    same_bytes four_workers solve --workers 4
    same_bytes link_cache_33M solve --link-cache 33M
    same_bytes link_cache_16K solve --link-cache 16K
    same_bytes memory_128M solve --memory 128M --groups "$groups"
    for schedule in ffd ws ffd-ws; do same_bytes "schedule_$schedule" solve --schedule "$schedule" --delta 2; done
fi
if [ "$part" != bytes ]; then
    "$CLERESTORY" sample reference.clr --points reference.csv -o reference.points.csv -q
    for groups in 1 4 16; do near "groups_$groups" --groups "$groups"; done
    for method in split region random; do near "partition_$method" --partition "$method"; done
    for order in replace sequential; do near "order_$order" --order "$order"; done
fi
exit $failed
