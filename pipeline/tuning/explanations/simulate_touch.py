"""What `simulate-touch` left out: faces no ray can meet, readings of nothing, points that depth and pose give again."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from pipeline.config.sensor_file import load_sensor
from pipeline.engine.stage import Task
from pipeline.kernels.touch.face_culling import BLOCK, cull_faces, face_blocks
from pipeline.kernels.touch.sensor import Sensor
from pipeline.kernels.touch.sphere_tracing import march
from pipeline.kernels.touch.tactile_image import impression
from pipeline.tuning.explain import Count
from stages.simulate_touch.settings import TouchSettings


def explain(settings: TouchSettings, models: Mapping[str, Path], tasks: Sequence[Task]) -> Iterator[Count]:
    """Count faces, rays and readings of every sensor of these objects."""
    sensor = load_sensor(settings.sensor)
    for task in tasks:
        blocks = face_blocks(task.mesh().triangles)
        faces = blocks.corners.shape[2] * BLOCK
        poses = task.inputs["grasps"]["sensor_pose"].reshape(-1, 4, 4)
        seen = [cull_faces(blocks, pose, sensor) for pose in poses]
        for local in seen:
            yield Count("faces taken to a sensor", local.shape[2], faces - local.shape[2], "outside the prism of its rays", "prism")
            if settings.tracer == "sphere":
                yield _marched(local, sensor, settings)
        blind = sum(local.shape[2] == 0 for local in seen)
        yield Count("sensors traced", len(seen) - blind, blind, "no face within range")
        shaded = sum(bool(impression(depth, sensor).any()) for depth in task.inputs["touch"]["depth"].reshape(-1, *sensor.shape))
        yield Count("readings shaded", shaded, len(seen) - shaded, "nothing is in the gel: the untouched reading", "untouched reading")
        points = len(seen) * sensor.rows * sensor.cols
        kept = points if settings.store_points else 0
        yield Count("local points stored", kept, points - kept, "depth and pose give them again, bit for bit")


def _marched(local: np.ndarray, sensor: Sensor, settings: TouchSettings) -> Count:
    settled = int(march(local, sensor, settings.sphere_tolerance, settings.sphere_steps)[1].sum())
    return Count("rays marched", settled, sensor.rows * sensor.cols - settled, "they run along walls and are intersected exactly")
