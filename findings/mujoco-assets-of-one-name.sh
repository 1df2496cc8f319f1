#!/bin/sh
# MuJoCo's MjSpec gives meshes of one file name in different folders the same shape.
#
# One expects: `MjSpec.from_string(xml, assets=...)` finds `index/tip.stl` and `thumb/tip.stl` under these names, with or without a `meshdir`, or
#     refuses them, as `MjModel.from_xml_string` does ("Repeated file name in assets dict").
# What happens: with a `meshdir`, which names in `assets` may omit, folders are dropped from the names: both meshes get the last file's content,
#     and nothing is said. With the `meshdir` in the names, or without one, both are right.
# Whom it hurts: hands whose fingers have folders of their own, read from memory (an archive, a download): every finger gets one finger's tip.
# Versions: mujoco 4.0.0 (3.17.0 is the same), numpy 2.4.6, Python 3.11. Date: 2026-11-29.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
"${PYTHON:-python3.11}" -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check mujoco==4.0.0 numpy==2.4.6
cd "$folder"
venv/bin/python - <<'END'
import itertools
import struct

import mujoco
import numpy as np

FACES = [(0, 1, 3), (0, 3, 2), (4, 6, 7), (4, 7, 5), (0, 4, 5), (0, 5, 1), (2, 3, 7), (2, 7, 6), (0, 2, 6), (0, 6, 4), (1, 5, 7), (1, 7, 3)]
HAND = (
    '<mujoco><compiler DIRECTORY/><asset><mesh name="index" file="index/tip.stl"/><mesh name="thumb" file="thumb/tip.stl"/></asset>'
    '<worldbody><geom type="mesh" mesh="index"/><geom type="mesh" mesh="thumb"/></worldbody></mujoco>'
)


def cube(side):  # m, as binary STL
    corners = np.array(list(itertools.product((-side / 2, side / 2), repeat=3)))
    faces = (struct.pack("<12fH", 0, 0, 0, *corners[list(face)].ravel(), 0) for face in FACES)
    return bytes(80) + struct.pack("<I", len(FACES)) + b"".join(faces)


def sides(directory, before):  # m, of both tips
    assets = {f"{before}index/tip.stl": cube(0.02), f"{before}thumb/tip.stl": cube(0.06)}
    model = mujoco.MjSpec.from_string(HAND.replace("DIRECTORY", directory), assets=assets).compile()
    tips = (model.mesh_vert[first : first + count] for first, count in zip(model.mesh_vertadr, model.mesh_vertnum))
    return [round(float(np.ptp(tip[:, 0])), 3) for tip in tips]


seen = [sides("", ""), sides('meshdir="meshes"', "meshes/"), sides('meshdir="meshes"', "")]
for how, tips in zip(("no meshdir", "meshdir in the names", "meshdir, names without it"), seen):
    print(f"{how}: sides of the tips {tips} m")
raise SystemExit(seen != [[0.02, 0.06], [0.02, 0.06], [0.06, 0.06]])
END
