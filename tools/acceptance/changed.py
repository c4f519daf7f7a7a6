#!/usr/bin/env python3
"""Stops runs at random instants and goes on with something else: changed.py MODEL.obj [--kills 100] [--interrupts 50]

Every stopped run is rerun with another quality, an edited MTL or `--emit both`. The rerun must end as a run of that
kind in a fresh store does (0, or 3 where that is 3), its light must be that store's: the same bytes, or the same total
within half of the tolerance and the same irradiance at sensors within twice the tolerance (nRMS), and `check` must be
clean.

CLERESTORY names the program. One line per case; exit code 1 if one fails.
"""

import argparse
import csv
import io
import os
import random
import re
import shutil
import signal
import subprocess
import sys
import tempfile

PROGRAM = os.environ.get("CLERESTORY", "clerestory")
TOLERANCE = {"preview": 0.1, "draft": 0.05}
SENSORS = 60


def darker(text):
    """The MTL with the emission of its first lamp at a third."""
    third = lambda found: "Ke " + " ".join(str(float(word) / 3) for word in found[1].split())
    return re.sub(r"^\s*Ke\s+(.*)$", third, text, count=1, flags=re.M)


def glowing(text):
    """The MTL with a first material that did not emit and now does."""
    blocks = re.split(r"(?m)^(?=newmtl )", text)
    dark = next(i for i, block in enumerate(blocks) if block.startswith("newmtl") and not re.search(r"(?m)^\s*Ke", block))
    blocks[dark] = blocks[dark].rstrip() + "\nKe 0.5 0.5 0.5\n\n"
    return "".join(blocks)


CHANGES = {
    "draft": (["--quality", "draft"], None),
    "darker lamp": (["--quality", "preview"], darker),
    "new lamp": (["--quality", "preview"], glowing),
    "--emit both": (["--quality", "preview", "--emit", "both"], None),
}


def start(model, store, flags):
    command = [PROGRAM, "run", model, "--store", store, "-q", "--workers", "2", *flags]
    return subprocess.Popen(command, start_new_session=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def copy(model, folder, change=None):
    """The model and its MTL in a folder of their own, the MTL changed."""
    os.makedirs(folder, exist_ok=True)
    for ending in (".obj", ".mtl"):
        source = os.path.splitext(model)[0] + ending
        with open(source) as file:
            text = file.read()
        with open(os.path.join(folder, os.path.basename(source)), "w") as file:
            file.write(change(text) if change and ending == ".mtl" else text)
    return os.path.join(folder, os.path.basename(model))


def exported(store):
    run = subprocess.run([PROGRAM, "export", store, "-o", "-", "-q"], check=True, capture_output=True, text=True)
    return run.stdout


def rows(text):
    return list(csv.DictReader(io.StringIO(text)))


def total(leaves):
    return sum(float(leaf["area_m2"]) * float(leaf["irradiance_g_w_m2"]) for leaf in leaves)


def write_points(path, leaves):
    with open(path, "w") as file:
        file.write("x,y,z,nx,ny,nz\n")
        for leaf in leaves:
            file.write(",".join(leaf[key] for key in ("x", "y", "z", "nx", "ny", "nz")) + "\n")


def sampled(store, points):
    run = subprocess.run([PROGRAM, "sample", store, "--points", points, "-o", "-", "-q"], check=True, capture_output=True, text=True)
    return [float(row["irradiance_g_w_m2"] or "nan") for row in rows(run.stdout)]


class Fresh:
    """What a fresh store gives after a change."""

    def __init__(self, model, work, name):
        self.flags, change = CHANGES[name]
        folder = os.path.join(work, name.replace(" ", "_"))
        store = os.path.join(folder, "fresh.clr")
        self.code = start(copy(model, folder, change), store, self.flags).wait()
        self.text = exported(store)
        leaves = rows(self.text)
        self.total = total(leaves)
        self.points = os.path.join(folder, "points.csv")
        lit = [leaf for leaf in leaves if float(leaf["irradiance_g_w_m2"]) > 0]
        write_points(self.points, random.Random(1).sample(lit, min(SENSORS, len(lit))))
        self.sensors = sampled(store, self.points)
        self.tolerance = TOLERANCE[self.flags[1]]

    def verdict(self, store):
        """What is wrong with a store, if anything."""
        text = exported(store)
        if text == self.text:
            return None, "same bytes"
        off = total(rows(text)) / self.total - 1
        pairs = list(zip(sampled(store, self.points), self.sensors))
        nrms = (sum((a - b) ** 2 for a, b in pairs) / sum(b * b for _, b in pairs)) ** 0.5
        words = f"total {100 * off:+.2f} %, sensors {100 * nrms:.1f} %"
        return (None if abs(off) < 0.5 * self.tolerance and nrms < 2 * self.tolerance else "another light"), words


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("model")
    parser.add_argument("--kills", type=int, default=100)
    parser.add_argument("--interrupts", type=int, default=50)
    parser.add_argument("--seed", type=int, default=random.randrange(10**6))
    options = parser.parse_args()
    print("seed", options.seed)
    chance = random.Random(options.seed)
    failed = 0
    with tempfile.TemporaryDirectory() as work:
        fresh = {name: Fresh(options.model, work, name) for name in CHANGES}
        calm = start(copy(options.model, os.path.join(work, "calm")), os.path.join(work, "calm/s.clr"), ["--quality", "preview"])
        ticks = 0
        while calm.poll() is None:
            ticks += 1
            try:
                calm.wait(0.01)
            except subprocess.TimeoutExpired:
                pass
        signals = [signal.SIGKILL] * options.kills + [signal.SIGINT] * options.interrupts
        for number, sent in enumerate(signals):
            folder = os.path.join(work, "stopped")
            store = os.path.join(folder, "s.clr")
            name = list(CHANGES)[number % len(CHANGES)]
            run = start(copy(options.model, folder), store, ["--quality", "preview"])
            try:
                run.wait(chance.uniform(0, 0.01 * ticks))
            except subprocess.TimeoutExpired:
                os.killpg(run.pid, sent)
                run.wait()
            flags, change = CHANGES[name]
            code = start(copy(options.model, folder, change), store, flags).wait()
            wrong, words = (f"exit {code} where a fresh store gives {fresh[name].code}", "") if code != fresh[name].code else fresh[name].verdict(store)
            if not wrong and subprocess.run([PROGRAM, "check", store, "-q"]).returncode != 0:
                wrong = "check finds damages"
            failed += bool(wrong)
            print("FAIL " if wrong else "pass ", f"{number + 1} {sent.name}, then {name}: {wrong or ''} {words}", flush=True)
            shutil.rmtree(folder)
    print(f"{len(signals) - failed} of {len(signals)} pass")
    return int(failed > 0)


if __name__ == "__main__":
    sys.exit(main())
