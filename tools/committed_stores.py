#!/usr/bin/env python3
"""Makes data/old_stores/format_8 and data/broken_stores anew: committed_stores.py CLERESTORY DATA.

To be run when a record's bytes change their meaning before a release; later a new format gets a folder of its own,
and the old ones stay: what they are refused with is tested.
"""

import os
import shutil
import sqlite3
import subprocess
import sys

OBJ = """mtllib lamp_over_floor.mtl
v -1 -1 0
v 1 -1 0
v 1 1 0
v -1 1 0
o floor
usemtl floor
f 1 2 3 4
v -0.5 -0.5 2
v -0.5 0.5 2
v 0.5 0.5 2
v 0.5 -0.5 2
o lamp
usemtl lamp
f 5 6 7 8
"""
MTL = "newmtl floor\nKd 0.5 0.5 0.5\nnewmtl lamp\nKd 0 0 0\nKe 3 3 3\n"
LIGHT = "select segment, offset, bytes from cluster_states where cluster = 0 order by version desc"
LINKS = "select segment, offset, bytes from cluster_links where cluster = 0 order by version desc"
HEADER_BYTES = 64
# The store holds the model's path: one that is the same wherever the stores are made.
FOLDER = "/tmp/clerestory-models"


def solve(program, folder):
    """Solves the lamp over the floor; gives the store, without what opening one leaves behind."""
    with open(f"{folder}/lamp_over_floor.obj", "w") as f:
        f.write(OBJ)
    with open(f"{folder}/lamp_over_floor.mtl", "w") as f:
        f.write(MTL)
    run = ["run", "lamp_over_floor.obj", "--tolerance", "0.1", "--groups", "2", "--workers", "1", "-q"]
    subprocess.run([program, *run], cwd=folder, check=True)
    store = f"{folder}/lamp_over_floor.clr"
    # Takes away what is left of the processes that solved it.
    subprocess.run([program, "gc", store, "-q"], check=True)
    change(store)
    return store


def change(store, *statements):
    """Changes the catalogue and leaves one file."""
    db = sqlite3.connect(f"{store}/scene.sqlite", isolation_level=None)
    for statement in statements:
        db.execute(statement)
    db.execute("pragma wal_checkpoint(truncate)")
    db.execute("pragma journal_mode = delete")
    db.execute("vacuum")
    db.close()


def place(store, query):
    """Path, first byte of the payload and its length, of the extent that a query names."""
    db = sqlite3.connect(f"{store}/scene.sqlite")
    segment, offset, length = db.execute(query).fetchone()
    (file,) = db.execute("select file from segments where id = ?", [segment]).fetchone()
    db.close()
    return f"{store}/segments/{os.path.basename(file)}", offset + HEADER_BYTES, length


def copy(store, to):
    """The catalogue and the segments alone, not locks and logs."""
    shutil.rmtree(to, ignore_errors=True)
    os.makedirs(f"{to}/segments")
    shutil.copy(f"{store}/scene.sqlite", to)
    for name in os.listdir(f"{store}/segments"):
        shutil.copy(f"{store}/segments/{name}", f"{to}/segments")
    return to


def flip_a_bit(store):
    path, start, length = place(store, LIGHT)
    with open(path, "r+b") as f:
        f.seek(start + length // 2)
        byte = f.read(1)[0]
        f.seek(start + length // 2)
        f.write(bytes([byte ^ 1]))


def cut_off(store):
    path, start, length = place(store, LINKS)
    os.truncate(path, start + length // 2)


def main():
    program, data = os.path.abspath(sys.argv[1]), sys.argv[2]
    os.makedirs(FOLDER)
    try:
        whole = copy(solve(program, FOLDER), f"{data}/old_stores/format_8")
    finally:
        shutil.rmtree(FOLDER)
    broken = f"{data}/broken_stores"
    flip_a_bit(copy(whole, f"{broken}/flipped_bit"))
    cut_off(copy(whole, f"{broken}/cut_off_segment"))
    missing = copy(whole, f"{broken}/missing_segment")
    os.remove(place(missing, "select segment, offset, bytes from cluster_materials where cluster = 0")[0])
    change(
        copy(whole, f"{broken}/foreign_row"),
        "update clusters set geometry_offset = (select geometry_offset from clusters where id = 1) where id = 0",
    )
    change(copy(whole, f"{broken}/lost_light"), "delete from cluster_states where cluster = 1")
    change(copy(whole, f"{broken}/newer_format"), "pragma user_version = 99")
    change(copy(whole, f"{broken}/deleted_cluster"), "delete from clusters where id = 1")
    change(copy(whole, f"{broken}/changed_model"), "update model set max_reflectance = 1e300")


main()
