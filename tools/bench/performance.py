#!/usr/bin/env python3
"""Runs the benches and the judged scenes one after another, and writes docs/performance.md whole.

Every figure is of the commit that is checked out; changes that are not committed are refused. What has been measured is
kept in a file of JSON lines, so that a broken-off series goes on where it was; the page holds all that this file knows
of the commit on this machine. Exit code 1 if a scene failed.
"""

import argparse
import datetime
import json
import os
import shutil
import subprocess
import sys
import tempfile

import judged
from judged import ROOT, number, percent, table

BENCHES = ["rays", "rows", "sweep", "ingest"]
PAGE = os.path.join("docs", "performance.md")

HEADS = (
    "scene|CPU|wall|memory|elements|links|estimated|audited|stored nRMS|bias|dark|dim|path tracer|ratio|sample nRMS|a point|converged"
).split("|")

TEXT = """\
# Performance

Written by `tools/bench/performance.py`: nothing in here is typed, and all of it is of one commit.

- Commit: {commit}
- Date: {dates}
- Machine: {machine}; load average before scenes began: {loads}

## Scenes

One after another: `bake.py SCENE --binary target/release/clerestory -- {options}`{others}.

{scenes}

CPU and wall: the run with its audit, and the exports to PLY and CSV. Memory: anonymous, of the largest process. Links:
entries of rows that are stored. Stored nRMS, bias and dark: the exported mesh at sensor points with path-traced
references, their noise removed; dark in means of what is lit. Dim: median relative error of places between 1 and 10 % of
the mean. Path tracer: CPU of another renderer for the same error at 100 points a m2 of lit area; ratio: that over ours.
Sample: `sample` at the same points, with its CPU a point, the program's start included.

## Benches

`cargo bench`, each on one core. Links and entries are what rays of rows found; a sweep gathers over all of them,
relaxing also fits lines to what arrives.

{benches}
"""


def scene_row(record):
    scene, result = record["scene"], record.get("result")
    if result is None:
        limit_s = record.get("stopped_after_s")
        end = "failed" if limit_s is None else f"stopped after {number(limit_s, ' s', 0)}"
        return [scene, end, *["-"] * (len(HEADS) - 2)]
    links, dark = result.get("links"), result.get("dark")
    audited = percent(result.get("audited_nrms"))
    if result.get("audited_se") is not None:
        audited += f" +- {percent(result['audited_se'])}"
    return [
        scene,
        number(result["cpu_s"], " s"),
        number(result["wall_s"], " s"),
        number(result.get("peak_anon_mb"), " MB"),
        number(result.get("elements"), digits=0),
        "-" if links is None else number(links / 1e6, " M"),
        percent(result.get("estimated_nrms")),
        audited,
        percent(result.get("nrms")),
        percent(result.get("bias"), "+"),
        "-" if dark is None else f"{dark:.1e}",
        percent(result.get("dim_p50")),
        number(result.get("peer_cpu_s"), " s"),
        number(result.get("ratio")),
        percent(result.get("sample_nrms")),
        number(result.get("sample_ms"), " ms", 2),
        {True: "yes", False: "no"}.get(result.get("converged"), "-"),
    ]


def figure(value, unit):
    if unit == "1":
        return f"{value:,.0f}" if value == int(value) else f"{value:.3g}"
    return f"{value / 1e6:,.1f} M {unit}" if value >= 1e6 else f"{value:,.0f} {unit}"


