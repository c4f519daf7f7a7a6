"""What the experiments make of canned results: python3 -m unittest discover -s tools/experiments"""

import unittest
from types import SimpleNamespace
from unittest import mock

import common
import five_floors
import granularity
import grouping
import memory
import models
import page
import partition
import scheduling
import session
import speedup
from canned import FAST, SLOW, result


class Tables(unittest.TestCase):
    def test_time_to_a_level_lies_on_the_line_between_points(self):
        self.assertAlmostEqual(common.time_to(FAST, 0.9), 1.5)
        self.assertAlmostEqual(common.time_to(FAST, 0.4, 1), 1.0)
        self.assertIsNone(common.time_to(FAST, 1.1))

    def test_grouping_says_what_is_reused_and_who_is_faster(self):
        reuse = lambda is_grouped: {"every": 0.5 * is_grouped, "inside": 0.4 * is_grouped}
        runs = {
            name: result(FAST if is_grouped else SLOW, reuse=reuse(is_grouped)) for name, _, is_grouped in grouping.RUNS
        }
        _, lines = grouping.beside(runs)
        self.assertEqual(lines[0], ["links reused, grouped: every link with each gather", "45.00 %", "50.00 %"])
        self.assertEqual([line[2] for line in lines[1:]], ["0.00 %", "40.00 %", "0.00 %", "grouped", "grouped"])
        heads, lines = grouping.rows(runs)
        self.assertEqual({len(line) for line in lines}, {len(heads)})
        self.assertEqual(lines[1][6:10], ["50.00 %", "40.00 %", "60.00 %", "120"])
        self.assertIn("less by a factor of", grouping.prose(runs)[1])
        self.assertIn("count again, 40.00 % and 0.00 % (the paper: 45.00 % and 0.00 %)", grouping.prose(runs)[1])
        self.assertIn("its 45.00 % need 81.82 % of all links", grouping.prose(runs)[1])
        runs = {
            name: result(SLOW if is_grouped else FAST, reuse=reuse(False)) for name, _, is_grouped in grouping.RUNS
        }
        self.assertEqual(grouping.beside(runs)[1][4][2], "ungrouped")
        self.assertIn("more by a factor of", grouping.prose(runs)[1])

    def test_partition_orders_methods_by_what_was_measured(self):
        runs = {
            "merge": result(SLOW, 0.6, residuals=(1.0, 0.5, 0.3)),
            "split": result(FAST, 0.7, residuals=(1.0, 0.5, 0.2)),
            "random": result(SLOW, 0.1, residuals=(1.0, 0.5)),
        }
        found = partition.orders(runs)
        self.assertEqual(found["share"], ["split", "merge", "random"])
        self.assertEqual((found["contraction"], found["time"][0]), (["split", "merge"], "split"))
        heads, lines = partition.rows(runs)
        self.assertEqual({len(line) for line in lines}, {len(heads)})
        # 0.5 * 0.3 / (1 - 0.5 * 0.7) of the mean reflectance.
        self.assertEqual(lines[1][2:6], ["70.00 %", "0.700", "0.231", "0.400"])
        self.assertEqual(lines[2][5], "-")
        self.assertIn("bounds 2 of the 2", partition.prose(runs)[1])

    def test_granularity_has_no_more_groups_than_clusters(self):
        self.assertEqual(granularity.sizes([32, 128, 256, 1425], 200), [32, 128, 200])
        runs = {32: result(FAST), 200: result(SLOW)}
        self.assertEqual(granularity.best(runs), 32)
        self.assertEqual(granularity.beside(runs)[1][0], ["fastest to the same transfer, groups", "256", "32"])
        heads, lines = granularity.rows(runs, 2)
        self.assertEqual(lines[0][heads.index("workers in visits")], "75.00 %")

    def test_scheduling_puts_a_replay_beside_the_paper(self):
        row = {
            "makespan_s": 10.0, "speedup": 4.0, "download_bytes": 3 << 20, "end_idle_share": 0.05, "waiting_share": 0.1,
            "next_bottleneck": "master",
        }  # fmt: skip
        of = {policy: scheduling.replayed(row, scheduling.size("1M")) for policy in scheduling.POLICIES}
        self.assertEqual(scheduling.beside(of)[1][1], ["ws", "98 s", "3.00 s", "547 s", "0.50 s"])
        self.assertEqual((scheduling.size("7"), scheduling.size("2k")), (7.0, 2048.0))
        bars = [(1, 0, 0, 0.0, 4.0), (1, 1, 1, 0.0, 5.0), (3, 0, 0, 6.0, 7.0)]
        real = scheduling.real(result(FAST), bars, 2)
        self.assertEqual((real["idle_s_a_worker"], real["in_visits"], real["idle_share"]), (1.0, 0.75, 0.1))
        self.assertEqual(scheduling.panel("ws", bars), ("ws", [(0, 0.0, 4.0), (1, 0.0, 5.0)], [5.0]))
        self.assertEqual(scheduling.panel("ffd-ws", bars)[0], "ffd-ws (delta 16)")
        plan = scheduling.by_worker([(0, 0, 1, 1, 1), (1, 0, 2, 1, 7)], bars[:2])
        self.assertEqual(plan, [(0, 0, 1, 1, 1), (1, 0, 2, 1, 0)], "the first iteration, where it is the last drawn")
        captions = scheduling.captions(SimpleNamespace(simulated=8, workers=2))
        self.assertTrue("8 replayed" in captions[0] and "2 real" in captions[2] and len(set(captions)) == 4)

    def test_speedup_puts_real_runs_and_replays_into_one_table(self):
        runs = {1: result(FAST, wall_s=10.0), 2: result(FAST, wall_s=6.25)}
        real = speedup.measured(runs)
        self.assertEqual(real, {1: 1.0, 2: 1.6})
        row = {"workers": 8, "speedup": 6.0, "share_of_linear": 0.75, "next_bottleneck": "latency"}
        replays = {name: [row] for name in ("no cost of moving data", "asynchronous master", "synchronous master")}
        _, lines = speedup.rows(real, replays)
        self.assertEqual(lines[1], ["2", "1.3 to 1.5", "1.60 (80.00 %)", "-", "-", "-", "-"])
        self.assertEqual(lines[2][1:4] + lines[2][-1:], ["5.2 to 6.0", "-", "6.00 (75.00 %)", "latency"])

    def test_five_floors_has_shares_of_time_and_the_paper_s_estimate_of_speedup(self):
        of = five_floors.figures(result(FAST))
        self.assertEqual((of["links_made"], of["time_s"], of["speedup"]), (120, 13.0, 1.5))
        self.assertAlmostEqual(of["in_visits_share"], 0.75)
        self.assertAlmostEqual(of["grouping_share"], 1 / 13)
        heads, lines = five_floors.rows({"ours": result(FAST)})
        by = {line[0]: line[1:] for line in lines}
        self.assertIn("0.36 % of the paper's patches", five_floors.prose({"ours": result(FAST)})[1])
        self.assertEqual(heads, ["", "the paper", "ours"])
        self.assertEqual(by["area"], ["48,998 m2", "50 m2"])
        self.assertEqual(by["links made a second"], ["620", "12"])
        self.assertEqual(by["the same, of linear"], ["78.63 %", "75.00 %"])

    def test_memory_tells_growth_and_keeps_what_was_refused(self):
        self.assertAlmostEqual(memory.slope([1, 2, 4], [3, 12, 48]), 2.0)
        self.assertIsNone(memory.slope([1], [1]))
        _, lines = memory.rows({1.0: memory.figures(result(FAST)), 2.0: "too large"})
        self.assertEqual(lines[0][:4] + lines[0][7:8], ["1", "1,000", "4,000", "0.0 M", "13.00 ms"])
        self.assertEqual((lines[1][:2], len(lines[1])), (["2", "too large"], len(lines[0])))


