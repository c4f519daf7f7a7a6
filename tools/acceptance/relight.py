#!/usr/bin/env python3
"""Changes the lamps and materials of a solved model again and again: relight.py MODEL.obj [--quality draft]

The model's first emitting material is split in three by its faces in turn, so that a third of the lamps can be switched. In one
store, one after the other: a third off, half off, some of the rest dimmed, all off, all on, every other material glows in turn, `--emit both` and back.
After each the light is compared with that of a fresh store: total within 1 %, sensors (a grid of places of the leaves) within
5 % of each (of the mean where they are dimmer), energy balance within 1 %; and the time is set beside a fresh run's.

CLERESTORY names the program. One line per case; exit code 1 if one fails.
"""

import argparse
import json
import os
import re
import subprocess
import sys
import tempfile
import time

from changed import PROGRAM, exported, rows, sampled, total, write_points

SENSORS = 100


def parted(obj, lamp):
    """The OBJ with the lamp's faces given to LAMP.0, LAMP.1, ... in turn, by object."""
    count, lines = 0, []
    for line in obj.splitlines():
        if line.split() == ["usemtl", lamp]:
            lines.append(f"usemtl {lamp}.{count % 6}")
            count += 1
        else:
            lines.append(line)
    return "\n".join(lines) + "\n"


def materials(blocks, lamp, off=(), dim=(), glowing=None):
    text = ""
    for name, body in blocks:
        if name == lamp:
            dark = re.sub(r"(?m)^\s*Ke.*\n?", "", body)
            half = re.sub(r"(?m)^\s*Ke\s+(.*)$", lambda m: "Ke " + " ".join(str(float(x) / 2) for x in m[1].split()), body)
            text += "".join(f"newmtl {lamp}.{i}\n{dark if i in off else half if i in dim else body}\n" for i in range(6))
        else:
            text += f"newmtl {name}\n{body}\n" + ("Ke 2 1.5 1\n" if name == glowing else "")
    return text


def run(model, store, flags):
    begun = time.monotonic()
    done = subprocess.run([PROGRAM, "run", model, "--store", store, "-q", "--json", "--workers", "2", *flags], capture_output=True, text=True)
    return done.returncode, time.monotonic() - begun, json.loads(done.stdout or "{}")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("model")
    parser.add_argument("--quality", default="draft")
    options = parser.parse_args()
    with open(options.model) as file:
        obj = file.read()
    with open(os.path.splitext(options.model)[0] + ".mtl") as file:
        blocks = [tuple(block.split("\n", 1)) for block in re.split(r"(?m)^newmtl ", file.read())[1:]]
    lamp = next(name for name, body in blocks if re.search(r"(?m)^\s*Ke\s", body))
    quality = ["--quality", options.quality]
    states = [
        ("all on", {}, []),
        ("a third off", {"off": (0, 3)}, []),
        ("half off", {"off": (0, 2, 4)}, []),
        ("half on, a third of all at half of its power", {"off": (0, 2, 4), "dim": (1, 3)}, []),
        ("all off", {"off": range(6)}, []),
        ("all on again", {}, []),
        *((f"{name} glows", {"glowing": name}, []) for name, _ in blocks if name != lamp),
        ("--emit both", {}, ["--emit", "both"]),
        ("and back", {}, ["--emit", "front"]),
    ]
    failed = 0
    with tempfile.TemporaryDirectory() as work:
        model = os.path.join(work, os.path.basename(options.model))
        mtl = os.path.splitext(model)[0] + ".mtl"
        with open(model, "w") as file:
            file.write(parted(obj, lamp))
        for number, (name, change, flags) in enumerate(states):
            with open(mtl, "w") as file:
                file.write(materials(blocks, lamp, **change))
            fresh = os.path.join(work, f"fresh{number}.clr")
            old = os.path.join(work, "old.clr")
            expected_code, fresh_s, _ = run(model, fresh, quality + flags)
            code, again_s, said = run(model, old, quality + flags)
            leaves = rows(exported(fresh))
            lit = [leaf for leaf in leaves if float(leaf["irradiance_g_w_m2"]) > 0]
            points = os.path.join(work, "points.csv")
            write_points(points, lit[:: max(1, len(lit) // SENSORS)])
            expected = total(leaves)
            found = total(rows(exported(old)))
            off = found / expected - 1 if expected else found
            pairs = list(zip(sampled(old, points), sampled(fresh, points))) if lit else []
            mean = sum(b for _, b in pairs) / max(1, len(pairs))
            worst = max((abs(a - b) / max(b, mean) for a, b in pairs), default=0)
            balance = said.get("energy_balance") or 0
            wrong = code != expected_code or abs(off) > 0.01 or worst > 0.05 or balance > 0.01
            failed += wrong
            print(
                "FAIL " if wrong else "pass ",
                f"{name}: exit {code} ({expected_code}), total {100 * off:+.2f} %, worst of {len(pairs)} sensors {100 * worst:.1f} %,"
                f" balance {100 * balance:.2f} %, {again_s:.1f} s ({fresh_s:.1f} s fresh)",
                flush=True,
            )
    print(f"{len(states) - failed} of {len(states)} pass")
    return int(failed > 0)


if __name__ == "__main__":
    sys.exit(main())
