"""Score a method of your own: here a sphere that is fitted to the touched points of one grasp, by least squares.

Usage: python examples/score_a_method.py DATA FOLDER, then vt-pipeline score FOLDER DATA
"""

import sys
from pathlib import Path

import numpy as np
import trimesh

from pipeline.dataset.object_rows import ObjectRows

if len(sys.argv) != 3:
    sys.exit(__doc__)
data, folder = sys.argv[1], Path(sys.argv[2])
folder.mkdir(parents=True, exist_ok=True)
objects = ObjectRows(data, ["local_points", "local_count", "sensor_pose"], split="test")
for name in objects.object_ids:
    # (sensor, point, xyz) world frame, m, of grasp 0; how many of them each sensor touched; and where the sensors were
    points, counts, poses = (objects.read(array, name, grasp=0) for array in objects.arrays)
    touched = np.concatenate([cloud[:count] for cloud, count in zip(points, counts, strict=True)])
    touched = (touched if len(touched) >= 4 else poses[:, :3, 3]).astype(np.float64)  # nothing was felt: where the fingers are
    middle = touched.mean(axis=0)
    # |p - c|² = r² is linear in c and r² - |c|²; rcond avoids a huge sphere for a flat patch
    rows = np.column_stack([2 * (touched - middle), np.ones(len(touched))])
    centre, constant = np.split(np.linalg.lstsq(rows, np.square(touched - middle).sum(axis=1), rcond=1e-3)[0], [3])
    radius = float(np.clip(np.sqrt(max(constant[0] + centre @ centre, 0)), 0.02, 0.25))
    sphere = trimesh.creation.icosphere(subdivisions=3, radius=radius)
    sphere.apply_translation(middle + np.clip(centre, -0.25, 0.25)).export(folder / f"{name}.ply")
print(f"{len(objects)} spheres in {folder}; now: vt-pipeline score {folder} {data}")
