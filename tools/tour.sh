#!/usr/bin/env bash
# The stages as separate commands, then numbers and a picture: tour.sh MODEL.obj STORE POINTS.csv [flags of solve-group].
set -euo pipefail
clerestory=${CLERESTORY:-clerestory}
model=$1 store=$2 points=$3
shift 3

"$clerestory" ingest "$store" "$model"
"$clerestory" visibility "$store"
"$clerestory" partition "$store"
# merge ends with 3, and so does this, where the light no longer changes and is wrong.
while "$clerestory" merge "$store" --json -q | grep -Eq '"converged": *false'; do
    "$clerestory" solve-group "$store" --until-done -q "$@" &
    "$clerestory" solve-group "$store" --until-done -q "$@"
    wait
done
"$clerestory" status "$store"
"$clerestory" sample "$store" --points "$points" -o -
"$clerestory" render "$store" -o "${store%.clr}.png" --force
