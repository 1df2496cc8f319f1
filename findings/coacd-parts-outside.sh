#!/bin/sh
# coacd's parts of a mesh that is no manifold are thicker than the mesh.
#
# One expects: convex parts that together have the shape of the mesh, or lie within it, up to the threshold of concavity.
# What happens: an edge between more than two faces, as where two boxes meet, makes coacd's default (preprocess_mode="auto") replace the whole
#     mesh by a level set that lies outside it by 0.55 voxels of its grid (resolution 50). All parts are larger by 0.55 % of the object's extent on
#     every side, far from that edge too; with "off" this mesh has exact parts.
# Whom it hurts: an object of 15 cm is 1.6 mm thicker everywhere, one of 50 cm 5 mm: simulated fingers touch air beside it.
# Versions: coacd 1.0.14, numpy 2.4.6. Date: 2026-11-29.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
"${PYTHON:-python3.11}" -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check coacd==1.0.14 numpy==2.4.6
cd "$folder"
venv/bin/python - <<'END'
import itertools

import coacd
import numpy as np

QUADS = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
coacd.set_log_level("error")


def boxes(*corners):
    points = [point for low, high in corners for point in itertools.product(*zip(low, high))]
    faces = [[8 * box + quad[k] for k in (0, i, i + 1)] for box in range(len(corners)) for quad in QUADS for i in (1, 2)]
    unique, number = np.unique(points, axis=0, return_inverse=True)
    return unique, number.reshape(-1)[faces]


outside = {}
for name, second in (("apart", 0.08), ("sharing an edge", 0.075)):
    vertices, faces = boxes(((0, 0, 0), (0.075, 0.075, 0.075)), ((second, second, 0), (0.15, 0.15, 0.075)))
    for mode in ("auto", "off"):
        found = coacd.run_coacd(coacd.Mesh(vertices, faces), seed=0, preprocess_mode=mode)
        points = np.concatenate([part for part, _ in found])
        beyond = np.maximum(vertices.min(axis=0) - points, points - vertices.max(axis=0)).clip(min=0)
        outside[name, mode] = 1000 * beyond.max()
        print(f"two boxes {name}, {mode}: {len(found)} parts, {outside[name, mode]:.2f} mm beyond the sides")
thicker = outside.pop(("sharing an edge", "auto"))
raise SystemExit(not (0.7 < thicker < 1 and max(outside.values()) < 0.01))
END
