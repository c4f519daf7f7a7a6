#!/usr/bin/env python3
"""Runs the experiments of the paper, and one of ours, on any model: CSV, pictures, and docs/experiments.md.

Each experiment solves what it needs, once: results stay in results.jsonl of the folder, for their commit, machine
and options, so that a call that was broken off goes on where it was. It writes CSV and SVG into the folder, and its
section of the page, which names the commit that is checked out. Pictures need matplotlib.
"""

import argparse
import os
import sys

import five_floors
import granularity
import grouping
import memory
import models
import paper
import partition
import scheduling
import speedup
from page import ORDER
from session import ROOT, Failed, Session, judged

EXPERIMENTS = {
    "grouping": (grouping.run, "grouped against ungrouped iteration on one worker (6.1, Figure 8)"),
    "partition": (partition.run, "four ways to group clusters (6.2, Figures 7 and 9)"),
    "granularity": (granularity.run, "how many groups (6.3, Figure 10)"),
    "scheduling": (scheduling.run, "which group a free worker takes (6.4, Figures 11 and 12)"),
    "speedup": (speedup.run, "what more workers bring (6.5, Figure 13)"),
    "five-floors": (five_floors.run, "five floors of a large building (6.6)"),
    "memory": (memory.run, "memory and time per patch against size (ours)"),
}

EXAMPLES = """\
Models: the given files; else the paper's own where they lie beside the project (../shared/scenes/soda-floor5,
soda-hall); else buildings as large, made on the spot.

Examples:
  experiments.py grouping
  experiments.py partition --model data/office.obj --quality preview --groups 16
  experiments.py speedup --binary ~/bin/clerestory --simulate ~/bin/simulate
  experiments.py memory --floors 1 --rooms-per-floor 8 --sizes 1,2,4 --quality preview
  experiments.py all --quality draft -o /tmp/experiments
"""


def numbers(text, of=int):
    return [of(word) for word in text.split(",")]


def sizes(text):
    return numbers(text, float)


def shared_flags(name):
    parser = argparse.ArgumentParser(add_help=False)
    add = parser.add_argument
    built = os.path.join(os.environ.get("CARGO_TARGET_DIR", os.path.join(ROOT, "target")), "release")
    for flag, name in (("--binary", "clerestory"), ("--building", "building"), ("--simulate", "simulate")):
        add(flag, default=os.path.join(built, name), metavar="FILE", help=f"{name} [default: target/release/{name}]")
    # Sizes are those of generated buildings.
    if name != "memory":
        add("--model", nargs="+", metavar="OBJ", help="files of one model [default: see below]")
        add("--units", help="of the given model: m, cm, mm, in, ft [default: m]")
    page = os.path.join(ROOT, "docs", "experiments.md")
    add("-o", "--output", default="experiments", metavar="DIR", help="stores, CSV, SVG [default: experiments]")
    add(
        "--page",
        default=page,
        metavar="FILE",
        help="[default: docs/experiments.md]; pictures go into a folder beside it",
    )
    error = parser.add_mutually_exclusive_group()
    error.add_argument("--quality", default="draft", help="preview, draft, standard or final [default: draft]")
    error.add_argument("--tolerance", help="error to be met, instead of --quality")
    add("--max-iterations", type=int, metavar="N", help="[default: 200; grouping: the paper's 3 and 4]")
    add("--memory", metavar="SIZE", help="of each process [default: 512M]")
    add(
        "--workers", type=int, default=2, metavar="P", help="real workers, except for grouping and speedup [default: 2]"
    )
    return parser


def groups(parser, default=paper.GROUPS):
    shown = "from the model" if default is None else default
    parser.add_argument("--groups", type=int, default=default, metavar="N", help=f"least number [default: {shown}]")


def network(parser):
    parser.add_argument("--bandwidth", default="100M", metavar="BYTES_PER_S", help="of replays [default: 100M]")
    parser.add_argument("--latency", default="0.001", metavar="S", help="of replays [default: 0.001]")


