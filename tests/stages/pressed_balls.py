"""Balls pressed into a small sensor, and stages that store them; without torch, which every worker would import."""

from typing import Any

import numpy as np

from pipeline.config.settings import Settings
from pipeline.engine.stage import Cost, Inputs, ObjectStage, Unit
from pipeline.kernels.touch.depth_maps import touch_success
from pipeline.kernels.touch.ray_depth import box_faces, ray_depth
from pipeline.kernels.touch.tactile_image import tactile_image, untouched_image
from pipeline.store.rows import Row
from schemas.base import Artifact
from schemas.grasps import GRASPS
from tests.kernels.touch.shapes import ball, coarse

SENSOR = coarse(20)
GRASPS_EACH, SENSORS = 2, 3


def press(rng: np.random.Generator) -> np.ndarray:
    """Depth (20, 20) of a ball somewhere over the sensor, 0.5 to 3 mm in its gel."""
    radius, pressed = rng.uniform(0.006, 0.02), rng.uniform(0.0005, 0.003)
    x, y = rng.uniform(-0.004, 0.004, 2)
    faces = box_faces(ball(3, radius, x, y, SENSOR.w - pressed + radius))
    return ray_depth(faces, np.eye(4), SENSOR).astype(np.float32)


def depths(rng: np.random.Generator, touching: bool = True) -> np.ndarray:
    """(grasp, sensor, 20, 20): one sensor of three touches nothing, or none touches anything."""
    depth = np.full((GRASPS_EACH, SENSORS, *SENSOR.shape), np.inf, np.float32)
    for grasp, sensor in np.ndindex(GRASPS_EACH, SENSORS - 1):
        if touching:
            depth[grasp, sensor] = press(rng)
    return depth


class Made(ObjectStage):
    """Object stage that stores given arrays in place of the real stage of that name."""

    settings_type = Settings
    summary = "press balls"

    def __init__(self, name: str, output: Artifact) -> None:
        self.name, self.output = name, output

    def inputs(self, settings: Settings) -> tuple[Artifact, ...]:
        return () if self.output.name == "grasps" else (GRASPS,)

    def constants(self, settings: Settings) -> Row:
        return {"untouched": np.stack([untouched_image(SENSOR)] * SENSORS)} if self.output.name == "touch" else {}

    def attributes(self, settings: Settings) -> dict[str, Any]:
        return {"sensors": [SENSOR.model_dump(mode="json")] * SENSORS} if self.output.name == "touch" else {}

    def cost(self, settings: Settings) -> Cost:
        return Cost(0.01, 1)

    def process(self, unit: Unit, inputs: Inputs, settings: Settings) -> Row:
        depth = depths(unit.rng("balls"))
        if self.output.name == "touch":
            images = [tactile_image(image, SENSOR) for image in depth.reshape(-1, *SENSOR.shape)]
            return {"depth": depth, "tactile_image": np.stack(images).reshape(*depth.shape, 3)}
        return {
            "hand_pose": np.tile(np.eye(4), (GRASPS_EACH, 1, 1)),
            **{f"{posture}_angles": np.zeros((GRASPS_EACH, 16)) for posture in ("pregrasp", "joint", "squeeze")},
            "sensor_pose": np.tile(np.eye(4), (GRASPS_EACH, SENSORS, 1, 1)),
            "touch_success": touch_success(depth, SENSOR),
            **{f"contact_{name}": np.zeros((GRASPS_EACH, SENSORS, 3)) for name in ("point", "normal")},
            "contact_area": np.zeros((GRASPS_EACH, SENSORS)),
            **{name: np.zeros(GRASPS_EACH) for name in ("opposition", "closure", "penetration")},
            "attempts": np.asarray(GRASPS_EACH, np.int32),
            "attempt_success": np.ones(SENSORS),
        }
