#!/usr/bin/env python3
"""Doubles and halves each chosen number of `src/transport/numbers.rs`, and writes what that does into docs/numbers.md.

    chosen_numbers.py SCENE.obj[:TOLERANCE] ...

In a copy of the commit every number is looked up once a process, so that one build does for all. A model is solved with each,
and its stored light is audited at 32,768 places. What counts is CPU time times squared error, since the error falls with the
root of what is spent: 1.1 says that the same error costs a tenth more. Nothing else may run meanwhile.
"""

import argparse
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile

PLACES = "32768"
NUMBER = re.compile(r"((?:^///[^\n]*\n)+)^pub const ([A-Z_]+): (f64|u16|u32|u64|usize) = ([^;]+);", re.M)
# Sections of the file that no run of a model depends on but by rounding.
OTHERS = ("Points of `sample`", "Rounding")
LOOKED_UP = """
/// A number times what the environment says of it.
macro_rules! tuned {
    ($name:ident $kind:ty) => {{
        static NUMBER: std::sync::OnceLock<$kind> = std::sync::OnceLock::new();
        *NUMBER.get_or_init(|| $crate::transport::numbers::scaled(stringify!($name), $crate::transport::numbers::$name as f64) as $kind)
    }};
}
pub(crate) use tuned;

/// A number times what the environment says of it.
pub fn scaled(name: &str, value: f64) -> f64 {
    let of = std::env::var("CLERESTORY_NUMBER").unwrap_or_default();
    of.strip_prefix(name).and_then(|rest| rest.strip_prefix('=')?.parse::<f64>().ok()).map_or(value, |factor| factor * value)
}
"""


def numbers(text):
    """Name, type, value and first sentence of each number that a run depends on."""
    found = []
    for section in re.split(r"^// ", text, flags=re.M)[1:]:
        if section.startswith(OTHERS):
            continue
        for doc, name, kind, value in NUMBER.findall(section):
            said = " ".join(line[3:].strip() for line in doc.splitlines())
            found.append((name, kind, value, said))
    return found


def looked_up(tree, names):
    """Rewrites the copy so that the numbers are looked up, except in array lengths and constants."""
    kinds = {name: kind for name, kind, _, _ in names}

    def rewrite(match):
        return f"numbers::tuned!({match[1]} {kinds[match[1]]})" if match[1] in kinds else match[0]

    for folder, _, files in os.walk(f"{tree}/src"):
        for name in files:
            path = f"{folder}/{name}"
            with open(path) as f:
                text = f.read()
            if not name.endswith(".rs") or "numbers::" not in text or name == "numbers.rs":
                continue
            lines = text.split("\n")
            for i, line in enumerate(lines):
                if not re.match(r"\s*(pub )?const |.*; numbers::|.*numbers::\w+ \*? ?numbers", line):
                    lines[i] = re.sub(r"numbers::([A-Z_]+)", rewrite, line)
            with open(path, "w") as f:
                f.write("\n".join(lines))
    with open(f"{tree}/src/transport/numbers.rs", "a") as f:
        f.write(LOOKED_UP)


def cost(program, scene, tolerance, change, folder):
    """CPU time times squared error, of a model solved with a changed number."""
    store = f"{folder}/model.clr"
    shutil.rmtree(store, ignore_errors=True)
    environment = dict(os.environ, CLERESTORY_NUMBER=change)
    run = [program, "run", scene, "--store", store, "--workers", "2", "--audit", "0", "--tolerance", str(tolerance), "-q", "--json"]
    solved = subprocess.run(run, env=environment, capture_output=True, text=True)
    if solved.returncode not in (0, 3):
        return None, f"exit {solved.returncode}"
    spent_s = json.loads(solved.stdout)["cpu_s"]
    audit = [program, "audit", store, "--places", PLACES, "--json", "-q"]
    found = subprocess.run(audit, capture_output=True, text=True)
    if found.returncode not in (0, 3):
        return None, f"audit: exit {found.returncode}"
    return spent_s * json.loads(found.stdout)["audited_nrms"] ** 2, "not converged" if solved.returncode == 3 else ""


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="+", metavar="SCENE.obj[:TOLERANCE]")
    parser.add_argument("--only", help="numbers, comma-separated")
    options = parser.parse_args()
    root = os.path.abspath(f"{os.path.dirname(__file__)}/../..")
    commit = subprocess.check_output(["git", "-C", root, "rev-parse", "--short=12", "HEAD"], text=True).strip()
    scenes = [(s.split(":")[0], float(s.split(":")[1]) if ":" in s else 0.02) for s in options.scenes]
    with tempfile.TemporaryDirectory() as folder:
        tree = f"{folder}/copy"
        subprocess.run(["git", "clone", "-q", root, tree], check=True)
        with open(f"{tree}/src/transport/numbers.rs") as f:
            chosen = numbers(f.read())
        if options.only:
            chosen = [number for number in chosen if number[0] in options.only.split(",")]
        looked_up(tree, chosen)
        target = os.environ.get("CARGO_TARGET_DIR", f"{tree}/target")
        subprocess.run(["cargo", "build", "--release", "-q"], cwd=tree, env=dict(os.environ, RUSTFLAGS="-Awarnings"), check=True)
        program = f"{target}/release/clerestory"
        rows = []
        before = [cost(program, scene, tolerance, "", folder)[0] for scene, tolerance in scenes]
        for name, _, value, said in chosen:
            cells = []
            for factor in (0.5, 2.0):
                for (scene, tolerance), usual in zip(scenes, before):
                    now, why = cost(program, scene, tolerance, f"{name}={factor}", folder)
                    cells.append(f"{now / usual:.2f}{' (' + why + ')' if why else ''}" if now else why)
            rows.append(f"| `{name}` | {value} | {' | '.join(cells)} | {said} |")
            print(rows[-1], flush=True)
    names = [os.path.splitext(os.path.basename(scene))[0] + f" {100 * tolerance:g} %" for scene, tolerance in scenes]
    heads = [f"{what}: {name}" for what in ("halved", "doubled") for name in names]
    page = f"""# Chosen numbers

Written by `tools/bench/chosen_numbers.py`: nothing in here is typed, and all of it is of commit {commit}. Each number of
`src/transport/numbers.rs` that a run depends on, halved and doubled: CPU time times squared error (audited at {PLACES} places),
over that of the number as it is. 1.1: the same error costs a tenth more. Luck of a run and its audit make up about 0.1.

| number | value | {" | ".join(heads)} | what it is |
|{" --- |" * (3 + len(heads))}
""" + "\n".join(rows) + "\n"
    if not options.only:
        with open(f"{root}/docs/numbers.md", "w") as f:
            f.write(page)


if __name__ == "__main__":
    sys.exit(main())