class Page(unittest.TestCase):
    def test_sections_are_replaced_one_by_one_in_their_order(self):
        text = page.put("", "memory", "## Memory\n\nold\n")
        text = page.put(text, "grouping", "## Grouping\n")
        text = page.put(text, "memory", "## Memory\n\nnew\n")
        self.assertEqual(list(page.sections(text)), ["grouping", "memory"])
        self.assertTrue("new" in text and "old" not in text and text.startswith(page.HEAD))
        self.assertEqual(page.put(text, "memory", "## Memory\n\nnew\n"), text)

    def test_results_on_the_paper_s_models_carry_their_acknowledgement(self):
        plain = page.put("", "memory", "of a building\n")
        marked = page.put(plain, "grouping", f"of {models.WALKTHRU}\n")
        self.assertNotIn("Acknowledgement", plain)
        self.assertTrue(marked.endswith(page.ACKNOWLEDGEMENT))
        self.assertEqual(marked.count(page.ACKNOWLEDGEMENT), 1)
        self.assertNotIn("Acknowledgement", page.put(marked, "grouping", "of another\n"))

    def test_a_section_names_commit_machine_and_commands(self):
        of = SimpleNamespace(commit="c" * 40, machine="2 cores of a kind")
        facts = common.facts(of, "office", [result(FAST)], ["clerestory run"])
        text = page.section("T", ["prose"], [(["a"], [["1"]])], [("plan", "p.svg")], facts)
        for line in (f"- Commit: {'c' * 40}", "- Machine: 2 cores of a kind", "- Date: 2025-01-02", "clerestory run"):
            self.assertIn(line, text.splitlines())
        self.assertIn("| 1 |", text)

    def test_a_stamp_says_when_the_checkout_has_changes(self):
        for changed, stamp in (("", "c" * 40), (" M src/lib.rs", "c" * 40 + " and changes not committed")):
            said = lambda *words, changed=changed: changed if "status" in words else "c" * 40
            with mock.patch.object(session.judged, "output", said):
                self.assertEqual(session.stamp_of_checkout("/elsewhere/page.md"), stamp)

    def test_command_lines_hold_no_places_of_the_machine(self):
        words = "partition --model /a/b.obj /a/c.obj --quality draft --binary=/x/y -o /tmp/z --groups 16".split()
        self.assertEqual(
            common.command_line(words), "tools/experiments/experiments.py partition --quality draft --groups 16"
        )


if __name__ == "__main__":
    unittest.main()