def page(records, commit):
    """The page, of records of one commit and machine."""
    order = list(judged.SCENES)
    place = lambda record: order.index(record["scene"]) if record["scene"] in order else len(order)
    scenes = sorted((r for r in records if "scene" in r), key=place)
    benches = sorted((r for r in records if "bench" in r), key=lambda r: BENCHES.index(r["bench"]))
    figures = [
        [r["bench"], f.get("scene", "-"), f["name"], figure(f["value"], f["unit"])]
        for r in benches
        for f in r["figures"]
    ]
    shared = " ".join(judged.SHARED)
    others = [f"; {r['scene']} with `{r['options']}`" for r in scenes if r["options"] != shared]
    span = lambda ascending: " to ".join(dict.fromkeys(str(value) for value in (ascending[:1] + ascending[-1:])))
    return TEXT.format(
        commit=commit[:12],
        dates=span(sorted(r["date"] for r in records)),
        machine=span(sorted({r["machine"] for r in records})),
        loads=span(sorted(r["load"] for r in scenes)),
        options=shared,
        others="".join(others),
        scenes=table(HEADS, [scene_row(r) for r in scenes]),
        benches=table(["bench", "scene", "figure", "value"], figures),
    )


def newest(records):
    """The last record of each scene and bench."""
    return list({(r.get("scene"), r.get("bench")): r for r in records}.values())


def known(path, commit, on):
    return newest(r for r in judged.kept(path) if r["commit"] == commit and r["machine"] == on)


def is_done(records, scene, limit):
    of = [r for r in records if r.get("scene") == scene]
    return any("result" in r or r["stopped_after_s"] >= limit for r in of)


def refuse_changes():
    changed = judged.output("git", "status", "--porcelain", "--untracked-files=no", "--", ".", f":(exclude){PAGE}")
    if changed:
        sys.exit(f"not committed, so that figures would be of no commit:\n{changed}")


def bench(name):
    said = judged.output("cargo", "bench", "--quiet", "--bench", name)
    return [json.loads(line) for line in said.splitlines() if line.startswith("{")]


def measure_scene(arguments, scene, binary):
    try:
        return {"result": judged.bake(arguments, scene, binary)}
    except subprocess.TimeoutExpired:
        return {"stopped_after_s": arguments.limit}
    except RuntimeError as error:
        print(error, file=sys.stderr)
        return {"failed": True}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    judged.add_arguments(parser, ",".join(judged.SCENES))
    parser.add_argument("--no-benches", action="store_true", help="leave the benches out")
    results = os.path.join(ROOT, "target", "performance.jsonl")
    parser.add_argument("--results", default=results, help="JSON lines [default: target/performance.jsonl]")
    parser.add_argument("-o", "--output", default=os.path.join(ROOT, PAGE), help="[default: docs/performance.md]")
    arguments = parser.parse_args()
    judged.end_on_sigterm()
    refuse_changes()
    commit, on = judged.commit_of("HEAD"), judged.machine()
    records = known(arguments.results, commit, on)

    def keep(measured):
        record = {"commit": commit, "machine": on, "date": f"{datetime.date.today()}", **measured}
        records.append(record)
        if "failed" in measured:
            return  # tried again the next time
        judged.keep(arguments.results, record)

    with tempfile.TemporaryDirectory() as folder:
        subprocess.run(["cargo", "build", "--release", "--bin", "clerestory"], cwd=ROOT, check=True)
        target = os.environ.get("CARGO_TARGET_DIR", os.path.join(ROOT, "target"))
        # Who builds something else meanwhile does not change what is measured.
        binary = shutil.copy(os.path.join(target, "release", "clerestory"), folder)
        for name in [] if arguments.no_benches else BENCHES:
            if not any(r.get("bench") == name for r in records):
                print(f"bench {name}", file=sys.stderr)
                keep({"bench": name, "figures": bench(name)})
        for scene in arguments.scenes.split(","):
            if is_done(records, scene, arguments.limit):
                continue
            print(scene, file=sys.stderr)
            load, options = round(os.getloadavg()[0], 1), " ".join(judged.options_of(scene))
            keep({"scene": scene, "options": options, "load": load, **measure_scene(arguments, scene, binary)})
    with open(arguments.output, "w") as file:
        file.write(page(newest(records), commit))
    return int(any("failed" in record for record in records))


if __name__ == "__main__":
    sys.exit(main())
