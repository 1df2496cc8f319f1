#!/bin/sh
# PyBullet loads the old shape of a mesh file that was written again.
#
# One expects: createCollisionShape(fileName=...) and loadURDF read the file that is there, at the latest after resetSimulation.
# What happens: files are cached by path for the life of a client. New content at an old path gives the old shape, also after resetSimulation;
#     nothing is said. A new client reads the file; setPhysicsEngineParameter(enableFileCaching=0) stops the cache.
# Whom it hurts: pipelines that write one object after the other to the same temporary file grasp the first object every time.
# Versions: pybullet 3.2.7, numpy 2.4.6, Python 3.11. Date: 2026-11-29.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
"${PYTHON:-python3.11}" -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check pybullet==3.2.7 numpy==2.4.6
cd "$folder"
venv/bin/python - <<'END'
import itertools
import pathlib

import pybullet


def write_cube(edge: float) -> None:
    corners = itertools.product((-edge / 2, edge / 2), repeat=3)
    quads = [[1, 2, 4, 3], [5, 7, 8, 6], [1, 5, 6, 2], [3, 4, 8, 7], [1, 3, 7, 5], [2, 6, 8, 4]]
    lines = ["v %g %g %g" % corner for corner in corners] + ["f %d %d %d %d" % tuple(quad) for quad in quads]
    pathlib.Path("object.obj").write_text("\n".join(lines) + "\n")


def loaded_edge() -> float:
    body = pybullet.createMultiBody(1, pybullet.createCollisionShape(pybullet.GEOM_MESH, fileName="object.obj"))
    low, high = pybullet.getAABB(body)
    return high[0] - low[0]


pybullet.connect(pybullet.DIRECT)
write_cube(0.1)
first = loaded_edge()
write_cube(0.3)
again = loaded_edge()
pybullet.resetSimulation()
after_reset = loaded_edge()
pybullet.disconnect()
pybullet.connect(pybullet.DIRECT)
new_client = loaded_edge()
pybullet.setPhysicsEngineParameter(enableFileCaching=0)
write_cube(0.5)
uncached = loaded_edge()
print(f"a cube of 0.1 m: {first:.3f}; the file now holds one of 0.3 m: {again:.3f}, after a reset {after_reset:.3f},")
print(f"in a new client {new_client:.3f}; one of 0.5 m without the cache: {uncached:.3f} (bounding boxes, 2 mm of margin on each side)")
raise SystemExit(not (first == again == after_reset < 0.11 and new_client > 0.29 and uncached > 0.49))
END
