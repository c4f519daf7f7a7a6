"""Models of the experiments: given files, the paper's own where they lie beside the project, or generated ones."""

import glob
import hashlib
import os
import shutil
import subprocess

from session import ROOT, Failed, complaint

# Beside the project, never in it.
SCENES = os.path.join(ROOT, "..", "shared", "scenes")

# What the notice of the paper's own models wants them to be called; it stands at the head of each file.
WALKTHRU = "U.C. Berkeley Soda Hall WALKTHRU Model"
HEAD_BYTES = 1 << 16


class Model:
    """OBJ files that are one model."""

    def __init__(self, files, units=None, name=None, shown=None):
        self.files, self.units = [os.path.abspath(file) for file in files], units
        for file in self.files:
            if not os.path.isfile(file):
                raise Failed(f"{file}: no such file", "give OBJ files with --model")
        first = os.path.splitext(os.path.basename(self.files[0]))[0]
        self.slug = name or first
        self.shown = shown or " ".join(os.path.basename(file) for file in self.files)
        self.is_walkthru = any(is_walkthru(file) for file in self.files)
        self.name = f"{self.slug} ({WALKTHRU})" if self.is_walkthru else self.slug
        # What tells it apart from others; no paths, which are the machine's.
        self.key = [self.slug, units, [[os.path.basename(file), content(file)] for file in self.files]]


def content(file):
    """Hash of a model's file and of the materials that lie beside it under its name."""
    found = hashlib.sha256()
    for path in (file, os.path.splitext(file)[0] + ".mtl"):
        if os.path.isfile(path):
            with open(path, "rb") as data:
                found.update(data.read())
    return found.hexdigest()[:12]


def is_walkthru(file):
    with open(file, "rb") as lines:
        head = lines.read(HEAD_BYTES).decode("latin-1")
    # Broken over lines, each with its mark of a comment.
    words = " ".join(head.replace("#", " ").split())
    return "Soda Hall WALKTHRU Model" in words


def scene(name):
    """A scene of the paper beside the project, or None."""
    files = sorted(glob.glob(os.path.join(SCENES, name, "*.obj")))
    return Model(files) if files else None


def generated(session, name, words):
    """A building of the generator, made on the spot once."""
    program, binary = session.program("building")
    folder = os.path.join(session.folder, "models", f"{name}-{binary}")
    if not os.path.isdir(folder):
        session.say(f"writing {name}: building {' '.join(words)}")
        new = folder + ".new"
        shutil.rmtree(new, ignore_errors=True)
        os.makedirs(os.path.dirname(folder), exist_ok=True)
        done = subprocess.run([program, "-o", new, *words], capture_output=True, text=True)
        if done.returncode != 0:
            message, remedy = complaint(done.stderr)
            raise Failed(f"building ended with {done.returncode}: {message}", remedy)
        os.rename(new, folder)
    files = sorted(glob.glob(os.path.join(folder, "*.obj")))
    # The generator writes metres unless it is asked.
    return Model(files, name=name, shown=f"{name}/*.obj")


def given(arguments):
    """The model of `--model`, or None."""
    return Model(arguments.model, arguments.units) if arguments.model else None


def floor(session, arguments):
    """The given model, the paper's test floor, or a floor as large."""
    return given(arguments) or scene("soda-floor5") or generated(session, "soda-floor", ["--preset", "soda-floor"])


def five_floors(session, arguments):
    """The given model; or a furnished building as large as the paper's, and the paper's without its furniture."""
    model = given(arguments)
    if model:
        return [model]
    hall = scene("soda-hall")
    return [generated(session, "soda-5", ["--preset", "soda-5"])] + ([hall] if hall else [])


def of_size(session, times, floors, rooms):
    """A furnished building `times` as large as one of so many floors, with so many rooms each."""
    if float(times * floors).is_integer():
        floors, rooms = int(times * floors), rooms
    else:
        rooms = max(6, round(rooms * times))
    words = ["--floors", f"{floors}", "--rooms-per-floor", f"{rooms}", "--furnished"]
    return generated(session, f"building-{floors}x{rooms}", words)
