"""Ours: memory, and time per patch, against the size of the model."""

import math

import models
import plots
from common import number, percent, publish, seconds, solve_s, solving
from session import Failed, commands

TITLE = "Memory and time against size (ours)"

SETTING = (
    "Furnished buildings of the generator; floors of size 1: {floors}, with {rooms} rooms each. Larger ones have more"
    " floors, smaller ones fewer rooms or floors. Memory is anonymous, of the largest process of each stage; what is"
    " mapped is the system's to drop. Time is all of it: reading, visibility, grouping, solving."
)


def figures(result):
    run, history = result["run"], result["history"]
    stages = ("ingest", "visibility", "partition")
    time_s = sum(result[name]["wall_s"] for name in stages) + solve_s(result)
    return {
        "patches": run["patches"],
        "clusters": run["clusters"],
        "groups": run["groups"],
        "elements": run["elements"],
        "links_stored": run["links_stored"],
        "iterations": len(history["iterations"]),
        "estimated_nrms": run["estimated_nrms"],
        "time_s": time_s,
        "ms_a_patch": 1e3 * time_s / run["patches"],
        **{f"{name}_mb": result[name]["peak_anon_bytes"] / 1e6 for name in stages},
        "worker_mb": run["peak_anon_bytes"] / 1e6,
        "coordinator_mb": run["coordinator_anon_bytes"] / 1e6,
    }


def slope(xs, ys):
    """Exponent of y over x: the straight line through the logarithms; None for fewer than two."""
    pairs = [(math.log(x), math.log(y)) for x, y in zip(xs, ys) if x > 0 and y > 0]
    if len(pairs) < 2:
        return None
    mean_x, mean_y = (sum(pair[i] for pair in pairs) / len(pairs) for i in (0, 1))
    across = sum((x - mean_x) ** 2 for x, _ in pairs)
    return sum((x - mean_x) * (y - mean_y) for x, y in pairs) / across if across else None


HEADS = (
    "size|patches|elements|links|iterations|estimated|time|a patch|memory:"
    " ingest|visibility|partition|workers|coordinator"
).split("|")


def rows(of):
    """Lines of the table: figures by size, or why there are none."""
    whole, mb = lambda value: number(value, digits=0), lambda value: number(value, " MB")
    lines = []
    for size, f in of.items():
        if isinstance(f, str):
            lines.append([f"{size:g}", f, *["-"] * (len(HEADS) - 2)])
            continue
        cells = [whole(f["patches"]), whole(f["elements"]), number(f["links_stored"] / 1e6, " M"), f["iterations"]]
        cells += [percent(f["estimated_nrms"]), seconds(f["time_s"]), number(f["ms_a_patch"], " ms", 2)]
        cells += [mb(f[f"{name}_mb"]) for name in ("ingest", "visibility", "partition", "worker", "coordinator")]
        lines.append([f"{size:g}", *cells])
    return HEADS, lines


def prose(arguments, of):
    lines = [SETTING.format(floors=arguments.floors, rooms=arguments.rooms_per_floor)]
    known = [f for f in of.values() if not isinstance(f, str)]
    if len(known) > 1:
        xs = [f["patches"] for f in known]
        exponent = lambda name: slope(xs, [f[name] for f in known])
        time, worker, coordinator = (exponent(name) for name in ("time_s", "worker_mb", "coordinator_mb"))
        shown = lambda value: "-" if value is None else f"{value:.2f}"
        growth = max(xs) / min(xs)
        lines.append(
            f"Over {growth:.1f} times the patches, time grows with their number to the power {shown(time)} (1 is"
            f" linear), the memory of a worker to {shown(worker)} and that of the coordinator to {shown(coordinator)};"
            " the largest process of all holds"
            f" {number(max(f[name] for f in known for name in f if name.endswith('_mb')), ' MB')}."
        )
    return lines


def run(session, arguments):
    plots.pyplot()
    of, results, listed = {}, [], []
    options, partition = solving(arguments), {"groups": arguments.groups}
    for size in sorted(arguments.sizes):
        model = models.of_size(session, size, arguments.floors, arguments.rooms_per_floor)
        try:
            results.append(session.solve(f"memory, size {size:g}", model, partition, options, keep=False))
        except Failed as failed:
            session.say(f"memory, size {size:g}: {failed}")
            of[size] = f"{failed}"
            continue
        of[size] = figures(results[-1])
        listed += commands(model, partition, options)
    known = {size: f for size, f in of.items() if not isinstance(f, str)}
    if not known:
        raise Failed(next(iter(of.values())), "give smaller --sizes, or more --memory")
    heads = ["size", *next(iter(known.values()))]
    session.write_csv("memory", "sizes", heads, [[size, *f.values()] for size, f in known.items()])
    picture = session.picture("memory", "growth")
    line = lambda name: [(f["patches"], f[name]) for f in known.values()]
    names = ("worker", "visibility", "partition", "coordinator")
    panels = [
        ("anonymous memory [MB]", [(name, line(f"{name}_mb")) for name in names]),
        ("time per patch [ms]", [("all stages", line("ms_a_patch"))]),
    ]
    plots.growth(picture, panels, "thousand patches")
    text = prose(arguments, of), [rows(of)], [("Memory of processes, and time per patch", picture)]
    publish(session, arguments, "memory", TITLE, text, ("generated buildings", results, listed))
