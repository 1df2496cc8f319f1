#!/bin/sh
# PyBullet thickens meshes and cylinders of a URDF by 1 mm, whatever collisionMargin is set.
#
# One expects: links touch where their surfaces meet, as those of boxes do, or at the margin that changeDynamics sets.
# What happens: contact with the convex hull of a mesh, and with a cylinder, begins 1 mm before its surface. changeDynamics takes
#     collisionMargin without an error, and nothing changes where a link has two shapes, an inertial frame of its own, or a joint above it.
# Whom it hurts: grasp planners that keep robot hands of meshes 1 mm clear of an object. Fingers push on what they should only approach, contact
#     jumps from face to face, and simulated fingers do not come to rest; hands of boxes do.
# Remedy: write hulls as much smaller, and load cylinders with URDF_USE_IMPLICIT_CYLINDER.
# Versions: pybullet 3.2.7, numpy 2.4.6, Python 3.11. Date: 2026-11-30.
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
corners = list(itertools.product((-0.01, 0.01), repeat=3))
quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
lines = ["v %g %g %g" % corner for corner in corners] + ["f %d %d %d %d" % tuple(i + 1 for i in quad) for quad in quads]
pathlib.Path("cube.obj").write_text("\n".join(lines) + "\n")
shapes = {"box": '<box size="0.02 0.02 0.02"/>', "mesh": '<mesh filename="cube.obj"/>', "cylinder": '<cylinder radius="0.01" length="0.02"/>'}
inertial = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
joint = '<joint name="j" type="revolute"><parent link="base"/><child link="tip"/><axis xyz="0 0 1"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>'
wall = pybullet.createCollisionShape(pybullet.GEOM_BOX, halfExtents=[0.1, 0.1, 0.1])
gaps = {}
for name, shape in shapes.items():
    collision = f"<collision><geometry>{shape}</geometry></collision>"
    text = f'<robot name="r"><link name="base">{inertial}</link><link name="tip">{inertial}{collision}</link>{joint}</robot>'
    pathlib.Path(f"{name}.urdf").write_text(text)
    body = pybullet.loadURDF(f"{name}.urdf", useFixedBase=True)
    other = pybullet.createMultiBody(0, wall, basePosition=[0.11 + 0.005, 0, 0])  # 5 mm before the shape
    before = min(point[8] for point in pybullet.getClosestPoints(body, other, 1))
    pybullet.changeDynamics(body, 0, collisionMargin=0.0)
    after = min(point[8] for point in pybullet.getClosestPoints(body, other, 1))
    gaps[name] = before, after
    print(f"{name} 5 mm from a wall: {1000 * before:.2f} mm, after collisionMargin=0: {1000 * after:.2f} mm")
    pybullet.removeBody(body)
    pybullet.removeBody(other)
surprising = abs(gaps["box"][0] - 0.005) < 1e-5 and all(abs(gap - 0.004) < 1e-5 for name in ("mesh", "cylinder") for gap in gaps[name])
raise SystemExit(not surprising)
END
