"""The driver on a program that only pretends: python3 -m unittest discover -s tools/experiments"""

import io
import json
import os
import stat
import sys
import tempfile
import unittest
from contextlib import redirect_stderr
from unittest import mock

import experiments
import plots
import session

FAKE = """#!{python}
import json, os, sys
sys.path.insert(0, {here!r})
import canned as t
verb, store = sys.argv[1], sys.argv[sys.argv.index("--store") + 1 if "--store" in sys.argv else 2]
with open({log!r}, "a") as log:
    log.write(verb + "\\n")
if os.path.exists({log!r} + "." + verb):
    sys.exit("error: it is too large\\nhelp: give more memory")
t.make_store(store)
t.end_stage(store, verb)
answer = t.result(t.FAST)
print(json.dumps(answer.get(verb, answer["partition"])))
"""

REPLAYER = """#!{python}
import sys
assert sys.argv[1:4] == ["a.clr", "--workers", "8"], sys.argv
with open(sys.argv[sys.argv.index("--timeline") + 1], "w") as file:
    file.write({text!r})
print("{{}}")
"""


class Sessions(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = folder.name
        self.log, self.model = (os.path.join(self.folder, name) for name in ("log", "box.obj"))
        self.page = os.path.join(self.folder, "docs", "experiments.md")
        with open(self.model, "w") as file:
            file.write("# a box\n")
        self.binary = os.path.join(self.folder, "clerestory")
        here = os.path.dirname(os.path.abspath(__file__))
        with open(self.binary, "w") as file:
            file.write(FAKE.format(python=sys.executable, here=here, log=self.log))
        os.chmod(self.binary, os.stat(self.binary).st_mode | stat.S_IXUSR)

    def fails(self, verb, does):
        """Has a verb fail from now on, or no longer."""
        if does:
            open(f"{self.log}.{verb}", "w").close()
        else:
            os.remove(f"{self.log}.{verb}")

    def run_driver(self, commit="a" * 40, **more):
        """Exit code, what was said, and the verbs that ran."""
        if os.path.exists(self.log):
            os.remove(self.log)
        words = ["five-floors", "--model", self.model, "--binary", self.binary, "-o", os.path.join(self.folder, "out")]
        words += ["--page", self.page, *(word for name, value in more.items() for word in (f"--{name}", value))]
        said = io.StringIO()
        with mock.patch.object(session, "stamp_of_checkout", lambda _: commit), redirect_stderr(said):
            code = experiments.main(words)
        verbs = []
        if os.path.exists(self.log):
            with open(self.log) as file:
                verbs = file.read().split()
        return code, said.getvalue(), verbs

    def test_an_experiment_runs_once_for_its_commit_and_options_and_writes_its_section(self):
        every = ["ingest", "visibility", "partition", "run"]
        code, said, verbs = self.run_driver()
        self.assertEqual((code, verbs), (0, every), said)
        with open(self.page) as file:
            text = file.read()
        self.assertIn(f"- Commit: {'a' * 40}", text)
        self.assertIn("| patches | 280,836 | 1,000 |", text)
        self.assertIn("clerestory ingest box.clr box.obj", text)
        self.assertNotIn(self.folder, text)
        self.assertEqual(self.run_driver()[2], [], "known")
        self.assertEqual(self.run_driver(quality="final")[2], every, "other options")
        with open(self.model, "a") as file:
            file.write("v 0 0 0\n")
        self.assertEqual(self.run_driver()[2], every, "another model")
        self.assertEqual(self.run_driver(commit="b" * 40)[2], every, "another commit")
        with open(self.page) as file:
            text = file.read()
        self.assertIn(f"- Commit: {'b' * 40}", text)
        self.assertNotIn("a" * 40, text)

    def test_what_a_program_complains_of_is_told_with_what_to_do(self):
        self.fails("visibility", True)
        code, said, verbs = self.run_driver()
        self.assertEqual((code, verbs), (1, ["ingest", "visibility"]))
        self.assertIn(
            "error: five-floors: clerestory visibility ended with 1: it is too large\nhelp: give more memory", said
        )
        self.assertFalse(os.path.exists(self.page))
        self.fails("visibility", False)
        self.assertEqual(self.run_driver()[0], 0, "tried again")

    def test_a_run_that_goes_on_keeps_what_its_stages_took(self):
        self.fails("run", True)
        self.assertEqual(self.run_driver()[0], 1)
        self.fails("run", False)
        code, said, verbs = self.run_driver()
        self.assertEqual((code, verbs), (0, ["run"]), said)

    def test_a_record_broken_off_is_measured_again(self):
        self.run_driver()
        results = os.path.join(self.folder, "out", "results.jsonl")
        with open(results) as file:
            text = file.read()
        with open(results, "w") as file:
            file.write(text[:-20])
        self.assertEqual(len(self.run_driver()[2]), 4)
        self.assertEqual(self.run_driver()[2], [])
        with open(results) as file:
            self.assertTrue(json.loads(file.read().splitlines()[-1])["result"]["run"]["converged"])

    def test_a_replay_s_timeline_is_read_from_what_the_program_wrote(self):
        replayer = os.path.join(self.folder, "simulate")
        heads = "workers,worker,iteration,group,download_begin_s,begin_s,end_s,download_bytes,upload_bytes"
        with open(replayer, "w") as file:
            file.write(REPLAYER.format(python=sys.executable, text=f"{heads}\n8,7,1,3,0.0,0.25,1.5,100,20\n"))
        os.chmod(replayer, os.stat(replayer).st_mode | stat.S_IXUSR)
        of = session.Session(self.folder, {"simulate": replayer}, self.page)
        self.assertEqual(of.timeline("a.clr", {"workers": 8}, "scheduling", "ws"), [(1, 3, 7, 0.25, 1.5)])
        self.assertTrue(os.path.exists(os.path.join(self.folder, "scheduling", "ws.csv")))

    def test_pictures_without_matplotlib_are_an_error_with_what_to_do(self):
        with mock.patch.dict(sys.modules, {"matplotlib": None}):
            with self.assertRaisesRegex(session.Failed, "matplotlib is not installed") as caught:
                plots.pyplot()
        self.assertIn("pip install matplotlib", caught.exception.remedy)


if __name__ == "__main__":
    unittest.main()
