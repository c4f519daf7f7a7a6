#!/usr/bin/env bash
# The stages as separate commands: tour.sh MODEL.obj STORE [flags of solve-group].
set -euo pipefail
clerestory=${CLERESTORY:-clerestory}
model=$1 store=$2
shift 2

"$clerestory" ingest "$store" "$model"
"$clerestory" visibility "$store"
"$clerestory" partition "$store"
while :; do
    "$clerestory" solve-group "$store" --until-done "$@" &
    "$clerestory" solve-group "$store" --until-done "$@"
    wait
    if "$clerestory" merge "$store" --json | grep -Eq '"converged": *true'; then break; fi
done
"$clerestory" status "$store"
