#!/usr/bin/env python3
"""Writes a large OBJ with its MTL: big_obj.py OUT.obj BYTES (`1G`, `300M`).

Storeys of furnished rooms on a grid: per room an object of walls, a lamp, and a finely cut table top, so
that polygons, objects and vertices all grow with the size.
"""

import os
import sys

ROOM_M = (6.0, 5.0, 3.0)
ROOMS_A_SIDE = 40
CUTS = 24


def size(text):
    unit = {"K": 10, "M": 20, "G": 30}.get(text[-1].upper())
    return int(text[:-1]) << unit if unit else int(text)


def box(low, high, first, inwards):
    """Vertices and faces of a box; `first` is the number of its first vertex."""
    corners = [[(low, high)[i >> axis & 1][axis] for axis in range(3)] for i in range(8)]
    faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return corners, [[first + c for c in (face if inwards else face[::-1])] for face in faces]


def grid(low, high, z, first):
    """A horizontal rectangle cut into CUTS x CUTS quads that look up."""
    steps = [i / CUTS for i in range(CUTS + 1)]
    corners = [
        (low[0] + u * (high[0] - low[0]), low[1] + v * (high[1] - low[1]), z) for v in steps for u in steps
    ]
    row = CUTS + 1
    faces = [
        [first + j * row + i + at for at in (0, 1, row + 1, row)] for j in range(CUTS) for i in range(CUTS)
    ]
    return corners, faces


def room(number):
    """The objects of a room: name, material, and how to make it."""
    storey, place = divmod(number, ROOMS_A_SIDE**2)
    row, column = divmod(place, ROOMS_A_SIDE)
    at = (column * ROOM_M[0], row * ROOM_M[1], storey * ROOM_M[2])
    end = tuple(a + m - 0.2 for a, m in zip(at, ROOM_M))
    lamp = (at[0] + 2.0, at[1] + 2.0, end[2] - 0.15)
    yield "walls", "wall", lambda first: box(at, end, first, True)
    yield "lamp", "light", lambda first: box(lamp, (lamp[0] + 1.2, lamp[1] + 0.3, end[2] - 0.1), first, False)
    yield "table", "wood", lambda first: grid((at[0] + 1, at[1] + 1), (at[0] + 3, at[1] + 2), at[2] + 0.75, first)


def main():
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    path, wanted = sys.argv[1], size(sys.argv[2])
    mtl = os.path.splitext(path)[0] + ".mtl"
    with open(mtl, "w") as out:
        out.write("newmtl wall\nKd 0.7 0.7 0.65\nnewmtl wood\nKd 0.4 0.3 0.2\nnewmtl light\nKd 0 0 0\nKe 10 10 9\n")
    with open(path, "w", buffering=1 << 20) as out:
        out.write(f"mtllib {os.path.basename(mtl)}\n")
        first, number, written = 1, 0, 0
        while written < wanted:
            text = []
            for name, material, make in room(number):
                corners, faces = make(first)
                first += len(corners)
                text.append(f"o {name}{number}\nusemtl {material}\n")
                text.extend(f"v {x:.6f} {y:.6f} {z:.6f}\n" for x, y, z in corners)
                text.extend("f " + " ".join(map(str, face)) + "\n" for face in faces)
            chunk = "".join(text)
            written += len(chunk)
            out.write(chunk)
            number += 1
    print(f"{path}: {number} rooms, {first - 1} vertices")


if __name__ == "__main__":
    main()