def own_flags(name, parser):
    """Flags of one experiment, or of all."""
    is_one_of = lambda *names: name in (*names, "all")
    if is_one_of("grouping", "partition", "scheduling", "speedup"):
        groups(parser)
    elif name in ("five-floors", "memory"):
        groups(parser, None)
    add = parser.add_argument
    if is_one_of("partition"):
        add("--plan-groups", type=int, default=paper.PLAN_GROUPS, metavar="N", help="in the plans [default: 16]")
    if is_one_of("granularity"):
        listed = ",".join(f"{groups}" for groups in paper.GRANULARITY)
        add(
            "--numbers", type=numbers, default=paper.GRANULARITY, metavar="N,...", help=f"of groups [default: {listed}]"
        )
    if is_one_of("scheduling", "speedup"):
        network(parser)
    if is_one_of("scheduling"):
        add("--simulated", type=int, default=paper.WORKERS, metavar="P", help="workers of replays [default: 8]")
        add("--old-bandwidth", default="1M", metavar="BYTES_PER_S", help="as the paper's Ethernet had [default: 1M]")
        add("--old-latency", default="0.01", metavar="S", help="[default: 0.01]")
    if is_one_of("speedup"):
        powers = [2**i for i in range(11)]
        add("--real", type=numbers, default=[1, 2], metavar="P,...", help="workers of real runs [default: 1,2]")
        add("--replayed", type=numbers, default=powers, metavar="P,...", help="of replays [default: 1,2,4,...,1024]")
    if is_one_of("five-floors"):
        add("--audit", type=int, default=256, metavar="N", help="places audited at the end [default: 256]")
    if is_one_of("memory"):
        add(
            "--sizes",
            type=sizes,
            default=[0.25, 0.5, 1, 2, 4, 10],
            metavar="X,...",
            help="[default: 0.25,0.5,1,2,4,10]",
        )
        add("--floors", type=int, default=5, metavar="N", help="of size 1 [default: 5]")
        add("--rooms-per-floor", type=int, default=50, metavar="N", help="of size 1 [default: 50]")


def parse(words=None):
    shape = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, epilog=EXAMPLES, formatter_class=shape)
    verbs = parser.add_subparsers(dest="experiment", required=True, metavar="EXPERIMENT")
    for name in [*ORDER, "all"]:
        what = EXPERIMENTS[name][1] if name in EXPERIMENTS else "one after the other"
        verb = verbs.add_parser(
            name,
            help=what,
            description=what,
            epilog=EXAMPLES,
            formatter_class=shape,
            parents=[shared_flags(name)],
            allow_abbrev=False,
        )
        own_flags(name, verb)
    return parser.parse_args(words)


def run(session, arguments):
    """Runs what is asked for; gives how many experiments failed."""
    arguments.floor = models.floor
    asked = ORDER if arguments.experiment == "all" else [arguments.experiment]
    failed = 0
    # Sizes of groups of these two follow from the model.
    of_all = arguments.__dict__.get("groups")
    for name in asked:
        if arguments.experiment == "all":
            arguments.groups = None if name in ("five-floors", "memory") else of_all
        session.say(f"{name} begins")
        try:
            EXPERIMENTS[name][0](session, arguments)
        except Failed as error:
            failed += 1
            print(f"error: {name}: {error}\nhelp: {error.remedy}", file=sys.stderr)
    return failed


def main(words=None):
    arguments = parse(words)
    judged.end_on_sigterm()
    programs = {"clerestory": arguments.binary, "building": arguments.building, "simulate": arguments.simulate}
    os.makedirs(arguments.output, exist_ok=True)
    return int(run(Session(arguments.output, programs, arguments.page), arguments) > 0)


if __name__ == "__main__":
    try:
        sys.exit(main())
    except KeyboardInterrupt:
        print("error: interrupted\nhelp: the same command goes on from here", file=sys.stderr)
        sys.exit(130)
