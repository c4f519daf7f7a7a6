"""Section 6.5, Figure 13: what more workers bring."""

import os

import paper
import plots
from common import in_visits, merged, percent, publish, solve_s, solving
from session import commands

TITLE = "Speedup (6.5, Figure 13)"

SETTING = (
    "Real runs with {real} workers on {cores} cores; speedup is the time of all iterations with one worker over that"
    " with more. Other numbers are replays of the visits of the run with one worker (`simulate`), on the same schedule,"
    " for workers that share no disk: with data that moves at once, with an asynchronous master, and with a synchronous"
    " one as in the paper; speedup there is the time of all visits over that of the replay. All workers wait for each"
    " other at the ends of iterations (Jacobi), so that the answer is the same for any number of them."
)


def networks(arguments):
    line = {"bandwidth": arguments.bandwidth, "latency": arguments.latency}
    return {
        "no cost of moving data": {"master": "async"},
        "asynchronous master": {"master": "async", **line},
        "synchronous master": {"master": "sync", **line},
    }


def measured(results):
    """Speedups of real runs by workers, against one."""
    one_s = solve_s(results[1])
    return {workers: one_s / solve_s(result) for workers, result in results.items() if solve_s(result)}


def rows(real, replays):
    """Lines of the table: speedups of real runs, and rows of replays by network."""
    shown = lambda value, workers: "-" if value is None else f"{value:.2f} ({percent(value / workers)})"
    by = {name: {row["workers"]: row for row in of} for name, of in replays.items()}
    numbers = sorted({*real, *(workers for of in by.values() for workers in of)})
    low, high = paper.SPEEDUP
    lines = []
    for workers in numbers:
        said = f"{low * workers:.1f} to {high * workers:.1f}" if 1 < workers <= paper.WORKERS else "-"
        found = [of.get(workers, {}).get("speedup") for of in by.values()]
        sync = by["synchronous master"].get(workers, {}).get("next_bottleneck", "-")
        lines.append(
            [f"{workers:,}", said, shown(real.get(workers), workers), *(shown(s, workers) for s in found), sync]
        )
    return ["workers", "the paper", "measured", *by, "next bottleneck of the last"], lines


def prose(arguments, real, replays, results, cores):
    names = " and ".join(f"{workers}" for workers in results)
    lines = [SETTING.format(real=names, cores=cores)]
    found = []
    for workers, speedup in real.items():
        if workers > 1:
            found.append(
                f"{workers} real workers are {speedup:.2f} times as fast as one, {percent(speedup / workers)} of"
                f" linear; they spend {percent(in_visits(results[workers], workers))} of their time in visits (one"
                f" worker {percent(in_visits(results[1], 1))}), the rest claiming, publishing, merging and waiting."
            )
    for name, of in replays.items():
        enough = [row["workers"] for row in of if row["share_of_linear"] >= paper.SPEEDUP[0]]
        row = next((row for row in of if row["workers"] == paper.WORKERS), None)
        if row and enough:
            found.append(
                f"With {name if name.startswith('no') else 'an ' + name if name[0] == 'a' else 'a ' + name},"
                f" {row['workers']} workers reach {percent(row['share_of_linear'])} of linear, and {max(enough):,} at"
                f" most reach the paper's {percent(paper.SPEEDUP[0])}."
            )
    return lines + [" ".join(found)]


def run(session, arguments):
    plots.pyplot()
    model = arguments.floor(session, arguments)
    partition = merged(session, model, arguments.groups)
    results, listed = {}, []
    for workers in sorted({1, *arguments.real}):
        options = solving(arguments, workers=workers)
        results[workers] = session.solve(f"speedup, {workers} workers", model, partition, options)
        listed += [line for line in commands(model, partition, options) if line not in listed]
    replays = {}
    for name, flags in networks(arguments).items():
        words = {
            "workers": ",".join(f"{n}" for n in arguments.replayed),
            "schedule": "ffd-ws",
            "delta": paper.DELTA,
            **flags,
        }
        replays[name] = session.simulate(results[1]["store"], words)["replays"]
        listed += commands(model, partition, {}, replay=words)[-1:]
    real, cores = measured(results), len(os.sched_getaffinity(0))
    flat = [[name, *row.values()] for name, of in replays.items() for row in of]
    session.write_csv("speedup", "replayed", ["network", *next(iter(replays.values()))[0]], flat)
    session.write_csv(
        "speedup", "real", ["workers", "time_s", "speedup"], [[n, solve_s(results[n]), real[n]] for n in real]
    )
    picture = session.picture("speedup", "speedup")
    series = [("measured", list(real.items()))]
    series += [(name, [(row["workers"], row["speedup"]) for row in of]) for name, of in replays.items()]
    most = max([*real, *arguments.replayed])
    ideal = ("linear", [(1, 1), (most, most)])
    plots.scaling(picture, series, "workers", "speedup", ideal=ideal)
    heads, lines = rows(real, replays)
    text = (
        prose(arguments, real, replays, results, cores),
        [(heads, lines)],
        [("Speedup by number of workers", picture)],
    )
    publish(session, arguments, "speedup", TITLE, text, (model.name, list(results.values()), listed))
