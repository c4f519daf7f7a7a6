"""What the drivers share: scenes, the judge, commits, tables."""

import json
import os
import platform
import resource
import signal
import subprocess
import sys
import tempfile

ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))

# Options of `run` beside those that all scenes share; in the order of tables.
SCENES = {
    "cornell-box": [],
    "cornell": [],
    "office": [],
    "duplex": [],
    "classroom": [],
    "soda-floor5": [],
    "soda-hall": [],
    "hospital3": ["--quality", "draft"],
}
SHARED = ["--workers", "2"]


def add_arguments(parser, default_scenes):
    parser.add_argument("--scenes", default=default_scenes, help="names, parted by commas [default: %(default)s]")
    judge = os.path.join("..", "shared", "judge")
    parser.add_argument("--judge", default=judge, help="folder of bake.py [default: %(default)s]")
    parser.add_argument("--python", default=sys.executable, help="runs the judge; needs numpy and scipy")
    parser.add_argument("--limit", type=float, default=3600, help="seconds until a scene is stopped [default: 3600]")


def options_of(scene):
    return SHARED + SCENES.get(scene, [])


def output(*command, cwd=ROOT):
    return subprocess.run(command, cwd=cwd, check=True, stdout=subprocess.PIPE, text=True).stdout.strip()


def commit_of(revision):
    return output("git", "rev-parse", "--verify", revision + "^{commit}")


def machine():
    with open("/proc/cpuinfo") as file:
        model = next((line.split(":", 1)[1].strip() for line in file if line.startswith("model name")), None)
    with open("/proc/meminfo") as file:
        memory = next(int(line.split()[1]) for line in file if line.startswith("MemTotal"))
    cores = len(os.sched_getaffinity(0))
    return f"{cores} cores of {model or platform.machine()}, {memory / 2**20:.1f} GiB"


def kept(path):
    """Records of a file of JSON lines; none if there is no file."""
    records = []
    if os.path.exists(path):
        with open(path) as file:
            for line in file:
                try:
                    records.append(json.loads(line))
                except ValueError:
                    continue  # broken off: measured again
    return records


def keep(path, record):
    """Appends a record to a file of JSON lines."""
    os.makedirs(os.path.dirname(os.path.abspath(path)), exist_ok=True)
    with open(path, "a") as file:
        # On a line of its own, also after one that was broken off.
        file.write("\n" + json.dumps(record) + "\n")


def bake(arguments, scene, binary):
    """What bake.py says of a scene, and `sampled`; TimeoutExpired after the limit, RuntimeError if it fails."""
    command = [arguments.python, os.path.join(ROOT, arguments.judge, "bake.py"), scene, "--binary", binary]
    # bake.py leaves its files behind.
    with tempfile.TemporaryDirectory(prefix="judged-", ignore_cleanup_errors=True) as folder:
        child = subprocess.Popen(
            command + ["--store", os.path.join(folder, "s.clr"), "--"] + options_of(scene),
            env={**os.environ, "TMPDIR": folder},
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )
        try:
            said, wrong = child.communicate(timeout=arguments.limit)
        finally:
            # Its workers as well.
            if child.poll() is None:
                os.killpg(child.pid, signal.SIGKILL)
                child.wait()
        if child.returncode != 0:
            raise RuntimeError(f"{scene}: {wrong.strip()[-500:]}")
        return {**json.loads(said), **sampled(arguments, scene, binary, folder)}


def sampled(arguments, scene, binary, folder):
    """What `sample` gives at the sensor points of a scene that was baked in a folder: its error and CPU a point."""
    judge = os.path.join(ROOT, arguments.judge)
    points, reference = (os.path.join(judge, "references", f"{scene}.{kind}.csv") for kind in ("pts", "ref"))
    if not os.path.exists(reference):
        return {}
    answers, before = os.path.join(folder, "sample.csv"), resource.getrusage(resource.RUSAGE_CHILDREN)
    said = output(binary, "sample", os.path.join(folder, "s.clr"), "--points", points, "-o", answers, "--json", "-q")
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu_s = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    compared = json.loads(output(arguments.python, os.path.join(judge, "compare.py"), reference, answers, "--json"))
    return {
        "sample_nrms": compared["nRMS_corrected"],
        "sample_dark": compared["dark_mean_test"],
        "sample_ms": 1e3 * cpu_s / max(1, json.loads(said)["points"]),
    }


def end_on_sigterm():
    """Lets `finally` run when the driver is asked to end."""
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))


def table(heads, rows):
    lines = [heads, ["---"] * len(heads), *rows]
    return "\n".join("| " + " | ".join(str(cell) for cell in line) + " |" for line in lines)


def number(value, unit="", digits=1):
    return "-" if value is None else f"{value:,.{digits}f}{unit}"


def percent(value, sign=""):
    return "-" if value is None else f"{100 * value:{sign}.2f} %"
