"""What `simulate-touch` left out: faces that no ray can meet, and points that follow from depth and pose."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from pipeline.dataset.mesh_rows import read_mesh
from pipeline.engine.stage import Inputs
from pipeline.engine.unit import Unit
from pipeline.formats.sensor_file import load_worn_sensors
from pipeline.kernels.touch.face_culling import box_faces, cull_faces
from pipeline.kernels.touch.sphere_tracing import trace_spheres
from pipeline.tradeoff.explain import Count
from stages.simulate_touch.settings import TouchSettings


def explain(settings: TouchSettings, models: Mapping[str, Path], units: Sequence[tuple[Unit, Inputs]]) -> Iterator[Count]:
    """Count faces, rays and points of every sensor of these objects."""
    sensors = load_worn_sensors(settings.sensors or ())
    for _, inputs in units:
        faces = box_faces(read_mesh(inputs["surfaces"]).triangles)
        poses = inputs["grasps"]["sensor_pose"]
        near = [(cull_faces(faces, pose, sensor), sensor) for grasp in poses for pose, sensor in zip(grasp, sensors, strict=True)]
        for local, sensor in near:
            culled = faces.corners.shape[2] - local.shape[2]
            yield Count("faces taken to a sensor", local.shape[2], culled, "outside the prism of the sensor's rays", "prism")
            if settings.tracer == "sphere":
                settled = int(trace_spheres(local, sensor, tolerance=settings.sphere_tolerance, max_steps=settings.sphere_steps)[1].sum())
                walls = sensor.rows * sensor.cols - settled
                yield Count("rays traced by spheres alone", settled, walls, "they run along walls and are intersected exactly")
        blind = sum(local.shape[2] == 0 for local, _ in near)
        yield Count("sensors traced", len(near) - blind, blind, "no face within range")
        points = sum(sensor.rows * sensor.cols for _, sensor in near)
        kept = points if settings.store_points else 0
        yield Count("local points stored", kept, points - kept, "depth and pose give them again, bit for bit")
