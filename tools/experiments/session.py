"""Runs the programs for the experiments, once each: what was measured stays in a file of JSON lines.

A record holds for its commit, machine and options alone. Stores have names of the same, so that a run that was broken
off goes on where it was.
"""

import csv
import datetime
import hashlib
import json
import os
import shutil
import subprocess
import sys
import time

import catalogue

sys.path.insert(0, os.path.join(os.path.dirname(os.path.dirname(os.path.abspath(__file__))), "bench"))
import judged  # noqa: E402  (lies beside this folder)
from judged import ROOT  # noqa: E402

NOT_CONVERGED = 3


class Failed(Exception):
    """What happened, and what to do."""

    def __init__(self, message, remedy):
        super().__init__(message)
        self.remedy = remedy


def flags(options):
    """Command-line words of options: None is left out."""
    return [word for name, value in options.items() if value is not None for word in (f"--{name}", f"{value}")]


def digest(*parts):
    return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()


def stamp_of_checkout(page):
    """The commit that is checked out, and whether it is all: only pages may differ."""
    places = [os.path.relpath(place, ROOT) for place in (page, os.path.splitext(page)[0])]
    outside = [f":(exclude){place}" for place in places if not place.startswith("..")]
    changed = judged.output("git", "status", "--porcelain", "--untracked-files=no", "--", ".", *outside)
    return judged.commit_of("HEAD") + (" and changes not committed" if changed else "")


def complaint(stderr):
    """Error and help of a program's last lines."""
    lines = [line for line in stderr.splitlines() if line.startswith(("error: ", "help: "))]
    found = dict(line.split(": ", 1) for line in lines)
    return found.get("error", stderr.strip()[-300:] or "it said nothing"), found.get(
        "help", "run it by itself to see why"
    )


