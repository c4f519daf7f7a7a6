"""What the experiments share: the usual options, times to a level of transfer, and how a section is put together."""

import os
import shlex
import shutil
import sys

import page
import paper
from catalogue import total
from session import ROOT, judged

number, percent = judged.number, judged.percent

# Of the least transfer that all runs of a comparison end with: the level whose time is compared.
LEVEL = 0.99


def solving(arguments, **changes):
    """Options of `run`; those of the paper's where the program has them."""
    tolerance = {"tolerance": arguments.tolerance} if arguments.tolerance else {"quality": arguments.quality}
    usual = {
        "workers": arguments.workers,
        "order": "jacobi",
        "schedule": "ffd-ws",
        "delta": paper.DELTA,
        "inner": "converge",
        "links": "keep",
        "link-cache": paper.LINK_CACHE,
        **tolerance,
        "max-iterations": arguments.max_iterations,
        "memory": arguments.memory,
        "audit": 0,
    }
    return {**usual, **changes}


def clusters(session, model):
    return session.prepared(model)[1]["ingest"]["clusters"]


def merged(session, model, groups, method="merge"):
    """Flags of `partition`, with no more groups than clusters."""
    return {"method": method, "groups": min(groups, clusters(session, model))}


def solve_s(result):
    """Time of the iterations, s."""
    return total(result["history"], "wall_s")


def visits_s(result):
    return total(result["history"], "visits_s")


def in_visits(result, workers):
    """Share of the workers' time that they spend in visits."""
    return visits_s(result) / (workers * solve_s(result)) if solve_s(result) else None


def reached(result):
    """Transfer at the end."""
    curve = result["history"]["curve"]
    return curve[-1][2] if curve else None


def level(results):
    """A level of transfer that all results reach, or None."""
    ends = [reached(result) for result in results]
    return LEVEL * min(ends) if ends and None not in ends else None


def time_to(curve, share, column=0):
    """When a curve first reaches a share, s: by the clock (0) or in visits (1); between its points along the line."""
    before = (0.0, 0.0, 0.0)
    for point in curve:
        if point[2] >= share:
            part = (share - before[2]) / (point[2] - before[2]) if point[2] > before[2] else 1.0
            return before[column] + part * (point[column] - before[column])
        before = point
    return None


def seconds(value):
    return number(value, " s", 2 if value is not None and value < 10 else 1)


def factor(value):
    return "-" if value is None else f"{value:.3f}"


def ratio(a, b):
    return a / b if a is not None and b else None


def ordered(names, values):
    """Names by their values, least first; those without one are left out."""
    known = [(value, name) for name, value in zip(names, values) if value is not None]
    return [name for _, name in sorted(known, key=lambda pair: pair[0])]


def facts(session, name, results, commands):
    span = lambda values: " to ".join(dict.fromkeys(f"{value}" for value in values[:1] + values[-1:]))
    dates, loads = (sorted({result[name] for result in results if name in result}) for name in ("date", "load"))
    converged = sum(bool(result["run"]["converged"]) for result in results)
    lines = [
        ("Model", name),
        ("Command", f"`{command_line()}`, which ran what stands below"),
        ("Commit", session.commit),
        ("Machine", session.machine),
        ("Date", span(dates)),
        ("Load average before each run", span(loads)),
        ("Runs that met their tolerance", f"{converged} of {len(results)}"),
    ]
    return {"lines": lines, "commands": commands}


# Flags whose values are places on this machine.
PLACES = {"--binary", "--building", "--simulate", "-o", "--output", "--page", "--model"}


def command_line(words=None):
    """The driver's command line without places on this machine."""
    kept, skips = [], None
    for word in sys.argv[1:] if words is None else words:
        name = word.split("=", 1)[0]
        if word.startswith("-"):
            skips = name if name in PLACES and "=" not in word else None
            if name in PLACES:
                continue
        elif skips is not None:
            # `--model` takes several files.
            skips = skips if skips == "--model" else None
            continue
        kept.append(shlex.quote(word))
    return " ".join(["tools/experiments/experiments.py", *kept])


def publish(session, arguments, name, title, text, measured):
    """Writes a section; `text` is (prose, tables, [(what a picture shows, its file)]), `measured` (name of the model,
    results, commands)."""
    prose, tables, pictures = text
    place = os.path.abspath(arguments.page)
    folder = os.path.splitext(place)[0]
    os.makedirs(folder, exist_ok=True)
    shown = []
    for what, path in pictures:
        to = os.path.join(folder, f"{name}-{os.path.basename(path)}")
        shutil.copyfile(path, to)
        shown.append((what, f"{os.path.basename(folder)}/{os.path.basename(to)}"))
    body = page.section(title, prose, tables, shown, facts(session, *measured))
    page.write(place, name, body)
    session.say(f"{name}: written to {os.path.relpath(place, ROOT) if place.startswith(ROOT) else place}")


def curves_of(results, column=0):
    """Series for a plot: (label, points in %, ends of iterations)."""
    at = lambda points: [(point[column], 100 * point[2]) for point in points]
    return [
        (label, [(0, 0)] + at(result["history"]["curve"]), at(result["history"]["ends"])) for label, result in results
    ]


def curve_rows(results):
    return [[label, *point] for label, result in results for point in result["history"]["curve"]]


CURVE_HEADS = ["run", "time_s", "time_in_visits_s", "transfer"]
