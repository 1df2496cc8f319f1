"""Time tactile images of a sensor pressed onto a mesh, exact depth included: `python benchmarks/gel_images.py KIND ROWS COLUMNS`.

`benchmarks.before` runs this file in checkouts of other commits, so it uses the library alone. It prints processor seconds per image.
"""

import sys
import time
from typing import Any

import numpy as np
import trimesh

import vt_pipeline as vt

TOUCHES = 40
GEL: dict[str, dict[str, Any]] = {
    "elastic": {"membrane": 0.0, "gel": {"modulus": 2e5}},  # a gel of 4 mm
    "membrane": {"membrane": 9e-4, "gel": None},  # with the shadows of the shipped GelSight
}


def main(kind: str, rows: int, columns: int) -> None:
    """Press the sensor onto a torus of 20,000 faces at several places and depths, once to warm up."""
    shipped = vt.load_sensor("gelsight", shape=(rows, columns))
    sensor = type(shipped).model_validate(shipped.model_dump() | GEL[kind])
    shape = trimesh.creation.torus(0.03, 0.008, major_sections=200, minor_sections=50)
    torus = vt.load_object((shape.vertices, shape.faces))
    rng = np.random.default_rng(0)
    poses = np.tile(np.diag([1.0, -1.0, -1.0, 1.0]), (TOUCHES, 1, 1))  # the sensor faces down
    angle, radius = rng.uniform(0, 2 * np.pi, TOUCHES), rng.uniform(0.027, 0.033, TOUCHES)
    poses[:, :2, 3] = radius[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    poses[:, 2, 3] = 0.008 + sensor.w - rng.uniform(0.2e-3, 1e-3, TOUCHES)
    images = vt.touch_many(torus, sensor, poses, workers=1).image
    if not (images != vt.untouched_image(sensor)).any(axis=(1, 2, 3)).all():
        raise SystemExit("a touch leaves no mark")
    began = time.process_time()
    vt.touch_many(torus, sensor, poses, workers=1)
    print((time.process_time() - began) / TOUCHES)


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]), int(sys.argv[3]))