class Session:
    """What is measured, where, and by which programs."""

    def __init__(self, folder, programs, page):
        self.folder, self.programs = os.path.abspath(folder), programs
        self.commit, self.machine = stamp_of_checkout(os.path.abspath(page)), judged.machine()
        self.records = os.path.join(self.folder, "results.jsonl")
        self.hashes = {}

    def say(self, text):
        print(f"{datetime.datetime.now():%H:%M:%S} {text}", file=sys.stderr, flush=True)

    def program(self, name):
        """Path of a program, and what tells it apart from one that was built otherwise."""
        path = os.path.abspath(self.programs[name])
        if not os.access(path, os.X_OK):
            flag = "binary" if name == "clerestory" else name
            raise Failed(f"{path}: no such program", f"build with `cargo build --release`, or name it with --{flag}")
        if name not in self.hashes:
            with open(path, "rb") as file:
                self.hashes[name] = hashlib.sha256(file.read()).hexdigest()[:12]
        return path, self.hashes[name]

    def run(self, name, *words):
        """JSON document of a program that ends with 0, or with 3: not converged."""
        path, _ = self.program(name)
        command = [path, *words, "--json"] + (["--progress", "none"] if name == "clerestory" else [])
        # No settings but those on the command line.
        bare = {key: value for key, value in os.environ.items() if not key.startswith("CLERESTORY_")}
        done = subprocess.run(command, cwd=self.folder, env=bare, capture_output=True, text=True)
        if done.returncode not in (0, NOT_CONVERGED) or not done.stdout.strip():
            message, remedy = complaint(done.stderr)
            raise Failed(f"{name} {words[0]} ended with {done.returncode}: {message}", remedy)
        return json.loads(done.stdout)

    def measured(self, what, make, is_valid=lambda: True):
        """What is known of `what`, or else what `make` gives; kept under commit, machine and `what`."""
        key = {"commit": self.commit, "machine": self.machine, "what": what}
        for record in reversed(judged.kept(self.records)):
            if all(record.get(name) == value for name, value in key.items()) and is_valid():
                return record["result"]
        result = make()
        judged.keep(self.records, {**key, "date": f"{datetime.date.today()}", "result": result})
        return result

    def store(self, model, *parts):
        name = digest(self.commit, self.program("clerestory")[1], model.key, *parts)[:12]
        return os.path.join(self.folder, "stores", f"{model.slug}-{name}.clr")

    def stage(self, store, name, *words):
        """What a stage says of a store; kept, so that a run that goes on later knows what it took."""
        what = {"stage": name, "store": os.path.basename(store)}
        make = lambda: self.run("clerestory", name, store, *words)
        return self.measured(what, make, lambda: catalogue.has_stage(store, name))

    def prepare(self, model, store, memory=None):
        """Ingests and looks for what is visible; gives what both say."""
        os.makedirs(os.path.dirname(store), exist_ok=True)
        more = flags({"memory": memory})
        return {
            "ingest": self.stage(store, "ingest", *model.files, *flags({"units": model.units}), *more),
            "visibility": self.stage(store, "visibility", *more),
        }

    def prepared(self, model):
        """A store that is not solved, and what its stages say: for partitions alone."""
        store = self.store(model, "prepared")
        what = {"prepared": model.key, "binary": self.program("clerestory")[1]}
        make = lambda: self.prepare(model, store)
        return store, self.measured(what, make, lambda: os.path.exists(store))

    def solve(self, name, model, partition, options, keep=True):
        """Solves a model, unless that is known; gives {ingest, visibility, partition, run, history, store, reuse?}.

        `partition` are flags of that verb, `options` those of `run`. `keep`: the store is needed afterwards.
        """
        store = self.store(model, partition, options)
        binary = self.program("clerestory")[1]
        what = {"solve": model.key, "binary": binary, "partition": partition, "options": options}

        def make():
            self.say(f"{name}: solving {model.name}, {' '.join(flags({**partition, **options}))}")
            begun, memory = time.monotonic(), options.get("memory")
            when = {"load": round(os.getloadavg()[0], 1), "date": f"{datetime.date.today()}"}
            stages = {**when, **self.prepare(model, store, memory)}
            more = flags({**partition, "memory": memory})
            stages["partition"] = self.stage(store, "partition", *more)
            stages["run"] = self.run("clerestory", "run", "--store", store, *flags(options))
            stages["history"] = catalogue.history(store)
            self.say(f"{name}: done in {time.monotonic() - begun:.1f} s")
            return stages

        result = self.measured(what, make, lambda: not keep or os.path.exists(store))
        if not keep:
            shutil.rmtree(store, ignore_errors=True)
        return {**result, "store": store}

    def simulate(self, store, options):
        """What `simulate` finds in a store that has been solved."""
        binary = self.program("simulate")[1]
        what = {"simulate": os.path.basename(store), "binary": binary, "options": options}
        return self.measured(what, lambda: self.run("simulate", store, *flags(options)))

    def timeline(self, store, options, experiment, name):
        """Visits of a replay as (iteration, group, worker, begin s, end s); `simulate` writes them as CSV."""
        path = os.path.join(self.place(experiment), f"{name}.csv")
        self.run("simulate", store, *flags({**options, "timeline": path}))
        with open(path, newline="") as file:
            rows = list(csv.DictReader(file))
        whole, times = ("iteration", "group", "worker"), ("begin_s", "end_s")
        return [(*(int(row[key]) for key in whole), *(float(row[key]) for key in times)) for row in rows]

    def place(self, experiment):
        """Folder of an experiment."""
        folder = os.path.join(self.folder, experiment)
        os.makedirs(folder, exist_ok=True)
        return folder

    def write_csv(self, experiment, name, heads, rows):
        with open(os.path.join(self.place(experiment), f"{name}.csv"), "w", newline="") as file:
            csv.writer(file, lineterminator="\n").writerows([heads, *rows])

    def picture(self, experiment, name):
        """Where a picture goes."""
        return os.path.join(self.place(experiment), f"{name}.svg")


def commands(model, partition, options, **simulations):
    """The commands of a run as a reader would type them."""
    store = f"{model.slug}.clr"
    units = flags({"units": model.units})
    lines = [
        ["clerestory ingest", store, model.shown, *units],
        ["clerestory visibility", store],
        ["clerestory partition", store, *flags(partition)],
        ["clerestory run --store", store, *flags(options)],
    ]
    lines += [["simulate", store, *flags(words)] for words in simulations.values()]
    return [" ".join(line) for line in lines]
