#!/usr/bin/env python3
"""nrms.py LEAVES.csv REFERENCE.csv ANSWER.csv LIMIT: area-weighted nRMS of ANSWER against REFERENCE.

Both are what `sample` found in two stores at the rows of LEAVES.csv, an export of one of them. Leaves
that emit do not count. Prints the nRMS; exit code 1 if it is above LIMIT or if a point has no answer.
"""

import csv
import math
import sys


def vector(row, what):
    return [float(row[f"{what}_{channel}_w_m2"]) for channel in "rgb"]


def main():
    if len(sys.argv) != 5:
        sys.exit(__doc__)
    difference = total = unanswered = points = 0
    with open(sys.argv[1]) as a, open(sys.argv[2]) as b, open(sys.argv[3]) as c:
        rows = zip(csv.DictReader(a), csv.DictReader(b), csv.DictReader(c), strict=True)
        for leaf, reference, answer in rows:
            if any(out > arriving for out, arriving in zip(vector(leaf, "radiosity"), vector(leaf, "irradiance"))):
                continue
            points += 1
            if not answer["irradiance_r_w_m2"] or not reference["irradiance_r_w_m2"]:
                unanswered += 1
                continue
            area = float(leaf["area_m2"])
            expected, found = vector(reference, "irradiance"), vector(answer, "irradiance")
            difference += area * sum((x - y) ** 2 for x, y in zip(found, expected))
            total += area * sum(y * y for y in expected)
    nrms = math.sqrt(difference / total)
    print(f"nRMS {nrms:.5f} over {points} points, {unanswered} unanswered")
    return int(nrms > float(sys.argv[4]) or unanswered > 0)


if __name__ == "__main__":
    sys.exit(main())
