"""What is read of small catalogues: python3 -m unittest discover -s tools/experiments"""

import os
import tempfile
import unittest

import catalogue
from canned import CLUSTERS, make_store


class Catalogue(unittest.TestCase):
    def setUp(self):
        self.folder = tempfile.TemporaryDirectory()
        self.addCleanup(self.folder.cleanup)
        self.store = os.path.join(self.folder.name, "a ?#.clr")
        make_store(self.store)

    def test_history_sums_visits_and_takes_times_from_the_first_claim(self):
        history = catalogue.history(self.store)
        first = history["iterations"][0]
        self.assertEqual(
            (first["visits_s"], first["visits"], first["gathers"], first["visits_cpu_s"]), (9.0, 2, 2.0, 1.0)
        )
        self.assertAlmostEqual(first["merge_s"], 1.0)
        self.assertEqual([iteration["phase"] for iteration in history["iterations"]], ["sweep"] * 3)
        self.assertEqual(catalogue.total(history, "wall_s"), 21.0)
        # Half of both groups' power has come after the first iteration, three quarters after the second.
        self.assertEqual(history["ends"][:2], [[5.0, 9.0, 0.5], [15.0, 18.0, 0.75]])
        self.assertEqual(history["curve"][0], [4.0, 4.0, 0.25])

    def test_contraction_leaves_out_the_first_iteration_and_those_that_refine(self):
        history = catalogue.history(self.store)
        self.assertAlmostEqual(catalogue.contraction(history), 0.4)
        history["iterations"][2]["phase"] = "mark"
        self.assertIsNone(catalogue.contraction(history))
        self.assertAlmostEqual(catalogue.predicted_contraction(0.8, 0.5), 0.8 * 0.5 / 0.6)

    def test_reuse_counts_every_use_of_a_link_and_inside_links_once_a_gather(self):
        shares = catalogue.inside_shares(self.store)
        self.assertEqual(shares, {0: 0.75, 1: 0.75})
        # In each of six visits 100 links, 75 of them twice; made are 100 in each of the first two.
        both = catalogue.reuse_of_store(self.store, shares)
        self.assertAlmostEqual(both["inside"], 1 - 200 / (6 * 175))
        self.assertAlmostEqual(both["every"], 1 - 200 / (6 * 200))
        self.assertAlmostEqual(catalogue.reuse_of_store(self.store, {})["inside"], 1 - 200 / 600)
        visit = {"group": 0, "stored": 10, "reused": 0, "gathers": 1}
        self.assertEqual(catalogue.reuse([visit], {0: 1.0}), 0.0)
        self.assertEqual(catalogue.reuse([visit]), 0.0, "one gather uses each link once")
        # k gathers of links that are thrown away afterwards find them made k - 1 times.
        for gathers in (2, 5):
            several = {**visit, "gathers": gathers}
            self.assertAlmostEqual(catalogue.reuse([several]), (gathers - 1) / gathers)
            self.assertAlmostEqual(catalogue.reuse([several], {0: 0.5}), 1 - 1 / (1 + (gathers - 1) / 2))
        self.assertIsNone(catalogue.reuse([], {}))

    def test_workers_wait_for_the_last_and_one_without_a_visit_for_all(self):
        bars = list(catalogue.timeline(self.store))
        self.assertEqual(bars[:2], [(1, 0, 0, 0.0, 4.0), (1, 1, 1, 0.0, 5.0)])
        self.assertEqual(catalogue.idle_at_ends(bars, 2), 3.0)
        self.assertEqual(catalogue.idle_at_ends(bars, 3), 3.0 + 15.0)

    def test_boxes_are_seen_from_above_with_small_ones_last(self):
        boxes = catalogue.boxes(self.store)
        self.assertEqual(len(boxes), CLUSTERS)
        self.assertIn((1.0, 0.0, 2.0, 2.0, 0), boxes)

    def test_a_thinned_curve_keeps_its_end(self):
        points = [[i] for i in range(1001)]
        thin = catalogue.thinned(points, 100)
        self.assertTrue(len(thin) <= 101 and thin[-1] == [1000])
        self.assertEqual(catalogue.thinned([]), [])


if __name__ == "__main__":
    unittest.main()
