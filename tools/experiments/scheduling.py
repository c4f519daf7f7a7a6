"""Section 6.4, Figures 11 and 12: which group a free worker takes."""

import catalogue
import paper
import plots
from common import in_visits, merged, number, percent, publish, seconds, solve_s, solving, visits_s
from session import commands

TITLE = "Schedules (6.4, Figures 11 and 12)"
POLICIES = ["ffd", "ws", "ffd-ws"]
# What is drawn of runs and replays; the paper made two iterations.
DRAWN = 2

SETTING = (
    "Real runs with {workers} workers, then a replay of the recorded visits of the ffd-ws run for {simulated} workers"
    " that share no disk (`simulate`): with a synchronous master as in the paper, and with one that lets transfers go"
    " on behind visits. The first two pictures are replays of the paper's setting, as its Figures 12 and 11: with a"
    " synchronous master and a network as slow as its Ethernet. FFD-WS has a delta of {delta}. Real workers map one"
    " store and download nothing; the simulator's downloads are the clusters that a worker does not hold yet. Waiting"
    " is what a worker waits for the last one at the ends of iterations, in the mean; what downloads take is their"
    " bytes over the bandwidth."
)


def networks(arguments):
    """Name and flags of `simulate`."""
    line = {"bandwidth": arguments.bandwidth, "latency": arguments.latency}
    old = {"bandwidth": arguments.old_bandwidth, "latency": arguments.old_latency}
    return {
        f"sync, {arguments.bandwidth}B/s, {arguments.latency} s": {"master": "sync", **line},
        f"async, {arguments.bandwidth}B/s, {arguments.latency} s": {"master": "async", **line},
        f"sync, {arguments.old_bandwidth}B/s, {arguments.old_latency} s": {"master": "sync", **old},
    }


def size(text):
    """Bytes of a size such as 100M, as the simulator reads it."""
    power = "KMGT".find(text[-1:].upper())
    return float(text[:-1]) * 1024 ** (power + 1) if power >= 0 and text else float(text)


def real(result, bars, workers):
    """Figures of a real run."""
    of_workers_s = workers * solve_s(result)
    idle_s = catalogue.idle_at_ends(bars, workers)
    return {
        "wall_s": solve_s(result),
        "visits_s": visits_s(result),
        "in_visits": in_visits(result, workers),
        "idle_s_a_worker": idle_s / workers,
        "idle_share": idle_s / of_workers_s if of_workers_s else None,
        "bytes_read": sum(iteration["bytes_read"] for iteration in result["history"]["iterations"]),
    }


def replayed(row, bandwidth):
    """Figures of a replay: of one row of `simulate`."""
    return {
        "makespan_s": row["makespan_s"],
        "speedup": row["speedup"],
        "download_bytes": row["download_bytes"],
        "download_s": row["download_bytes"] / bandwidth,
        "idle_s_a_worker": row["end_idle_share"] * row["makespan_s"],
        "waiting_share": row["waiting_share"],
        "bottleneck": row["next_bottleneck"],
    }


def real_rows(of):
    heads = "schedule|time|time in visits|workers in visits|waiting for the last|of the workers' time|read".split("|")
    return heads, [
        [
            name,
            seconds(f["wall_s"]),
            seconds(f["visits_s"]),
            percent(f["in_visits"]),
            seconds(f["idle_s_a_worker"]),
            percent(f["idle_share"]),
            number(f["bytes_read"] / 1e6, " MB"),
        ]
        for name, f in of.items()
    ]


def replayed_rows(of):
    heads = "network|schedule|time|speedup|downloaded|that takes|waiting for the last|for the master|next bottleneck"
    return heads.split("|"), [
        [
            network,
            policy,
            seconds(f["makespan_s"]),
            f"{f['speedup']:.2f}",
            number(f["download_bytes"] / 1e6, " MB"),
            seconds(f["download_s"]),
            seconds(f["idle_s_a_worker"]),
            percent(f["waiting_share"]),
            f["bottleneck"],
        ]
        for (network, policy), f in of.items()
    ]


def beside(of):
    """The paper's table beside the replay of its setting, `of` by policy."""
    return ["", "the paper: download", "ours", "the paper: waiting for the last", "ours"], [
        [
            policy,
            number(paper.SCHEDULING[policy][0], " s", 0),
            seconds(of[policy]["download_s"]),
            number(paper.SCHEDULING[policy][1], " s", 0),
            seconds(of[policy]["idle_s_a_worker"]),
        ]
        for policy in POLICIES
    ]


