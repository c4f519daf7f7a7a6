"""Section 6.1, Figure 8: grouped against ungrouped Gauss-Seidel iteration on one worker."""

import catalogue
import paper
import plots
from common import CURVE_HEADS, curve_rows, curves_of, level, merged, number, percent, publish, ratio, reached
from common import seconds, solve_s, solving, time_to, total, visits_s
from session import commands

TITLE = "Grouped and ungrouped iteration (6.1, Figure 8)"
# Name, what is done with links, whether there are groups.
RUNS = [
    ("ungrouped, discard", "discard", False),
    ("grouped, discard", "discard", True),
    ("ungrouped, keep", "keep", False),
    ("grouped, keep", "keep", True),
]

SETTING = (
    "One worker, Gauss-Seidel (`--order sequential`), a link cache of 32 MB, links thrown away after each visit"
    " (`--links discard`). Ungrouped is one group of all clusters with one gather a visit (`--groups 1 --inner 1`): a"
    " sweep over everything that makes every link anew, which is the worst case of the paper's LRU cache, and here it"
    " is so by construction, however much fits into the cache. Grouped is Merge with two gathers a visit (`--inner 2`):"
    " the second finds the links made. As a control the same with `--links keep`, where links stay in the store. What"
    " comes from outside a group is gathered once a visit."
)
COUNTING = (
    "Reused is the share of the uses of links that find them made. \"Every link with each gather\": a visit uses each"
    " of its links as often as it gathers; with k gathers (k-1)/k are reused by that alone, with nothing kept between"
    " visits."
    " \"Links within the group alone, gathered again\": it uses each once, and those from within its group (their share"
    " is counted in the link extents of the control) once more for each further gather, which is what the program does."
    " Gathers are those that visits report. Links made are those stored less those reused, and stay for their visit:"
    " what does not fit into the cache is read again, not made again. Reused over visits: `links_reused` over"
    " `links_stored`, summed over iterations, which counts no gathers."
)


def options(arguments, links, is_grouped):
    iterations = paper.GROUPING["iterations_grouped" if is_grouped else "iterations_ungrouped"]
    return solving(
        arguments,
        workers=1,
        order="sequential",
        links=links,
        inner=paper.GROUPING["inner"] if is_grouped else 1,
        **{"max-iterations": arguments.max_iterations or iterations},
    )


def partition(session, arguments, model, is_grouped):
    # One cell of the grid: Merge leaves clusters apart that exchange nothing.
    return merged(session, model, arguments.groups) if is_grouped else {"method": "region", "groups": 1}


def figures(result):
    """What a run's row tells."""
    history = result["history"]
    stored, reused = total(history, "stored"), total(history, "reused")
    return {
        "iterations": len(history["iterations"]),
        "visits_s": visits_s(result),
        "wall_s": solve_s(result),
        "reached": reached(result),
        "reused_every": result["reuse"]["every"],
        "reused_inside": result["reuse"]["inside"],
        "reused_visits": ratio(reused, stored),
        "made": stored - reused,
        "rays": total(history, "rays"),
        "anon_mb": result["run"]["peak_anon_bytes"] / 1e6,
    }


# Which links a further gather of a visit uses.
COUNTS = {"every": "every link with each gather", "inside": "links within the group alone, gathered again"}

HEADS = (
    "run|iterations|time in visits|time|transfer|to {level}|reused, {every}|reused, {inside}|reused over visits"
    "|links made|rays|memory"
)


def rows(results):
    """Lines of the table: of {name: result}."""
    share = level(list(results.values()))
    lines = []
    for name, result in results.items():
        of = figures(result)
        to_level = time_to(result["history"]["curve"], share, 1) if share else None
        lines.append(
            [
                name,
                of["iterations"],
                seconds(of["visits_s"]),
                seconds(of["wall_s"]),
                percent(of["reached"]),
                seconds(to_level),
                percent(of["reused_every"]),
                percent(of["reused_inside"]),
                percent(of["reused_visits"]),
                number(of["made"], digits=0),
                number(of["rays"], digits=0),
                number(of["anon_mb"], " MB"),
            ]
        )
    return HEADS.format(level=percent(share), **COUNTS).split("|"), lines


def beside(results):
    lines = []
    for count, what in COUNTS.items():
        for groups in ("grouped", "ungrouped"):
            found = paper.GROUPING[f"reused_{groups}"], results[f"{groups}, discard"]["reuse"][count]
            lines.append([f"links reused, {groups}: {what}", *map(percent, found)])
    return ["", "the paper", "ours"], [
        *lines,
        ["less time to the same transfer", "grouped", faster(results, "discard")],
        ["the same, links kept", "-", faster(results, "keep")],
    ]


