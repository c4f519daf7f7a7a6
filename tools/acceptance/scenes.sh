#!/usr/bin/env bash
# Ingest, check, visibility and all partitions of models at default settings, each process watched from outside
# and held below --memory by `ulimit -d`: scenes.sh [--ingest-only] MODEL.obj...
#
# A table of patches, clusters, wall time and anonymous memory; exit code 1 if a stage fails or is too large.
set -uo pipefail
here=$(cd "$(dirname "$0")" && pwd) clerestory=${CLERESTORY:-clerestory} failed=0 more=1
limit=${LIMIT:-512M}
if [ "${1:-}" = --ingest-only ]; then
    more=0
    shift
fi
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

stage() { # stage WORDS ARGUMENT...: runs a verb, prints its figures
    local words=$1 code
    shift
    "$here/../watch_memory.py" --limit "$limit" --enforce "$limit" \
        "$clerestory" "$@" --memory "$limit" --json --progress none >"$work/summary" 2>"$work/said"
    code=$?
    [ $code -eq 0 ] || failed=1
    python3 - "$words" "$code" "$work/summary" "$work/said" <<'PYTHON'
import json, sys
words, code, summary, said = sys.argv[1:]
watched = json.loads(open(said).read().splitlines()[-1])
text = open(summary).read()
document = json.loads(text) if text else {}
keys = ("input_polygons patches clusters emitters skipped damages pairs rays missing_form_factor_mean "
        "missing_form_factor_max groups intra_group_share predicted_contraction").split()
figures = " ".join(
    f"{k} {document[k]:.4g}" if isinstance(document[k], float) else f"{k} {document[k]}" for k in keys if k in document
)
print(f"{'pass' if code == '0' else 'FAIL'}  {words}: {watched['wall_s']} s, {watched['peak_anon_mib']} MiB, {figures}", flush=True)
PYTHON
}

for model in "$@"; do
    name=$(basename "$model" .obj)
    stage "$name ingest" ingest "$work/$name.clr" "$model"
    stage "$name check" check "$work/$name.clr"
    if [ $more -eq 1 ]; then
        stage "$name visibility" visibility "$work/$name.clr"
        for method in merge split region random; do
            stage "$name partition $method" partition "$work/$name.clr" --method $method
        done
    fi
    rm -rf "$work/$name.clr"
done
exit $failed
