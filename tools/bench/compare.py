#!/usr/bin/env python3
"""Builds two commits and solves scenes with them in turns, A B A B: what got slower, and what less accurate.

A table per scene: both runs of each, and the ratio of their means. B is worse in a figure where its mean is above that
of A by more than what A's runs differ by and 5 % of it. Exit code 1 where it is slower (CPU or wall), 2 where a scene
failed; of entries and errors the table tells alone.
"""

import argparse
import os
import shutil
import subprocess
import sys
import tempfile

import judged
from judged import ROOT, number, percent, table

TURNS = 2
MARGIN = 0.05

# Name, key of what bake.py says, how it is written, what B is where it is larger.
FIGURES = [
    ("CPU", "cpu_s", lambda value: number(value, " s", 2), "slower"),
    ("wall", "wall_s", lambda value: number(value, " s", 2), "slower"),
    ("entries", "links", lambda value: number(value, "", 0), "more"),
    ("estimated", "estimated_nrms", percent, "less accurate"),
    ("stored nRMS", "nrms", percent, "less accurate"),
]


def is_worse(a, b):
    mean = sum(a) / len(a)
    return sum(b) / len(b) > mean + (max(a) - min(a)) + MARGIN * mean


def compare(a, b):
    """Rows of a scene's table from what bake.py said of each run, and whether B is slower."""
    rows, slower = [], False
    for name, key, written, word in FIGURES:
        of_a, of_b = ([run.get(key) for run in runs] for runs in (a, b))
        if None in of_a + of_b:
            continue
        worse, of = is_worse(of_a, of_b), sum(of_a)
        slower |= worse and word == "slower"
        ratio = f"{sum(of_b) / of:.3f}" if of else "-"
        rows.append([name, *map(written, of_a + of_b), ratio, word if worse else ""])
    return rows, slower


def build(commit, folder):
    """The program of a commit: from an earlier call, or built in a worktree of its own."""
    binary = os.path.join(folder, "bin", commit)
    if os.path.exists(binary):
        return binary
    os.makedirs(os.path.dirname(binary), exist_ok=True)
    with tempfile.TemporaryDirectory(prefix="compare-") as parent:
        worktree = os.path.join(parent, "clerestory")
        subprocess.run(["git", "worktree", "add", "--quiet", "--detach", worktree, commit], cwd=ROOT, check=True)
        try:
            cargo = lambda *words: subprocess.run(
                ["cargo", *words, "--release", "--target-dir", folder], cwd=worktree, check=True
            )
            cargo("build", "--quiet", "--locked", "--bin", "clerestory")
            shutil.copy(os.path.join(folder, "release", "clerestory"), binary + ".part")
            os.rename(binary + ".part", binary)
            # Dependencies stay; what belongs to the worktree is of no use any more.
            cargo("clean", "--quiet", "--package", "clerestory")
        finally:
            subprocess.run(["git", "worktree", "remove", "--force", worktree], cwd=ROOT, check=True)
    return binary


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("a", metavar="A", help="commit that is compared with")
    parser.add_argument("b", metavar="B", help="commit that is judged")
    judged.add_arguments(parser, "cornell-box,office,soda-floor5")
    target = os.path.join(ROOT, "target", "compare")
    parser.add_argument("--target", default=target, help="kept between calls [default: target/compare]")
    arguments = parser.parse_args()
    judged.end_on_sigterm()
    commits = [judged.commit_of(revision) for revision in (arguments.a, arguments.b)]
    binaries = [build(commit, os.path.abspath(arguments.target)) for commit in commits]
    print(f"A: {judged.output('git', 'log', '-1', '--format=%h %s', commits[0])}")
    print(f"B: {judged.output('git', 'log', '-1', '--format=%h %s', commits[1])}")
    heads = ["figure"] + ["A"] * TURNS + ["B"] * TURNS + ["B / A", "B is"]
    any_slower = False
    for scene in arguments.scenes.split(","):
        runs = [[], []]
        for turn in range(2 * TURNS):
            try:
                runs[turn % 2].append(judged.bake(arguments, scene, binaries[turn % 2]))
            except (RuntimeError, subprocess.TimeoutExpired) as error:
                print(f"{'AB'[turn % 2]}: {error}", file=sys.stderr)
                return 2
        rows, slower = compare(*runs)
        any_slower |= slower
        print(f"\n{scene}\n\n{table(heads, rows)}", flush=True)
    return int(any_slower)


if __name__ == "__main__":
    sys.exit(main())
