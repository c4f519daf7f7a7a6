"""Reads what a solved store recorded: iterations, visits, transfer of light, boxes of clusters. Writes nothing."""

import array
import os
import sqlite3
import struct
import sys
import urllib.parse

# Points of a curve that are kept: more are not seen.
POINTS = 150

# tasks.report: bincode with integers of fixed size (schema/SEGMENTS.md, src/model/report.rs).
HEAD = struct.Struct("<9d5Q3dQ4dQ")
BIN_BYTES = 20
TAIL = struct.Struct("<?IdQd2Q3d")

# Link extents larger than this are read in part.
LINK_BYTES = 256 << 20
EXTENT_HEAD_BYTES = 64


def opened(store):
    path = urllib.parse.quote(os.path.join(os.path.abspath(store), "scene.sqlite"))
    return sqlite3.connect(f"file:{path}?mode=ro", uri=True)


def has_stage(store, name):
    """Whether a store has been through a stage."""
    if not os.path.exists(os.path.join(store, "scene.sqlite")):
        return False
    catalogue = opened(store)
    try:
        return catalogue.execute("SELECT count(*) FROM stages WHERE name = ?", (name,)).fetchone()[0] > 0
    except sqlite3.OperationalError:
        return False  # broken off before it had tables
    finally:
        catalogue.close()


def report(blob):
    """A task's report: powers are sums over red, green and blue, W."""
    head = HEAD.unpack_from(blob)
    tail = TAIL.unpack_from(blob, HEAD.size + BIN_BYTES * head[-1])
    emitted, absorbed, escaped = (sum(head[i : i + 3]) for i in (0, 3, 6))
    stored, reused, rays, elements = head[10:14]
    return {
        "emitted_w": emitted,
        "absorbed_w": absorbed,
        "escaped_w": escaped,
        "stored": stored,
        "reused": reused,
        "rays": rays,
        "elements": elements,
        "gathers": tail[1],
        "peak_anon_bytes": tail[3],
        "cpu_s": tail[4],
        "bytes_read": tail[5],
    }


def visits(catalogue):
    """Finished visits to groups of the newest branch, by their ends: times are s since the first began."""
    rows = catalogue.execute("""SELECT iteration, group_id, worker, claimed_at, finished_at, report FROM tasks
           WHERE branch = (SELECT max(id) FROM branches) AND report IS NOT NULL ORDER BY finished_at, id""").fetchall()
    first = min((row[3] for row in rows), default=0.0)
    return [
        {
            "iteration": iteration,
            "group": group,
            "worker": worker,
            "begin_s": claimed - first,
            "end_s": finished - first,
            **report(blob),
        }
        for iteration, group, worker, claimed, finished, blob in rows
    ]


def transfer(done):
    """(s, s in visits, share of the emitted power that is absorbed or has left) after each visit.

    Of every group counts the last visit. Light that is still under way is what lacks to 1.
    """
    of_group, points, in_visits_s = {}, [], 0.0
    emitted = sum({visit["group"]: visit["emitted_w"] for visit in done}.values())
    arrived = 0.0
    for visit in done:
        now = visit["absorbed_w"] + visit["escaped_w"]
        arrived += now - of_group.get(visit["group"], 0.0)
        of_group[visit["group"]] = now
        in_visits_s += visit["end_s"] - visit["begin_s"]
        if emitted > 0.0:
            points.append([round(visit["end_s"], 4), round(in_visits_s, 4), round(arrived / emitted, 6)])
    return points


