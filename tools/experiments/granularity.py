"""Section 6.3, Figure 10: how many groups."""

import paper
import plots
from common import (
    CURVE_HEADS,
    clusters,
    curve_rows,
    curves_of,
    in_visits,
    level,
    merged,
    number,
    percent,
    publish,
    ratio,
)
from common import seconds, solve_s, solving, time_to, total, visits_s
from session import commands

TITLE = "Sizes of groups (6.3, Figure 10)"

SETTING = (
    "Merge with different numbers of groups; the paper's are 32, 128, 256 and 1,425 (a group for each cluster that"
    " reflects), of eight workers. No more groups than the model has clusters. Links are kept in the store, so that"
    " small groups lose nothing of them, unlike in the paper; every visit measures places anew with rays of its own,"
    " however small its group."
)


def sizes(asked, most):
    """Numbers of groups that a model with so many clusters can have, ascending."""
    return sorted({min(groups, most) for groups in asked})


def figures(result, workers):
    history = result["history"]
    iterations = max(1, len(history["iterations"]))
    return {
        "groups": result["partition"]["groups"],
        "intra_group_share": result["partition"]["intra_group_share"],
        "iterations": len(history["iterations"]),
        "visits_s": visits_s(result),
        "wall_s": solve_s(result),
        "s_an_iteration": solve_s(result) / iterations,
        "in_visits": in_visits(result, workers),
        "cpu_of_visits": ratio(total(history, "visits_cpu_s"), visits_s(result)),
        "rays": sum(iteration["rays"] for iteration in history["iterations"]),
        "anon_mb": result["run"]["peak_anon_bytes"] / 1e6,
    }


HEADS = (
    "groups|exchange within groups|iterations|time in visits|time|an iteration|workers in visits"
    "|processor's share of visits|rays|memory|to {level}"
)


def times(results):
    share = level(list(results.values()))
    return {name: time_to(result["history"]["curve"], share) if share else None for name, result in results.items()}


def rows(results, workers):
    lines = []
    for name, to_level in times(results).items():
        of = figures(results[name], workers)
        lines.append(
            [
                number(of["groups"], digits=0),
                percent(of["intra_group_share"]),
                of["iterations"],
                seconds(of["visits_s"]),
                seconds(of["wall_s"]),
                seconds(of["s_an_iteration"]),
                percent(of["in_visits"]),
                percent(of["cpu_of_visits"]),
                number(of["rays"] / 1e6, " M", 2),
                number(of["anon_mb"], " MB"),
                seconds(to_level),
            ]
        )
    return HEADS.format(level=percent(level(list(results.values())))).split("|"), lines


def best(results):
    """Number of groups that reach the level first, or None."""
    known = {name: time for name, time in times(results).items() if time is not None}
    return min(known, key=known.get) if known else None


def beside(results):
    ours = best(results)
    return ["", "the paper", "ours"], [
        ["fastest to the same transfer, groups", f"{paper.BEST_GRANULARITY}", "-" if ours is None else f"{ours:,}"],
        ["numbers of groups", ", ".join(f"{n:,}" for n in paper.GRANULARITY), ", ".join(f"{n:,}" for n in results)],
    ]


def prose(results, workers):
    lines, first = [], best(results)
    if first is not None and len(results) > 1:
        found = times(results)
        last = max((name for name in found if found[name] is not None), key=found.get)
        lines.append(
            f"{first:,} groups reach the same transfer first, in {seconds(found[first])}; {last:,} last, in "
            f"{seconds(found[last])}."
        )
    few, many = (figures(results[pick(results)], workers) for pick in (min, max))
    if many["groups"] > few["groups"]:
        lines.append(
            f"From {few['groups']:,} to {many['groups']:,} groups, the exchange within groups goes from"
            f" {percent(few['intra_group_share'])} to {percent(many['intra_group_share'])}, the time of an iteration"
            f" from {seconds(few['s_an_iteration'])} to {seconds(many['s_an_iteration'])}, and what workers spend of it"
            f" in visits from {percent(few['in_visits'])} to {percent(many['in_visits'])}; the rest is claiming,"
            " publishing, merging and waiting."
        )
    return [SETTING, " ".join(lines)] if lines else [SETTING]


def run(session, arguments):
    plots.pyplot()
    model = arguments.floor(session, arguments)
    results, listed, options = {}, [], solving(arguments)
    for groups in sizes(arguments.numbers, clusters(session, model)):
        flags = merged(session, model, groups)
        results[groups] = session.solve(f"granularity, {groups} groups", model, flags, options)
        listed += [line for line in commands(model, flags, options) if line not in listed]
    of_runs = [(f"{groups:,} groups", result) for groups, result in results.items()]
    session.write_csv("granularity", "transfer", CURVE_HEADS, curve_rows(of_runs))
    found = [figures(result, arguments.workers) for result in results.values()]
    session.write_csv("granularity", "runs", list(found[0]), [list(of.values()) for of in found])
    picture = session.picture("granularity", "transfer")
    plots.curves(picture, curves_of(of_runs), "time since the first visit began [s]", "transfer [% of emitted power]")
    tables = [beside(results), rows(results, arguments.workers)]
    text = prose(results, arguments.workers), tables, [("Transfer over time; circles end iterations", picture)]
    publish(session, arguments, "granularity", TITLE, text, (model.name, list(results.values()), listed))
