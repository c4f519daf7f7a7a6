"""Section 6.6: five floors of a large building."""

import models
import paper
from common import number, percent, publish, ratio, seconds, solve_s, solving, total, visits_s
from session import commands

TITLE = "Five floors (6.6)"

SETTING = (
    "The paper's building has furniture that its public model lacks; a generated one of the same size stands in for it."
    " All of our time is counted: reading, visibility, which the paper made off-line, grouping, solving; `--audit`"
    " afterwards is not. Workers map one store: they download and upload nothing, so that the coordinator merges"
    " instead."
)


def figures(result):
    """What is measured of a run, by the paper's words."""
    history, run, workers = result["history"], result["run"], result["run"]["workers"]
    stages_s = {name: result[name]["wall_s"] for name in ("ingest", "visibility", "partition")}
    time_s, solving_s = sum(stages_s.values()) + solve_s(result), visits_s(result)
    of_workers_s = workers * solve_s(result)
    made = total(history, "stored") - total(history, "reused")
    memory = [result[name]["peak_anon_bytes"] for name in ("ingest", "visibility", "partition")]
    return {
        "clusters": run["clusters"],
        "patches": run["patches"],
        "emitters": run["emitters"],
        "area_m2": run["area_m2"],
        "groups": run["groups"],
        "elements": run["elements"],
        "links_made": made,
        "links_stored": run["links_stored"],
        "iterations": run["iterations"],
        "estimated_nrms": run["estimated_nrms"],
        "audited_nrms": run["audited_nrms"],
        "converged": run["converged"],
        **{f"{name}_s": value for name, value in stages_s.items()},
        "solve_s": solve_s(result),
        "time_s": time_s,
        "workers": workers,
        "links_a_s": ratio(made, solve_s(result)),
        "grouping_share": ratio(stages_s["partition"], time_s),
        "merging_share": ratio(total(history, "merge_s"), time_s),
        "in_visits_share": ratio(solving_s, of_workers_s),
        "visits_cpu_share": ratio(total(history, "visits_cpu_s"), solving_s),
        # The paper's estimate: time in radiosity computations over elapsed time.
        "speedup": ratio(solving_s, solve_s(result)),
        "worker_mb": run["peak_anon_bytes"] / 1e6,
        "stages_mb": max(memory) / 1e6,
        "coordinator_mb": run["coordinator_anon_bytes"] / 1e6,
        "ms_a_patch": 1e3 * time_s / run["patches"],
    }


def rows(results):
    """The table: the paper's run beside each of ours, of {name: result}."""
    of, said = [figures(result) for result in results.values()], paper.FIVE_FLOORS
    whole = lambda value: number(value, digits=0)
    percents = lambda *names: [percent(sum(f[name] or 0.0 for name in names)) for f in of]
    each = lambda name, shown: [shown(f[name]) for f in of]
    paper_s = said["hours"] * 3600
    yes = lambda value: "yes" if value else "no"
    area_m2 = said["area_in2"] * paper.INCH_M**2
    lines = [
        ["clusters", whole(said["clusters"]), *each("clusters", whole)],
        ["patches", whole(said["patches"]), *each("patches", whole)],
        ["emitters", whole(said["emitters"]), *each("emitters", whole)],
        ["area", number(area_m2, " m2", 0), *each("area_m2", lambda value: number(value, " m2", 0))],
        ["groups", "-", *each("groups", whole)],
        ["elements", whole(said["elements"]), *each("elements", whole)],
        ["links made", whole(said["links_evaluated"]), *each("links_made", whole)],
        ["links stored", "-", *each("links_stored", whole)],
        ["iterations", whole(said["iterations"]), *each("iterations", whole)],
        ["estimated error", "-", *each("estimated_nrms", percent)],
        ["audited error", "-", *each("audited_nrms", percent)],
        ["tolerance met", "-", *each("converged", yes)],
        ["workers", f"{said['workers']}", *each("workers", whole)],
        ["time, all of it", f"{said['hours']} h", *each("time_s", seconds)],
        ["reading the model", "-", *each("ingest_s", seconds)],
        ["visibility", "off-line", *each("visibility_s", seconds)],
        ["iterations", "-", *each("solve_s", seconds)],
        ["links made a second", whole(said["links_evaluated"] / paper_s), *each("links_a_s", whole)],
        ["master: grouping (the paper: and scheduling)", percent(said["master_grouping"]), *percents("grouping_share")],
        ["master: download", percent(said["master_download"]), *["none"] * len(of)],
        ["master: upload; ours: merging", percent(said["master_upload"]), *percents("merging_share")],
        [
            "workers: updating radiosities; ours: in visits",
            percent(said["worker_solving"]),
            *percents("in_visits_share"),
        ],
        ["processor's share of visits", "-", *each("visits_cpu_share", percent)],
        ["workers: download and upload", percent(said["worker_download"] + said["worker_upload"]), *["none"] * len(of)],
        [
            "workers: the rest, waiting among it",
            percent(1 - said["worker_solving"] - said["worker_download"] - said["worker_upload"]),
            *[percent(None if f["in_visits_share"] is None else 1 - f["in_visits_share"]) for f in of],
        ],
        [
            "speedup, visits over time of iterations",
            f"{said['speedup']}",
            *each("speedup", lambda v: number(v, digits=2)),
        ],
        [
            "the same, of linear",
            percent(said["speedup"] / said["workers"]),
            *[percent(None if f["speedup"] is None else f["speedup"] / f["workers"]) for f in of],
        ],
        ["memory of the master", f"< {paper.MASTER_MB} MB", *each("coordinator_mb", lambda v: number(v, " MB"))],
        ["memory of a worker", f">= {paper.WORKER_MB} MB", *each("worker_mb", lambda v: number(v, " MB"))],
        ["memory of the stages before", "-", *each("stages_mb", lambda v: number(v, " MB"))],
    ]
    return ["", "the paper", *results], lines


def prose(results):
    lines, said = [], paper.FIVE_FLOORS
    for name, result in results.items():
        of = figures(result)
        lines.append(
            f"{name}: {number(of['patches'], digits=0)} patches took {seconds(of['time_s'])} with"
            f" {of['workers']} workers; the tolerance was {'met' if of['converged'] else 'not met'}, with an estimated"
            f" error of {percent(of['estimated_nrms'])}."
        )
        if 2 * of["patches"] >= said["patches"]:
            lines.append(
                f"The paper's 168 hours with 4.96 workers are {number(3600 * said['hours'] / of['time_s'], digits=0)}"
                f" times as long. The run made {number(of['links_made'] / 1e6, ' M')} links,"
                f" {number(100 * of['links_made'] / said['links_evaluated'])} % of the paper's: fewer are no merit but"
                " for the same error, which the paper does not say."
            )
        else:
            share = of["patches"] / said["patches"]
            lines.append(f"It has {percent(share)} of the paper's patches, so that times do not compare.")
    return [SETTING, " ".join(lines)]


def run(session, arguments):
    results, listed = {}, []
    for model in models.five_floors(session, arguments):
        options = solving(arguments, audit=arguments.audit)
        partition = {"groups": arguments.groups}
        results[model.name] = session.solve("five-floors", model, partition, options, keep=False)
        listed += commands(model, partition, options)
    found = {name: figures(result) for name, result in results.items()}
    session.write_csv(
        "five-floors", "runs", ["model", *next(iter(found.values()))], [[n, *f.values()] for n, f in found.items()]
    )
    text = prose(results), [rows(results)], []
    publish(session, arguments, "five-floors", TITLE, text, (", ".join(results), list(results.values()), listed))
