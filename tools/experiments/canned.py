"""Canned results and small solved stores for the tests."""

import os
import sqlite3
import struct

import catalogue
import session

SCHEMA = os.path.join(session.ROOT, "schema", "store.sql")
CLUSTERS = 4
WATTS = 10.0


def report(absorbed_w, stored=100, reused=0, gathers=2, cpu_s=0.5):
    """As the program stores it: red alone has power; two bins."""
    head = (WATTS, 0, 0, absorbed_w, 0, 0, 0, 0, 0, 7, stored, reused, 900, 12, *[0.0] * 3, 0, *[0.0] * 4, 2)
    bins = struct.pack("<idd", 1, 0.0, 0.0) * 2
    return catalogue.HEAD.pack(*head) + bins + catalogue.TAIL.pack(True, gathers, 0.5, 1 << 20, cpu_s, 50, 60, 0, 0, 0)


def links(inside, outside, cluster, other):
    """A payload of links: hits on a side of a cluster itself and of another."""
    sides = struct.pack("<2Q", cluster << 40 | 5, other << 40 | 9)
    hits = struct.pack("<I2H", 0, 1, 2) * inside + struct.pack("<I2H", 1, 3, 4) * outside
    arrays, payload, places = [b"", b"", sides, b"", hits], b"", []
    for data in arrays:
        places.append(struct.pack("<2Q", 8 + 16 * len(arrays) + len(payload), len(data)))
        payload += data
    return struct.pack("<Q", len(arrays)) + b"".join(places) + payload


def make_store(store, iterations=3):
    """A solved store of two groups with two clusters each, by two workers."""
    os.makedirs(os.path.join(store, "segments"), exist_ok=True)
    path = os.path.join(store, "scene.sqlite")
    if os.path.exists(path):
        return
    to = sqlite3.connect(path)
    with open(SCHEMA) as file:
        to.executescript(file.read())
    model = [
        1,
        0,
        0,
        0,
        1,
        "z",
        0,
        0,
        0,
        4,
        2,
        1,
        1e-5,
        "both",
        "front",
        8,
        8,
        0,
        0,
        0,
        4,
        1,
        8,
        30,
        1,
        10,
        0,
        0,
        0.5,
        0.8,
    ]
    to.execute(f"INSERT INTO model VALUES ({','.join('?' * 33)})", [*model, 1, 0, 0])
    to.execute("INSERT INTO segments VALUES (1, 'links.seg', 'update', 0)")
    to.execute("INSERT INTO input_files VALUES (1, 'm.obj', 'obj', 1, '')")
    to.execute("INSERT INTO objects VALUES (1, 1, 'o')")
    to.execute("INSERT INTO branches (id, cause, opened_at) VALUES (0, 'first', 0)")
    to.execute(
        "INSERT INTO solution_versions (id, branch, iteration, is_iteration_end, made_at) VALUES (0, 0, 0, 1, 90)"
    )
    with open(os.path.join(store, "segments", "links.seg"), "wb") as segment:
        for cluster in range(CLUSTERS):
            values = (cluster, cluster, 0, 0, cluster + 1, 2, 1, cluster // 2)
            to.execute(
                """INSERT INTO clusters (id, object, patches, emitters, area_m2, min_x_m, min_y_m, min_z_m,
                   max_x_m, max_y_m, max_z_m, geometry_segment, geometry_offset, geometry_bytes, rays_segment,
                   rays_offset, rays_bytes, provenance_segment, provenance_offset, provenance_bytes, group_id)
                   VALUES (?, 1, 2, 0, 1, ?, ?, ?, ?, ?, ?, 1, 0, 0, 1, 0, 0, 1, 0, 0, ?)""",
                values,
            )
            payload, offset = links(3, 1, cluster, (cluster + 2) % CLUSTERS), segment.tell()
            segment.write(bytes(64) + payload)
            to.execute("INSERT INTO cluster_links VALUES (?, 0, 0, 1, ?, ?)", (cluster, offset, len(payload)))
    for number in range(1, iterations + 1):
        begin = 100.0 + 10 * number
        for group in (0, 1):
            row = (number, group, number - 1, 10 * number + group, begin, begin + 4 + group)
            to.execute(
                """INSERT INTO tasks (branch, iteration, group_id, update_order, state, base_version, options_hash,
                   partition_hash, worker, claimed_at, finished_at, report)
                   VALUES (0, ?, ?, 'jacobi', 'merged', ?, '', '', ?, ?, ?, ?)""",
                (*row, report(WATTS * (1 - 0.5**number), reused=0 if number == 1 else 100)),
            )
        to.execute(
            """INSERT INTO solution_versions (id, branch, iteration, is_iteration_end, made_at, phase, residual,
               elements, links_evaluated, links_stored, links_reused, rays, estimated_nrms)
               VALUES (?, 0, ?, 1, ?, ?, ?, 24, 14, 200, ?, 1800, 0.04)""",
            (number, number, begin + 6, "sweep" if number < 3 else "mark", 0.4**number, 0 if number == 1 else 200),
        )
        to.execute(
            "INSERT INTO metrics (stage, version, name, value, unit, at) VALUES ('run', ?, 'iteration_wall', 7.0,"
            " 's', 0)",
            (number,),
        )
    to.commit()
    to.close()


def end_stage(store, name):
    """As a stage does that has come to its end."""
    to = sqlite3.connect(os.path.join(store, "scene.sqlite"))
    to.execute("INSERT OR REPLACE INTO stages VALUES (?, '', '', '', '', '{}', 1, 0)", (name,))
    to.commit()
    to.close()


def result(curve, share=0.5, wall_s=10.0, visits_s=15.0, residuals=(1.0, 0.4, 0.2), **more):
    """What `Session.solve` gives of a run."""
    iterations = [
        {
            "iteration": number,
            "phase": "sweep",
            "residual": residual,
            "elements": 20,
            "stored": 100,
            "reused": 60,
            "rays": 500,
            "estimated_nrms": 0.04,
            "wall_s": wall_s / len(residuals),
            "merge_s": 0.1,
            "visits_s": visits_s / len(residuals),
            "visits_cpu_s": 4.0,
            "bytes_read": 10,
            "gathers": 2.0,
            "visits": 2,
        }
        for number, residual in enumerate(residuals, 1)
    ]
    stage = {"wall_s": 1.0, "peak_anon_bytes": 5_000_000}
    return {
        "date": "2025-01-02",
        "load": 0.1,
        "ingest": stage,
        "visibility": stage,
        "partition": {**stage, "groups": 16, "intra_group_share": share, "predicted_contraction": 0.7},
        "run": {
            "clusters": 10,
            "patches": 1000,
            "emitters": 3,
            "area_m2": 50.0,
            "groups": 16,
            "elements": 4000,
            "links_stored": 100,
            "iterations": 3,
            "estimated_nrms": 0.04,
            "audited_nrms": None,
            "converged": True,
            "workers": 2,
            "peak_anon_bytes": 7_000_000,
            "coordinator_anon_bytes": 3_000_000,
        },
        "history": {
            "iterations": iterations,
            "curve": curve,
            "ends": curve[-1:],
            "mean_reflectance": 0.5,
            "max_reflectance": 0.8,
        },
        **more,
    }


FAST = [[1.0, 2.0, 0.8], [2.0, 4.0, 1.0]]
SLOW = [[2.0, 3.0, 0.5], [8.0, 9.0, 1.0]]
