#!/usr/bin/env bash
# Broken and odd models: pathological.sh FOLDER. Every *.obj below it must ingest, or end with exit 1 and an
# error that names the file; no panic, no hang, no half store. One line per file; exit code 1 if one fails.
set -uo pipefail
clerestory=${CLERESTORY:-clerestory} folder=$1 failed=0
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
while IFS= read -r model; do
    timeout 60 "$clerestory" ingest "$work/s.clr" "$model" >"$work/out" 2>"$work/err"
    code=$? name=${model#"$folder"/} said=$(grep -m1 '^error: ' "$work/err")
    case $code in
    0) "$clerestory" check "$work/s.clr" -q && echo "pass  $name" || { echo "FAIL  $name: check"; failed=1; } ;;
    1)
        if [[ $said == *"$(basename "$model")"* ]] && grep -q '^help: ' "$work/err" && [ ! -e "$work/s.clr" ]; then
            echo "pass  $name: $said"
        else
            echo "FAIL  $name: exit 1: $said"
            failed=1
        fi
        ;;
    *)
        echo "FAIL  $name: exit $code: $(tail -1 "$work/err")"
        failed=1
        ;;
    esac
    rm -rf "$work/s.clr"
done < <(find "$folder" -name '*.obj' | sort)
exit $failed
