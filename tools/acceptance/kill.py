#!/usr/bin/env python3
"""Kills whole runs and looks at what a rerun gives: kill.py MODEL.obj [--quality draft] [--kills 20] [--late 3]

--kills  runs killed (SIGKILL, all processes) at random instants, several a store; then rerun to the end:
         the export must have the bytes of an undisturbed run and `check` must be clean
--late   runs killed at 70 % of a whole run's time: the rerun must take less than 70 % of a whole run; what a run costs at
         all is half a second, so the model is to take two or more

CLERESTORY names the program. One line per case; exit code 1 if one fails.
"""

import argparse
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time

PROGRAM = os.environ.get("CLERESTORY", "clerestory")
KILLS_PER_STORE = 4


def start(options, store):
    command = [PROGRAM, "run", options.model, "--store", store, "--quality", options.quality, "-q", "--workers", "2"]
    return subprocess.Popen(command, start_new_session=True)


def whole(options, store):
    """Runs to the end; its wall time."""
    started = time.monotonic()
    if start(options, store).wait() != 0:
        sys.exit("a run that nobody disturbed failed")
    return time.monotonic() - started


def killed(options, store, after_s):
    """Runs and kills all its processes at an instant; false if it had ended by then."""
    run = start(options, store)
    try:
        run.wait(after_s)
        return False
    except subprocess.TimeoutExpired:
        os.killpg(run.pid, signal.SIGKILL)
        run.wait()
        return True


def exported(store):
    subprocess.run([PROGRAM, "export", store, "-o", store + ".csv", "--force", "-q"], check=True)
    with open(store + ".csv", "rb") as file:
        return file.read()


def is_sound(store):
    return subprocess.run([PROGRAM, "check", store, "-q"]).returncode == 0


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("model")
    parser.add_argument("--quality", default="draft")
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--late", type=int, default=3)
    parser.add_argument("--seed", type=int, default=random.randrange(10**6))
    options = parser.parse_args()
    options.model = os.path.abspath(options.model)
    print("seed", options.seed)
    instants = random.Random(options.seed)
    failed = False

    def verdict(good, words):
        nonlocal failed
        failed = failed or not good
        print("pass " if good else "FAIL ", words, flush=True)

    with tempfile.TemporaryDirectory() as work:
        store = os.path.join(work, "calm.clr")
        whole_s = whole(options, store)
        expected = exported(store)
        print(f"a whole run takes {whole_s:.1f} s")
        done = 0
        while done < options.kills:
            store = os.path.join(work, "killed.clr")
            for _ in range(min(KILLS_PER_STORE, options.kills - done)):
                after_s = instants.uniform(0, whole_s)
                if not killed(options, store, after_s):
                    break  # it had ended
                done += 1
                sound = not os.path.exists(store + "/scene.sqlite") or is_sound(store)
                verdict(sound, f"kill {done} after {after_s:.2f} s: check")
            whole(options, store)
            verdict(exported(store) == expected and is_sound(store), "rerun: same bytes, check clean")
            shutil.rmtree(store)
        for _ in range(options.late):
            store = os.path.join(work, "late.clr")
            whole_s = whole(options, store)
            shutil.rmtree(store)
            if not killed(options, store, 0.7 * whole_s):
                sys.exit("a run ended before 70 % of the time of the one before: let nothing else run beside")
            rerun_s = whole(options, store)
            verdict(rerun_s < 0.7 * whole_s, f"killed at 70 %: the rerun took {100 * rerun_s / whole_s:.0f} % of a whole run ({whole_s:.1f} s)")
            verdict(exported(store) == expected, "rerun: same bytes")
            shutil.rmtree(store)
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
