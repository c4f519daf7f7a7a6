"""Section 6.2, Figures 7 and 9: the four ways to group clusters."""

import catalogue
import paper
import plots
from common import CURVE_HEADS, curve_rows, curves_of, factor, level, merged, ordered, percent, publish
from common import seconds, solve_s, solving, time_to, visits_s
from session import commands

TITLE = "Ways to group (6.2, Figures 7 and 9)"

SETTING = (
    "The same number of groups made by each method, two workers unless `--workers` says otherwise (the paper had"
    " eight). Groups are solved to convergence in each visit and all read the version before (Jacobi), for which the"
    " contraction is predicted: q (1 - w) / (1 - q w), of the share w of the exchange that stays within groups, and the"
    " reflectance q, the greatest or the mean of the model. Measured is by how much the change falls per iteration"
    " before rows are refined. Iterations go on until the tolerance is met unless `--max-iterations` stops them; the"
    " paper made two, with two gathers a visit."
)


def figures(result):
    history, share = result["history"], result["partition"]["intra_group_share"]
    return {
        "groups": result["partition"]["groups"],
        "intra_group_share": share,
        "predicted_by_greatest": result["partition"]["predicted_contraction"],
        "predicted_by_mean": catalogue.predicted_contraction(history["mean_reflectance"], share),
        "measured": catalogue.contraction(history),
        "iterations": len(history["iterations"]),
        "visits_s": visits_s(result),
        "wall_s": solve_s(result),
    }


HEADS = (
    "method|groups|exchange within groups|contraction predicted, greatest q|mean q|measured|iterations|time in"
    " visits|time|to {level}"
)


def times(results):
    share = level(list(results.values()))
    return [time_to(result["history"]["curve"], share) if share else None for result in results.values()]


def rows(results):
    lines = []
    for (name, result), to_level in zip(results.items(), times(results)):
        of = figures(result)
        lines.append(
            [
                name,
                of["groups"],
                percent(of["intra_group_share"]),
                factor(of["predicted_by_greatest"]),
                factor(of["predicted_by_mean"]),
                factor(of["measured"]),
                of["iterations"],
                seconds(of["visits_s"]),
                seconds(of["wall_s"]),
                seconds(to_level),
            ]
        )
    return HEADS.format(level=percent(level(list(results.values())))).split("|"), lines


def orders(results):
    """Methods by time to a level, by measured contraction and by exchange within groups, the best first."""
    names, of = list(results), [figures(result) for result in results.values()]
    return {
        "time": ordered(names, times(results)),
        "contraction": ordered(names, [figure["measured"] for figure in of]),
        "share": ordered(names, [-figure["intra_group_share"] for figure in of]),
    }


def beside(results):
    ours, said = orders(results), "merge = split, region, random"
    shown = lambda names: ", ".join(names) or "-"
    return ["the best first", "the paper", "ours"], [
        ["by time to the same transfer", said, shown(ours["time"])],
        ["by measured contraction", "-", shown(ours["contraction"])],
        ["by exchange within groups", "-", shown(ours["share"])],
    ]


def prose(results):
    of = {name: figures(result) for name, result in results.items()}
    ours = orders(results)
    low, high = (pick(f["intra_group_share"] for f in of.values()) for pick in (min, max))
    lines = [
        f"Between {percent(low)} and {percent(high)} of the exchange stay within groups, most with {ours['share'][0]}."
    ]
    known = [f for f in of.values() if f["measured"] is not None]
    if known:
        kept = sum(f["measured"] <= f["predicted_by_greatest"] for f in known)
        lines.append(
            f"The prediction by the greatest reflectance bounds {kept} of the {len(known)} measured contractions."
        )
        same = ours["contraction"] == ours["share"]
        lines.append(
            "Methods that keep more exchange within groups contract faster, without exception."
            if same
            else (
                f"By contraction the order is {', '.join(ours['contraction'])}, by exchange within groups "
                f"{', '.join(ours['share'])}."
            )
        )
    found = [time for time in times(results) if time]
    if len(found) > 1:
        lines.append(
            f"By time to the same transfer, {ours['time'][0]} is first and {ours['time'][-1]} last, which takes "
            f"{max(found) / min(found):.2f} times as long."
        )
    return [SETTING, " ".join(lines)]


def plans(session, arguments, model):
    """Clusters from above by group, for as many groups as in Figure 7."""
    store, _ = session.prepared(model)
    panels = []
    for method in paper.PARTITION:
        groups = min(arguments.plan_groups, session.prepared(model)[1]["ingest"]["clusters"])
        found = session.run("clerestory", "partition", store, "--method", method, "--groups", f"{groups}")
        boxes = catalogue.boxes(store)
        session.write_csv("partition", f"plan-{method}", ["min_x_m", "min_y_m", "max_x_m", "max_y_m", "group"], boxes)
        panels.append((f"{method}: {found['groups']} groups, {percent(found['intra_group_share'])} within", boxes))
    picture = session.picture("partition", "plan")
    plots.plans(picture, panels)
    return picture


def run(session, arguments):
    plots.pyplot()
    model = arguments.floor(session, arguments)
    results, listed, options = {}, [], solving(arguments)
    for method in paper.PARTITION:
        flags = merged(session, model, arguments.groups, method)
        results[method] = session.solve(f"partition, {method}", model, flags, options)
        listed += [line for line in commands(model, flags, options) if line not in listed]
    of_runs = list(results.items())
    session.write_csv("partition", "transfer", CURVE_HEADS, curve_rows(of_runs))
    session.write_csv(
        "partition", "runs", ["method", *figures(of_runs[0][1])], [[n, *figures(r).values()] for n, r in of_runs]
    )
    picture = session.picture("partition", "transfer")
    plots.curves(picture, curves_of(of_runs), "time since the first visit began [s]", "transfer [% of emitted power]")
    pictures = [
        ("Clusters from above, by group", plans(session, arguments, model)),
        ("Transfer over time; circles end iterations", picture),
    ]
    text = prose(results), [beside(results), rows(results)], pictures
    publish(session, arguments, "partition", TITLE, text, (model.name, list(results.values()), listed))
