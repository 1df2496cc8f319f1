#!/bin/sh
# PyBullet replaces a URDF's inertia by that of a box 6 mm larger than the link.
#
# One expects: loadURDF takes the <inertia> that the file states; where it computes one, a cube of edge e has m e² / 6.
# What happens: the stated inertia is ignored unless URDF_USE_INERTIA_FROM_FILE is given, and the one of a mesh (its convex hull) is that of a
#     cube of edge e + 6 mm: a collision margin of 3 mm is counted on every side. Mass stays as stated. Boxes (GEOM_BOX) have no such margin.
# Whom it hurts: finger links of robot hands are 1 to 5 cm long; their inertia is 1.25 to 2.6 times too large, so that fingers accelerate and
#     settle differently than in MuJoCo or Drake, which read the same file.
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

pybullet.connect(pybullet.DIRECT)
surprises = 0
for edge in (0.01, 0.02, 0.05):
    corners = list(itertools.product((-edge / 2, edge / 2), repeat=3))
    quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    lines = ["v %g %g %g" % corner for corner in corners] + ["f %d %d %d %d" % tuple(i + 1 for i in quad) for quad in quads]
    pathlib.Path(f"cube-{edge}.obj").write_text("\n".join(lines) + "\n")
    stated = edge**2 / 6
    pathlib.Path(f"link-{edge}.urdf").write_text(
        '<robot name="r"><link name="link"><inertial><mass value="1"/>'
        f'<inertia ixx="{stated}" iyy="{stated}" izz="{stated}" ixy="0" ixz="0" iyz="0"/></inertial>'
        f'<collision><geometry><mesh filename="cube-{edge}.obj"/></geometry></collision></link></robot>'
    )
    default, from_file = (
        pybullet.getDynamicsInfo(pybullet.loadURDF(f"link-{edge}.urdf", flags=flags), -1)[2][0]
        for flags in (0, pybullet.URDF_USE_INERTIA_FROM_FILE)
    )
    surplus = (6 * default) ** 0.5 - edge
    print(f"cube of {edge} m: stated {stated:.3g} kg m², loaded {default:.3g} ({default / stated:.2f} times), as a cube of edge + {1000 * surplus:.2f} mm")
    surprises += abs(surplus - 0.006) < 1e-4 and abs(from_file / stated - 1) < 1e-6
raise SystemExit(surprises != 3)
END