def prose(arguments, of_real, of_paper):
    setting = SETTING.format(workers=arguments.workers, simulated=arguments.simulated, delta=paper.DELTA)
    by = lambda of, key: sorted(of, key=lambda name: of[name][key])
    least, fastest = by(of_paper, "download_bytes"), by(of_paper, "makespan_s")
    waits = by(of_paper, "idle_s_a_worker")
    lines = [
        (
            f"In the replay of the paper's setting {least[0]} downloads least"
            f" ({number(of_paper[least[0]]['download_bytes'] / 1e6)} MB) and {least[-1]} most"
            f" ({number(of_paper[least[-1]]['download_bytes'] / 1e6)} MB); {waits[0]} waits least for the last worker"
            f" ({seconds(of_paper[waits[0]]['idle_s_a_worker'])} each) and {waits[-1]} most"
            f" ({seconds(of_paper[waits[-1]]['idle_s_a_worker'])}); {fastest[0]} ends first."
        ),
        "In the paper WS downloads least and FFD most, FFD-WS waits least and WS most, and FFD-WS converges fastest.",
    ]
    idle = [f["idle_share"] for f in of_real.values() if f["idle_share"] is not None]
    if idle:
        lines.append(f"Real workers wait for the last one {percent(min(idle))} to {percent(max(idle))} of their time.")
    return [setting, " ".join(lines)]


def panel(policy, bars):
    """Of a timeline what is drawn: title, bars and ends of the first iterations."""
    drawn = [bar for bar in bars if bar[0] <= DRAWN]
    name = f"{policy} (delta {paper.DELTA})" if policy == "ffd-ws" else policy
    ends = [max(end for i, *_, end in drawn if i == number) for number in sorted({bar[0] for bar in drawn})]
    return name, [(lane, begin, end) for _, _, lane, begin, end in drawn], ends


def by_worker(boxes, bars):
    """Boxes of clusters with the lane that solved their group in the second iteration, or the first, for a colour."""
    iteration = min(DRAWN, max(bar[0] for bar in bars))
    lane_of = {group: lane for number, group, lane, *_ in bars if number == iteration}
    return [(*box[:4], lane_of.get(box[4], 0)) for box in boxes]


def captions(arguments):
    """What the pictures show: of the replay of the paper's setting, then of the real runs."""
    times = f"in the first {DRAWN} iterations, which end at the dotted lines; blank is waiting"
    plan = "Clusters from above, by the {} worker that solved their group in the second iteration"
    return [
        f"Visits of {arguments.simulated} replayed workers in the paper's setting {times}, for data too",
        plan.format("replayed"),
        f"Visits of {arguments.workers} real workers {times}",
        plan.format("real"),
    ]


def run(session, arguments):
    plots.pyplot()
    model = arguments.floor(session, arguments)
    partition = merged(session, model, arguments.groups)
    results, bars, replayed_bars, listed = {}, {}, {}, []
    lines = networks(arguments)
    of_paper_s = list(lines)[-1]
    for policy in POLICIES:
        options = solving(arguments, schedule=policy)
        results[policy] = session.solve(f"scheduling, {policy}", model, partition, options)
        bars[policy] = list(catalogue.timeline(results[policy]["store"]))
        listed += [line for line in commands(model, partition, options) if line not in listed]
    of_real = {policy: real(results[policy], bars[policy], arguments.workers) for policy in POLICIES}
    of_replays = {}
    for network, flags in lines.items():
        for policy in POLICIES:
            words = {"workers": arguments.simulated, "schedule": policy, "delta": paper.DELTA, **flags}
            row = session.simulate(results["ffd-ws"]["store"], words)["replays"][0]
            of_replays[network, policy] = replayed(row, size(flags["bandwidth"]))
            if network == of_paper_s:
                name = f"replayed-timeline-{policy}"
                replayed_bars[policy] = session.timeline(results["ffd-ws"]["store"], words, "scheduling", name)
                words["timeline"] = f"{name}.csv"
            listed += commands(model, partition, {}, replay=words)[-1:]
    for name, of in (("real", of_real), ("replayed", of_replays)):
        first = next(iter(of.values()))
        flat = [[*(key if isinstance(key, tuple) else (key,)), *f.values()] for key, f in of.items()]
        session.write_csv("scheduling", name, (["network"] if name == "replayed" else []) + ["schedule", *first], flat)
    for policy in POLICIES:
        heads = ["iteration", "group", "worker", "begin_s", "end_s"]
        session.write_csv("scheduling", f"timeline-{policy}", heads, bars[policy])
    boxes, drawn = catalogue.boxes(results["ffd-ws"]["store"]), []
    for prefix, of, begin in (("replayed-", replayed_bars, "download"), ("", bars, "visit")):
        drawn += [session.picture("scheduling", f"{prefix}{kind}") for kind in ("timeline", "plan")]
        panels = [panel(policy, of[policy]) for policy in POLICIES]
        plots.timelines(drawn[-2], panels, f"time since the first {begin} began [s]")
        plots.plans(drawn[-1], [(policy, by_worker(boxes, of[policy])) for policy in POLICIES])
    of_paper = {policy: of_replays[of_paper_s, policy] for policy in POLICIES}
    tables = [beside(of_paper), real_rows(of_real), replayed_rows(of_replays)]
    text = prose(arguments, of_real, of_paper), tables, list(zip(captions(arguments), drawn))
    publish(session, arguments, "scheduling", TITLE, text, (model.name, list(results.values()), listed))
