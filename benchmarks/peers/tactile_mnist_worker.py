"""Time tactile-mnist in an environment of its own: `python -m benchmarks.peers.tactile_mnist_worker FOLDER TURNS SIZES`.

FOLDER has cases as 0.npz, 1.npz, … with as many gel poses each; SIZES is a JSON list of [columns, rows]. For each size
`ms-COLS-ROWS.npy` gets the processor milliseconds per sensor of each turn, and `NUMBER-COLS-ROWS.npy` the surface points that its depth
maps of a case show. All cases are worlds of one renderer, as tactile-mnist makes its vector environments. This module imports nothing of
the pipeline.
"""

import json
import os
import sys
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from benchmarks.peers.taxim_shim import stand_in

CELL = 0.004
"""m, side of the platform: the camera stands twice as far behind the gel, among nothing but the sensor."""
ABOVE = 1.0
"""m, height of everything above the platform, which the sensor would see."""
TOUCHING = 1e-5
"""m, least indentation at which a pixel counts as in contact."""


def main(folder: Path, turns: int, sizes: list[list[int]]) -> None:
    """Time every size in turn, after one turn to warm up."""
    os.environ.setdefault("PYOPENGL_PLATFORM", "egl")
    stand_in()
    import trimesh
    from tactile_mnist import GELSIGHT_MINI_SENSOR_SURFACE_SIZE as SURFACE
    from tactile_mnist.tactile_perception_renderer import TactilePerceptionRenderer
    from tactile_mnist.tactile_renderer import mk_tactile_renderer
    from transformation import Transformation

    cases = [dict(np.load(folder / f"{number}.npz")) for number in range(len(list(folder.glob("*.npz"))))]
    meshes = [SimpleNamespace(mesh=trimesh.Trimesh(case["vertices"], case["faces"], process=False)) for case in cases]
    raised = np.eye(4)
    raised[2, 3] = ABOVE
    poses = np.stack([raised @ sensor_poses(case["poses"]) for case in cases], axis=1)  # (touches, cases, 4, 4)
    shader = mk_tactile_renderer("taxim", "torch", "cpu")
    renderers = {}
    for size in map(tuple, sizes):
        renderers[size] = TactilePerceptionRenderer(len(cases), shader, size, tuple(1e3 * SURFACE / size), cell_size=(CELL, CELL))
        renderers[size].objects = meshes
        renderers[size].set_object_poses(Transformation.from_matrix(np.stack([raised] * len(cases))))
    times: dict[tuple[int, ...], list[float]] = {size: [] for size in renderers}
    for turn in range(turns + 1):
        for size, renderer in renderers.items():
            start = time.process_time()
            depths = [touch(renderer, shader, size, Transformation.from_matrix(pose)) for pose in poses]
            times[size].append((time.process_time() - start) * 1e3 / (len(poses) * len(cases)))
            for number, depth in enumerate(np.stack(depths, axis=1) if turn == turns else []):
                np.save(folder / f"{number}-{size[0]}-{size[1]}.npy", points(depth, poses[:, number], SURFACE) - [0, 0, ABOVE])
    for (cols, rows), milliseconds in times.items():
        np.save(folder / f"ms-{cols}-{rows}.npy", milliseconds[1:])


def sensor_poses(gels: Any) -> Any:
    """Compute (K, 4, 4) poses of tactile-mnist's sensors, 4.25 mm above the gels' faces, from poses of those faces, z outward."""
    turned = np.diag([1.0, -1.0, -1.0, 1.0])
    turned[2, 3] = -0.00425
    return gels @ turned


def touch(renderer: Any, shader: Any, size: Any, poses: Any) -> Any:
    """Render depth and tactile image of every world once, as its environments do."""
    depth = renderer.render_sensor_depths(poses)
    shader(depth, size)
    return depth


def points(depths: Any, poses: Any, surface: Any) -> Any:
    """Compute (N, 3) world points, m, of the pixels in contact; rays are parallel, a sensor looks along its -z."""
    rows, cols = depths.shape[1:]
    x = ((np.arange(cols) + 0.5) / cols - 0.5) * surface[1] * cols / rows  # pyrender makes pixels square: findings/ tells more
    y = (0.5 - (np.arange(rows) + 0.5) / rows) * surface[1]
    number, row, col = np.nonzero(depths < 0.00425 - TOUCHING)
    local = np.stack([x[col], y[row], -depths[number, row, col].astype(np.float64), np.ones(len(row))], axis=1)
    return np.einsum("nij,nj->ni", poses[number, :3], local)


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]), json.loads(sys.argv[3]))
