#!/bin/sh
# tactile-mnist's square images show 14.2 mm of a gel that is 18.9 mm wide, and are taken for the whole.
#
# One expects: an image of 64 × 64 pixels shows the gel of 18.88 × 14.16 mm with pixels of 0.295 × 0.221 mm, as its environments compute.
# What happens: pyrender's OrthographicCamera ignores `xmag` when it renders: it takes ymag × width / height of the image. So every pixel is
#     0.221 mm wide, the gel's outer 2.4 mm on either side are not seen, and a plate of 16 mm fills all 64 pixels, "18.9 mm". Images of
#     320 × 240 pixels have the gel's own ratio and are right. The environments ask for 64 × 64.
# Whom it hurts: who trains on these touches beside images of a real GelSight Mini or of another simulator, or maps pixels to points.
# Versions: tactile-mnist 0.13.0, scikit-robot-pyrender 0.1.50 (pyrender 0.1.45 and pyrender-maintained 1.0.1 have the same line),
#     trimesh 5.2.0, numpy 2.4.6. Date: 2026-11-29. Needs EGL: Debian packages libegl1 libgl1 libgl1-mesa-dri.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
"${PYTHON:-python3.11}" -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check tactile-mnist==0.13.0 scikit-robot-pyrender==0.1.50 trimesh==5.2.0 \
    numpy==2.4.6 aiohttp==3.14.5
cd "$folder"
PYOPENGL_PLATFORM=egl venv/bin/python - <<'END'
from types import SimpleNamespace

import numpy as np
import trimesh
from tactile_mnist import GELSIGHT_MINI_SENSOR_SURFACE_SIZE as SURFACE
from tactile_mnist.tactile_perception_renderer import TactilePerceptionRenderer
from tactile_mnist.tactile_renderer import mk_tactile_renderer
from transformation import Transformation

PLATE = 0.016  # m wide, on the platform's middle; its top is 5 mm high
plate = SimpleNamespace(mesh=trimesh.creation.box((PLATE, 0.004, 0.005), trimesh.transformations.translation_matrix([0, 0, 0.0025])))
widths = []
for size in ((320, 240), (64, 64)):
    mm_per_pixel = tuple(1e3 * SURFACE / np.array(size))
    renderer = TactilePerceptionRenderer(1, mk_tactile_renderer("depth", "numpy"), size, mm_per_pixel)
    renderer.objects = [plate]
    depth = renderer.render_sensor_depths(Transformation.from_matrix(np.eye(4)[None]))[0]
    touched = int((depth[size[1] // 2] < -0.0025).sum())
    widths.append(touched * mm_per_pixel[0])
    print(f"{size[0]} x {size[1]}: a plate of {1e3 * PLATE:g} mm is {touched} of {size[0]} pixels wide, {widths[-1]:.2f} mm by the pixels' size")
raise SystemExit(not (abs(widths[0] - 16) < 0.2 and abs(widths[1] - 18.88) < 0.01))
END