def times(results, links):
    """Times in visits to the level that both reach: grouped, ungrouped."""
    pair = [results[f"{name}, {links}"] for name in ("grouped", "ungrouped")]
    share = level(pair)
    return [time_to(result["history"]["curve"], share, 1) if share else None for result in pair]


def faster(results, links):
    grouped, ungrouped = times(results, links)
    if grouped is None or ungrouped is None:
        return "-"
    return "grouped" if grouped < ungrouped else "ungrouped"


def reuses(results):
    """Both counts of reuse, and why they differ."""
    found = {
        count: [percent(results[f"{groups}, discard"]["reuse"][count]) for groups in ("grouped", "ungrouped")]
        for count in COUNTS
    }
    said = [percent(paper.GROUPING[f"reused_{groups}"]) for groups in ("grouped", "ungrouped")]
    # With k gathers: reused = (k - 1) inside / (1 + (k - 1) inside).
    share = paper.GROUPING["reused_grouped"]
    needed = share / (1 - share) / (paper.GROUPING["inner"] - 1)
    return (
        f"If every link counts with each gather, {found['every'][0]} of the uses of links find them made in groups and"
        f" {found['every'][1]} without; if those within the group alone count again, {found['inside'][0]} and"
        f" {found['inside'][1]} (the paper: {said[0]} and {said[1]}). The two differ because what other groups send"
        " does not change during a visit: the program sums it up once, and a second gather uses the links within the"
        " group alone. The paper says that its patches gathered six times from their own group and three times from"
        " others, but not whether links to others count again with the second gather; if they do not, its"
        f" {said[0]} need {percent(needed)} of all links to come from within their group."
    )


def prose(results):
    lines = [SETTING]
    for links, what in (("discard", "Where links are thrown away"), ("keep", "Where they are kept")):
        grouped, ungrouped = times(results, links)
        if grouped is not None and ungrouped:
            word = "less" if grouped < ungrouped else "more"
            lines.append(
                f"{what}, groups take {seconds(grouped)} in visits to the transfer that both reach, no groups "
                f"{seconds(ungrouped)}: {word} by a factor of {max(grouped, ungrouped) / min(grouped, ungrouped):.2f}."
            )
    lines.append(reuses(results))
    of = {name: figures(result) for name, result in results.items()}
    made = ratio(of["grouped, discard"]["made"], of["ungrouped, discard"]["made"])
    cast = ratio(of["grouped, discard"]["rays"], of["ungrouped, discard"]["rays"])
    if made and cast:
        lines.append(
            f"With links thrown away, the grouped run makes {made:.2f} times the links of the ungrouped one and casts"
            f" {cast:.2f} times its rays; rays beyond those of links measure places anew, some in every group. Visits"
            f" are {percent(ratio(of['grouped, discard']['visits_s'], of['grouped, discard']['wall_s']))} of the"
            " grouped run's time: `sequential` starts a process a group."
        )
    return [*lines[:1], " ".join(lines[1:]), COUNTING]


def run(session, arguments):
    plots.pyplot()
    model = arguments.floor(session, arguments)
    results, listed = {}, []
    for name, links, is_grouped in RUNS:
        flags = partition(session, arguments, model, is_grouped), options(arguments, links, is_grouped)
        results[name] = session.solve(f"grouping, {name}", model, *flags)
        listed += [line for line in commands(model, *flags) if line not in listed]
    shares = catalogue.inside_shares(results["grouped, keep"]["store"])
    for name, _, is_grouped in RUNS:
        results[name]["reuse"] = catalogue.reuse_of_store(results[name]["store"], shares if is_grouped else {})
    of_runs = list(results.items())
    session.write_csv("grouping", "transfer", CURVE_HEADS, curve_rows(of_runs))
    session.write_csv(
        "grouping", "runs", ["run", *figures(of_runs[0][1])], [[n, *figures(r).values()] for n, r in of_runs]
    )
    picture = session.picture("grouping", "transfer")
    plots.curves(picture, curves_of(of_runs, 1), "time in visits [s]", "transfer [% of emitted power]")
    text = prose(results), [beside(results), rows(results)], [("Transfer over time; circles end sweeps", picture)]
    publish(session, arguments, "grouping", TITLE, text, (model.name, list(results.values()), listed))
