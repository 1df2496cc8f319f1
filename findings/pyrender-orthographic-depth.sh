#!/bin/sh
# pyrender's depth is no distance for an orthographic camera.
#
# One expects: OffscreenRenderer.render returns depth in the scene's unit along the view axis, whatever the camera.
# What happens: the depth buffer of an OrthographicCamera is converted by the formula of a perspective one. A plane 3 m away reads 0.141
#     (znear 0.1, zfar 10); a perspective camera reads 3.000. No warning. Distance d reads n f / (f + n - d) with znear n and zfar f.
# Whom it hurts: simulated tactile sensors are orthographic depth cameras; a gel pressed by a plane reads a wrong, non-linear indentation.
# Versions: pyrender-maintained 1.0.1 (pyrender 0.1.45 is the same here), PyOpenGL 3.1.10, numpy 2.4.6, trimesh 5.2.0. Date: 2026-11-29.
# Needs EGL: Debian packages libegl1 libgl1 libgl1-mesa-dri.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
"${PYTHON:-python3.11}" -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check pyrender-maintained==1.0.1 PyOpenGL==3.1.10 numpy==2.4.6 trimesh==5.2.0
cd "$folder"
PYOPENGL_PLATFORM=egl venv/bin/python - <<'END'
import numpy as np
import pyrender
import trimesh

NEAR, FAR, DISTANCE = 0.1, 10.0, 3.0
cameras = (
    pyrender.OrthographicCamera(xmag=1, ymag=1, znear=NEAR, zfar=FAR),
    pyrender.PerspectiveCamera(yfov=0.5, znear=NEAR, zfar=FAR),
)
read = []
for camera in cameras:
    scene = pyrender.Scene()
    scene.add(pyrender.Mesh.from_trimesh(trimesh.creation.box((2, 2, 0.2))))
    pose = np.eye(4)
    pose[2, 3] = 0.1 + DISTANCE
    scene.add(camera, pose=pose)
    renderer = pyrender.OffscreenRenderer(9, 9)
    depth = renderer.render(scene)[1]
    renderer.delete()
    read.append(float(depth[4, 4]))
    print(f"{type(camera).__name__}: a plane {DISTANCE} m away reads {read[-1]:.4f}")
wrong = NEAR * FAR / (FAR + NEAR - DISTANCE)
raise SystemExit(not (abs(read[0] - wrong) < 1e-3 and abs(read[1] - DISTANCE) < 1e-3))
END
