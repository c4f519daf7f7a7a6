#!/usr/bin/env python3
"""Runs a command and watches, from outside, the anonymous memory of each of its processes.

watch_memory.py [--limit 128M] [--enforce 160M] [--every 0.01] [--quiet] COMMAND [ARGUMENT...]

--limit    fails (exit 99) if RssAnon of any process was ever above it
--enforce  also `ulimit -d`: the kernel refuses a process more private memory than this, mapped or not touched

Ends with one JSON line on stderr: the command's exit code, its wall time, and the largest RssAnon per
verb. Else the exit code is the command's.
"""

import argparse
import json
import os
import resource
import signal
import subprocess
import sys
import time


def size(text):
    """`128M` in bytes."""
    unit = {"K": 10, "M": 20, "G": 30}.get(text[-1].upper())
    return int(text[:-1]) << unit if unit else int(text)


def descendants(root):
    """The process and everything below it that is still there."""
    found, todo = [], [root]
    while todo:
        pid = todo.pop()
        found.append(pid)
        try:
            for thread in os.listdir(f"/proc/{pid}/task"):
                with open(f"/proc/{pid}/task/{thread}/children") as children:
                    todo.extend(int(child) for child in children.read().split())
        except OSError:
            pass
    return found


def anonymous_bytes(pid):
    """RssAnon of a process; 0 if it is gone."""
    try:
        with open(f"/proc/{pid}/status") as status:
            for line in status:
                if line.startswith("RssAnon:"):
                    return int(line.split()[1]) << 10
    except OSError:
        pass
    return 0


def verb(pid):
    """What the process does: program and first argument."""
    try:
        with open(f"/proc/{pid}/cmdline", "rb") as line:
            words = line.read().split(b"\0")
        return " ".join(os.path.basename(w.decode(errors="replace")) for w in words[:2])
    except OSError:
        return "?"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--limit", type=size)
    parser.add_argument("--enforce", type=size)
    parser.add_argument("--every", type=float, default=0.01)
    parser.add_argument("--quiet", action="store_true", help="throw the command's own output away")
    parser.add_argument("command", nargs=argparse.REMAINDER)
    options = parser.parse_args()

    def limit_data():
        if options.enforce:
            resource.setrlimit(resource.RLIMIT_DATA, (options.enforce, options.enforce))

    output = subprocess.DEVNULL if options.quiet else None
    started = time.monotonic()
    child = subprocess.Popen(options.command, preexec_fn=limit_data, stdout=output, stderr=output)
    signal.signal(signal.SIGINT, lambda *_: child.send_signal(signal.SIGINT))
    peak = {}
    while child.poll() is None:
        for pid in descendants(child.pid):
            what = verb(pid)
            peak[what] = max(peak.get(what, 0), anonymous_bytes(pid))
        time.sleep(options.every)
    largest = max(peak.values(), default=0)
    print(
        json.dumps(
            {
                "exit": child.returncode,
                "wall_s": round(time.monotonic() - started, 2),
                "peak_anon_mib": round(largest / 2**20, 1),
                "by_verb_mib": {k: round(v / 2**20, 1) for k, v in sorted(peak.items())},
            }
        ),
        file=sys.stderr,
    )
    if options.limit and largest > options.limit:
        return 99
    return child.returncode if child.returncode >= 0 else 128 - child.returncode


if __name__ == "__main__":
    sys.exit(main())
