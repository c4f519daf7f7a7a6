"""What the drivers write of canned results: python3 -m unittest discover -s tools/bench"""

import os
import tempfile
import unittest

import compare
import performance

RESULT = {
    "cpu_s": 1234.56, "wall_s": 700.0, "peak_anon_mb": 31.4, "elements": 2478, "links": 510000, "converged": True,
    "estimated_nrms": 0.0192, "audited_nrms": 0.0207, "audited_se": 0.0031, "nrms": 0.02, "bias": -0.0009,
    "dark": 0.0, "dim_p50": None, "peer_cpu_s": 1.6, "ratio": 0.9, "sample_nrms": 0.0059, "sample_ms": 0.612,
}  # fmt: skip


def record(**more):
    return {"commit": "c" * 40, "machine": "2 cores of a kind", "date": "2025-01-02", "load": 0.1, **more}


class Drivers(unittest.TestCase):
    def test_page_holds_every_record_in_the_order_of_scenes(self):
        options = "--workers 2"
        page = performance.page(
            [
                record(scene="hospital3", options=f"{options} --quality draft", stopped_after_s=60.0),
                record(scene="cornell-box", options=options, result=RESULT),
                record(bench="rows", figures=[{"name": "row_entries_per_s_core", "value": 2.5e6, "unit": "1/s"}]),
            ],
            "c" * 40,
        )
        lines = page.splitlines()
        box = (
            "| cornell-box | 1,234.6 s | 700.0 s | 31.4 MB | 2,478 | 0.5 M | 1.92 % | 2.07 % +- 0.31 % | 2.00 % "
            "| -0.09 % | 0.0e+00 | - | 1.6 s | 0.9 | 0.59 % | 0.61 ms | yes |"
        )
        hospital = next(line for line in lines if line.startswith("| hospital3 | stopped after 60 s |"))
        self.assertLess(lines.index(box), lines.index(hospital))
        self.assertEqual(hospital.count("|"), box.count("|"))
        self.assertIn("| rows | - | row_entries_per_s_core | 2.5 M 1/s |", lines)
        self.assertIn("hospital3 with `--workers 2 --quality draft`", page)

    def test_what_was_measured_goes_on_for_its_commit_and_machine_alone(self):
        with tempfile.TemporaryDirectory() as folder:
            path = os.path.join(folder, "results")
            with open(path, "w") as file:
                file.write('{"commit": "a", "machine": "m", "scene": "office", "stopped_after_s": 60}\n{"commit": "a')
            known = performance.known(path, "a", "m")
            self.assertEqual([performance.is_done(known, "office", limit) for limit in (60, 61)], [True, False])
            self.assertEqual(performance.known(path, "b", "m") + performance.known(path, "a", "n"), [])

    def test_slower_is_what_exceeds_the_spread_of_a_and_the_margin(self):
        runs = lambda *cpu_s: [{"cpu_s": value, "links": 10} for value in cpu_s]
        rows, slower = compare.compare(runs(10.0, 11.0), runs(11.5, 12.5))
        self.assertEqual(rows[0], ["CPU", "10.00 s", "11.00 s", "11.50 s", "12.50 s", "1.143", ""])
        self.assertFalse(slower, "12.0 is not over 10.5 + 1.0 + 0.525")
        rows, slower = compare.compare(runs(10.0, 11.0), runs(12.0, 12.2))
        self.assertEqual((rows[0][-1], slower), ("slower", True))


if __name__ == "__main__":
    unittest.main()