def thinned(points, most=POINTS):
    """Every so manieth point, and the last."""
    step = -(-len(points) // most) if points else 1
    kept = points[step - 1 :: step]
    return kept if not points or kept[-1:] == points[-1:] else kept + [points[-1]]


def history(store):
    """All that experiments ask of a run; JSON."""
    catalogue = opened(store)
    try:
        done = visits(catalogue)
        ends = catalogue.execute(
            """SELECT id, iteration, phase, residual, elements, links_stored, links_reused, rays,
                      estimated_nrms, made_at FROM solution_versions
               WHERE is_iteration_end = 1 AND iteration > 0 AND branch = (SELECT max(id) FROM branches)
               ORDER BY iteration"""
        ).fetchall()
        walls = dict(catalogue.execute("SELECT version, value FROM metrics WHERE name = 'iteration_wall' ORDER BY id"))
        first = catalogue.execute("""SELECT min(claimed_at) FROM tasks WHERE branch = (SELECT max(id) FROM branches)
               AND report IS NOT NULL""").fetchone()[0]
        of_model = catalogue.execute("SELECT mean_reflectance, max_reflectance FROM model").fetchone()
    finally:
        catalogue.close()
    phase, iterations = "sweep", []
    for version, number, next_phase, residual, elements, stored, reused, rays, nrms, made_at in ends:
        own = [visit for visit in done if visit["iteration"] == number]
        last_s = max((visit["end_s"] for visit in own), default=0.0)
        iterations.append(
            {
                "iteration": number,
                "phase": phase,
                "residual": residual,
                "elements": elements,
                "stored": stored,
                "reused": reused,
                "rays": rays,
                "estimated_nrms": nrms,
                "wall_s": walls.get(version),
                "end_s": made_at - first,
                # Versions of single updates are merged while others are solved.
                "merge_s": max(0.0, made_at - first - last_s),
                "visits_s": sum(visit["end_s"] - visit["begin_s"] for visit in own),
                "visits_cpu_s": sum(visit["cpu_s"] for visit in own),
                "bytes_read": sum(visit["bytes_read"] for visit in own),
                "gathers": sum(visit["gathers"] for visit in own) / max(1, len(own)),
                "visits": len(own),
            }
        )
        phase = next_phase
    curve = transfer(done)
    last_of = {visit["iteration"]: at for at, visit in enumerate(done)}
    return {
        "iterations": iterations,
        "curve": thinned(curve),
        "ends": [curve[at] for at in sorted(last_of.values())] if curve else [],
        "mean_reflectance": of_model[0],
        "max_reflectance": of_model[1],
    }


def total(history_of, name):
    return sum(iteration[name] or 0 for iteration in history_of["iterations"])


def contraction(history_of):
    """By how much the change falls per iteration, before any row is made better: the geometric mean; none if unknown.

    The first iteration knows of lamps alone, so that ratios begin with the second.
    """
    residuals = []
    for iteration in history_of["iterations"]:
        if iteration["phase"] != "sweep":
            break
        residuals.append(iteration["residual"])
    residuals = [residual for residual in residuals[1:] if residual]
    if len(residuals) < 2:
        return None
    return (residuals[-1] / residuals[0]) ** (1.0 / (len(residuals) - 1))


def predicted_contraction(q, share):
    """Of group Jacobi, as `partition` has it: reflectance q, share of the exchange that stays within groups."""
    return q * (1.0 - share) / (1.0 - q * share)


def boxes(store):
    """Plan of the clusters: (least x, least y, greatest x, greatest y, group), m, seen from above."""
    catalogue = opened(store)
    try:
        up = catalogue.execute("SELECT up FROM model").fetchone()[0]
        # Right-handed from above: x and y, or x and -z.
        y = ("min_y_m", "max_y_m") if up == "z" else ("-max_z_m", "-min_z_m")
        rows = catalogue.execute(
            f"SELECT min_x_m, {y[0]}, max_x_m, {y[1]}, group_id FROM clusters WHERE group_id IS NOT NULL"
        ).fetchall()
    finally:
        catalogue.close()
    # Small ones above large ones.
    return sorted(rows, key=lambda box: -(box[2] - box[0]) * (box[3] - box[1]))


def timeline(store):
    """Visits as (iteration, group, lane, begin s, end s): the first worker of an iteration is in lane 0."""
    catalogue = opened(store)
    try:
        done = visits(catalogue)
    finally:
        catalogue.close()
    lanes = {}
    for visit in sorted(done, key=lambda visit: visit["begin_s"]):
        of_iteration = lanes.setdefault(visit["iteration"], {})
        lane = of_iteration.setdefault(visit["worker"], len(of_iteration))
        yield visit["iteration"], visit["group"], lane, visit["begin_s"], visit["end_s"]


def idle_at_ends(bars, workers):
    """Time that workers wait for the last of each iteration, s of all workers; one that got nothing waits for all."""
    last, first = {}, {}
    for iteration, _, lane, begin_s, end_s in bars:
        of_iteration = last.setdefault(iteration, {})
        of_iteration[lane] = max(of_iteration.get(lane, 0.0), end_s)
        first[iteration] = min(first.get(iteration, begin_s), begin_s)
    idle_s = 0.0
    for iteration, ends in last.items():
        end_s = max(ends.values())
        idle_s += sum(end_s - own_s for own_s in ends.values())
        idle_s += max(0, workers - len(ends)) * (end_s - first[iteration])
    return idle_s


def inside_shares(store):
    """By group: the share of the links of its clusters that come from within it. Counted in the link extents."""
    catalogue = opened(store)
    try:
        group_of = dict(catalogue.execute("SELECT id, group_id FROM clusters"))
        files = dict(catalogue.execute("SELECT id, file FROM segments"))
        extents = catalogue.execute(
            """SELECT cluster, segment, offset, bytes, max(version) FROM cluster_links WHERE delta = 0
               GROUP BY cluster ORDER BY cluster"""
        ).fetchall()
    finally:
        catalogue.close()
    step = max(1, sum(extent[3] for extent in extents) // LINK_BYTES)
    counts = {}
    for cluster, segment, offset, length, _ in extents[::step]:
        with open(os.path.join(store, "segments", os.path.basename(files[segment])), "rb") as file:
            file.seek(offset + EXTENT_HEAD_BYTES)
            inside, links = inside_links(file.read(length), group_of, group_of[cluster])
        of_group = counts.setdefault(group_of[cluster], [0, 0])
        of_group[0] += inside
        of_group[1] += links
    return {group: inside / links if links else 0.0 for group, (inside, links) in counts.items()}


def inside_links(payload, group_of, group):
    """Links of a payload that come from clusters of a group, and all."""
    count = struct.unpack_from("<Q", payload)[0]
    places = [struct.unpack_from("<2Q", payload, 8 + 16 * i) for i in range(count)]
    _, _, sides, shares, hits = (payload[at : at + length] for at, length in places)
    # The cluster is the first 24 bits of a name.
    is_inside = [group_of.get(name >> 40) == group for name in words("Q", sides)]
    inside = sum(is_inside[side] for side in words("I", hits)[::2])
    return inside, (len(shares) + len(hits)) // 8


def words(code, data):
    """Little-endian integers of a type of `array`."""
    found = array.array(code, data)
    if sys.byteorder == "big":
        found.byteswap()
    return found


def reuse(done, shares=None):
    """Share of the uses of links that find them made, over visits.

    A visit uses every link once; with each further gather all of them once more, or those from within its group alone,
    where `shares` has their share by group. Made in it are those that it stores and did not take over.
    """
    uses = made = 0.0
    for visit in done:
        again = 1.0 if shares is None else shares.get(visit["group"], 0.0)
        uses += visit["stored"] * (1.0 + max(0, visit["gathers"] - 1) * again)
        made += visit["stored"] - visit["reused"]
    return 1.0 - made / uses if uses else None


def reuse_of_store(store, shares):
    """Both shares: {every, inside}, with each gather all links or those from within the group alone."""
    catalogue = opened(store)
    try:
        done = visits(catalogue)
        return {"every": reuse(done), "inside": reuse(done, shares)}
    finally:
        catalogue.close()
