"""Time TACTO in an environment of its own: `python -m benchmarks.peers.tacto_worker FOLDER TURNS SIZES`.

FOLDER has cases as 0.npz, 1.npz, …; SIZES is a JSON list of [width, height]. For each size `ms-WIDTH-HEIGHT.npy` gets the processor
milliseconds per sensor of each turn, and `NUMBER-WIDTH-HEIGHT.npy` the surface points that TACTO's depth maps of a case show. This
module imports nothing of the pipeline, which is not installed there.

TACTO 0.0.3 pins networkx 2.2, which does not import since Python 3.10: `requirements-tacto.txt` does not ask for the pins. It uses
`np.float` and `np.infty`, which numpy no longer has; `main` puts them back. No installed file is edited.
"""

import itertools
import json
import os
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

GEL = np.array([0.022, 0.0, 0.015])
"""The middle of a DIGIT's gel in TACTO's sensor frame, m (`config_digit.yml`), whose +x is the outward normal."""
TOUCHING = 1e-5
"""m, least indentation at which a pixel counts as in contact."""


def main(folder: Path, turns: int, sizes: list[list[int]]) -> None:
    """Time every size in turn, after one turn to warm up."""
    os.environ.setdefault("PYOPENGL_PLATFORM", "egl")
    vars(np).setdefault("float", float)
    vars(np).setdefault("infty", np.inf)
    import tacto
    import trimesh

    cases = [dict(np.load(folder / f"{number}.npz")) for number in range(len(list(folder.glob("*.npz"))))]
    poses = [[tacto_pose(pose, float(case["w"])) for pose in case["poses"]] for case in cases]
    meshes = {str(number): trimesh.Trimesh(case["vertices"], case["faces"], process=False) for number, case in enumerate(cases)}
    renderers = {(width, height): tacto.Renderer(width, height, None, tacto.get_digit_config_path()) for width, height in sizes}
    for renderer, (name, mesh) in itertools.product(renderers.values(), meshes.items()):
        renderer.add_object(mesh, name)
    times: dict[tuple[int, int], list[float]] = {size: [] for size in renderers}
    for turn in range(turns + 1):
        for size, renderer in renderers.items():
            start = time.process_time()
            images = [[touch(renderer, number, *pose) for pose in case_poses] for number, case_poses in enumerate(poses)]
            times[size].append((time.process_time() - start) * 1e3 / sum(map(len, poses)))
            for number, case_images in enumerate(images if turn == turns else []):
                np.save(folder / f"{number}-{size[0]}-{size[1]}.npy", np.concatenate([points(renderer, *image) for image in case_images]))
    for (width, height), milliseconds in times.items():
        np.save(folder / f"ms-{width}-{height}.npy", milliseconds[1:])


def tacto_pose(pose: Any, gel: float) -> tuple[Any, Any]:
    """Compute position and Euler angles ("xyz") of TACTO's sensor frame, the middle of its gel in that of ours, `gel` m above the base."""
    from scipy.spatial.transform import Rotation

    axes = pose[:3, [2, 0, 1]]  # its x is our z, its y our x, its z our y
    position = pose[:3, 3] + gel * pose[:3, 2] - axes @ GEL
    return position, Rotation.from_matrix(axes).as_euler("xyz")


def touch(renderer: Any, case: int, position: Any, angles: Any) -> tuple[Any, Any, Any]:
    """Render camera, depth and indentation of one sensor by the steps of `tacto.Sensor.render`, without its queries to PyBullet."""
    renderer.update_camera_pose(position, angles)
    _, depths = renderer.render({str(case): ([0, 0, 0], [0, 0, 0])}, {str(case): 0.0})  # no force: the object stays where it is
    return renderer.camera_nodes[0].matrix, depths[0], renderer.depth0[0] - depths[0]


def points(renderer: Any, camera: Any, depth: Any, pressed: Any) -> Any:
    """Compute (N, 3) world points, m, of the pixels in contact; the camera looks along its -z."""
    height, width = depth.shape
    tangent = np.tan(renderer.camera_nodes[0].camera.yfov / 2)
    row, col = np.nonzero((pressed > TOUCHING) & (depth > 0))
    distance = depth[row, col].astype(np.float64)
    x = ((col + 0.5) / width * 2 - 1) * tangent * width / height
    y = (1 - (row + 0.5) / height * 2) * tangent
    return np.stack([x * distance, y * distance, -distance], axis=1) @ camera[:3, :3].T + camera[:3, 3]


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]), json.loads(sys.argv[3]))
