#!/bin/sh
# MeshLab reads doubles of big-endian PLY files as numbers near zero.
#
# One expects: PLY states its byte order, and `property double x` in a big-endian file is read as any other number, or refused.
# What happens: MeshLab (pymeshlab) swaps the bytes of floats and not of doubles: 1.0 is read as 3e-319. No error; the mesh has zero size.
#     trimesh writes little-endian files; scanners' software and Java tools write big-endian ones.
# Whom it hurts: scans that pass through MeshLab for decimation lose their shape; its count of faces and its topology stay right.
# Versions: pymeshlab 2025.7.post1, numpy 2.4.6, Python 3.11. Date: 2026-11-29.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
"${PYTHON:-python3.11}" -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check pymeshlab==2025.7.post1 numpy==2.4.6
cd "$folder"
venv/bin/python - <<'END'
import pathlib

import numpy as np
import pymeshlab

corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], np.float64)
faces = [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]]
largest = {}
for order, mark in (("little", "<"), ("big", ">")):
    for kind, size in (("float", 4), ("double", 8)):
        head = f"ply\nformat binary_{order}_endian 1.0\nelement vertex 4\n" + "".join(f"property {kind} {axis}\n" for axis in "xyz")
        head += "element face 4\nproperty list uchar int vertex_indices\nend_header\n"
        body = corners.astype(f"{mark}f{size}").tobytes()
        body += b"".join(b"\3" + np.array(face, f"{mark}i4").tobytes() for face in faces)
        path = pathlib.Path(f"{order}-{kind}.ply")
        path.write_bytes(head.encode() + body)
        meshes = pymeshlab.MeshSet()
        meshes.load_new_mesh(str(path))
        largest[order, kind] = float(np.abs(meshes.current_mesh().vertex_matrix()).max())
        print(f"{order}-endian {kind}: the largest coordinate is {largest[order, kind]:g}, 1 in the file")
raise SystemExit([value == 1 for value in largest.values()] != [True, True, True, False])
END
