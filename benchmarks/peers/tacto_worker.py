"""TACTO in an environment of its own: renders the sensors of a case when asked. `python -m benchmarks.peers.tacto_worker CASES…`.

A request is a JSON line {"size": [width, height], "case": index}; the answer {"ms": …} is the mean of the case's sensors, processor time.
With "points": PATH the surface points that TACTO's depth maps show are written there. Imports nothing of the pipeline: this runs
where it is not installed.
"""

from __future__ import annotations

import json
import os
import sys
import time
from typing import Any, TextIO

import numpy as np

from benchmarks.peers.tacto_shim import restore

GEL = np.array([0.022, 0.0, 0.015])
"""Where the middle of a DIGIT's gel is in TACTO's sensor frame, m (`config_digit.yml`), whose +x is the outward normal."""
TOUCHING = 1e-5
"""m, by which the object must stand in the gel for a pixel to show it and not the gel."""


def main(paths: list[str]) -> None:
    """Answer requests until standard input ends."""
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # what libraries print must not come between the answers
    shimmed = restore()
    cases = [dict(np.load(path)) for path in paths]
    say(answers, {"ready": True, "shimmed": shimmed})
    renderers: dict[tuple[int, int], Any] = {}
    for line in sys.stdin:
        request = json.loads(line)
        width, height = request["size"]
        if (width, height) not in renderers:
            renderers[width, height] = renderer(width, height, cases)
        made, case = renderers[width, height], request["case"]
        poses = [tacto_pose(pose, float(cases[case]["w"])) for pose in cases[case]["poses"]]
        touch(made, case, *poses[0])  # the first image of an object uploads it
        start = time.process_time()
        images = [touch(made, case, *pose) for pose in poses]
        milliseconds = (time.process_time() - start) * 1e3 / len(poses)
        if "points" in request:
            np.save(request["points"], np.concatenate([points(made, *image) for image in images]))
        say(answers, {"ms": milliseconds})


def say(answers: TextIO, answer: dict[str, Any]) -> None:
    print(json.dumps(answer), file=answers, flush=True)


def renderer(width: int, height: int, cases: list[dict[str, Any]]) -> Any:
    """A DIGIT as TACTO describes it, with every object in its scene."""
    import tacto
    import trimesh

    made = tacto.Renderer(width, height, None, tacto.get_digit_config_path())
    for number, case in enumerate(cases):
        made.add_object(trimesh.Trimesh(case["vertices"], case["faces"], process=False), str(number))
    return made


def tacto_pose(pose: Any, gel: float) -> tuple[Any, Any]:
    """Position and Euler angles ("xyz") of TACTO's sensor frame: its gel's middle in the middle of ours, `gel` m above the sensor plane."""
    from scipy.spatial.transform import Rotation

    axes = pose[:3, [2, 0, 1]]  # its x is our z, its y our x, its z our y
    position = pose[:3, 3] + gel * pose[:3, 2] - axes @ GEL
    return position, Rotation.from_matrix(axes).as_euler("xyz")


def touch(made: Any, case: int, position: Any, angles: Any) -> tuple[Any, Any, Any]:
    """Camera, depth and indentation of one sensor, by the steps of `tacto.Sensor.render` without its queries to PyBullet."""
    name = str(case)
    made.update_camera_pose(position, angles)
    _, depths = made.render({name: ([0, 0, 0], [0, 0, 0])}, {name: 0.0})  # no force: the object stays where it is
    pressed = made.depth0[0] - depths[0]
    return made.camera_nodes[0].matrix, depths[0], pressed


def points(made: Any, camera: Any, depth: Any, pressed: Any) -> Any:
    """(N, 3) world points, m, of the pixels in which the object stands in the gel; the camera looks along its -z."""
    height, width = depth.shape
    half = np.tan(made.camera_nodes[0].camera.yfov / 2)
    row, col = np.nonzero((pressed > TOUCHING) & (depth > 0))
    far = depth[row, col].astype(np.float64)
    x = ((col + 0.5) / width * 2 - 1) * half * width / height
    y = (1 - (row + 0.5) / height * 2) * half
    return np.stack([x * far, y * far, -far], axis=1) @ camera[:3, :3].T + camera[:3, 3]


if __name__ == "__main__":
    main(sys.argv[1:])
