"""`simulate-touch`: every sensor's depth map, and the tactile image and local points that follow from it (supplement 1.5)."""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.dataset.mesh_rows import read_mesh
from pipeline.engine.keys import assets_digest
from pipeline.engine.stage import Cost, Inputs, ObjectStage
from pipeline.engine.unit import Unit
from pipeline.errors import InvalidInput
from pipeline.formats.sensor_file import load_worn_sensors, sensor_files
from pipeline.kernels.touch.depth_maps import local_points, quantise_depth
from pipeline.kernels.touch.pressed_gel import normal_force, press_gel
from pipeline.kernels.touch.ray_depth import BoxedFaces, box_faces, ray_depth
from pipeline.kernels.touch.sensor import Sensor
from pipeline.kernels.touch.sphere_tracing import sphere_traced_depth
from pipeline.kernels.touch.tactile_image import render_gel, untouched_image
from pipeline.store.rows import Row
from schemas.base import Artifact
from schemas.grasps import GRASPS
from schemas.surfaces import SURFACES
from schemas.touch import TOUCH
from stages.simulate_touch.settings import TouchSettings


class SimulateTouch(ObjectStage):
    """Simulate the measurement of every sensor of every grasp."""

    name = "simulate-touch"
    summary = "Depth map and tactile image of every sensor of every grasp."
    output = TOUCH
    settings_type = TouchSettings

    def inputs(self, settings: TouchSettings) -> tuple[Artifact, ...]:
        """Name the inputs: the meshes and the poses of the sensors."""
        return (SURFACES, GRASPS)

    def assets(self, settings: TouchSettings) -> list[Path]:
        """List the sensor files."""
        return sensor_files(_sensor_names(settings))

    def resolve_settings(self, settings: TouchSettings, attributes: Mapping[str, Mapping[str, Any]]) -> TouchSettings:
        """Take the sensors that the hand wore."""
        return settings.model_copy(update={"sensors": settings.sensors or tuple(attributes["grasps"]["hand"]["sensor_files"])})

    def check_inputs(self, settings: TouchSettings, attributes: Mapping[str, Mapping[str, Any]]) -> None:
        """Check that the sensors to simulate are those that the hand wore, and fit together."""
        hand, sensors = attributes["grasps"]["hand"], list(_sensor_names(settings))
        worn_sensors = hand["sensor_files"]
        load_worn_sensors(sensors)
        same_fingers = list(map(worn_sensors.index, worn_sensors)) == list(map(sensors.index, sensors))
        if same_fingers and hand["sensor_digest"] == assets_digest(self.assets(settings)):  # even if the files were moved
            return
        if worn_sensors != sensors:
            raise InvalidInput(
                f"the hand wears {worn_sensors}, simulate-touch.sensors is {sensors}; leave it out, or name files of the same content"
            )
        names = ", ".join(dict.fromkeys(sensors))
        raise InvalidInput(f"the file of sensor {names} has changed since the grasps were made; run simulate-grasps again")

    def constants(self, settings: TouchSettings) -> Row:
        """Render each sensor with nothing in its gel."""
        return {"untouched": np.stack([untouched_image(sensor) for sensor in load_worn_sensors(_sensor_names(settings))])}

    def attributes(self, settings: TouchSettings) -> dict[str, Any]:
        """Describe each finger's sensor, for readers of the arrays: `width`, `w`, `range` and the rest."""
        return {"sensors": [sensor.model_dump(mode="json") for sensor in load_worn_sensors(_sensor_names(settings))]}

    def cost(self, settings: TouchSettings) -> Cost:
        """Estimate twenty sensors per object."""
        return Cost(seconds=0.03 if settings.tracer == "ray" else 0.7, kilobytes=1600 if settings.store_points else 600)

    @contextmanager
    def session(self, settings: TouchSettings, models: Mapping[str, Path]) -> Iterator[Callable[[Unit, Inputs], Row]]:
        """Load the sensors once; nothing else is kept between objects."""
        sensors = load_worn_sensors(_sensor_names(settings))

        def process(unit: Unit, inputs: Inputs) -> Row:
            faces = box_faces(read_mesh(inputs["surfaces"]).triangles)
            poses = inputs["grasps"]["sensor_pose"]  # (grasp, sensor, 4, 4)
            rows = []
            for grasp, finger in np.ndindex(poses.shape[:2]):
                rng = None if sensors[finger].noise == "none" else unit.rng("simulate-touch", grasp, finger)
                rows.append(_touch(faces, poses[grasp, finger], sensors[finger], settings, rng))
            return {name: np.stack([row[name] for row in rows]).reshape(*poses.shape[:2], *array.shape) for name, array in rows[0].items()}

        yield process


def _sensor_names(settings: TouchSettings) -> tuple[str, ...]:
    """Return the sensors that `resolve_settings` has named."""
    return settings.sensors or ()


def _touch(
    faces: BoxedFaces,
    pose: np.ndarray,  # (4, 4)
    sensor: Sensor,
    settings: TouchSettings,
    rng: np.random.Generator | None,
) -> Row:
    """Compute one sensor's arrays; tactile image and local points follow from the depth as it is stored."""
    if settings.tracer == "ray":
        exact = ray_depth(faces, pose, sensor)
    else:
        exact = sphere_traced_depth(faces, pose, sensor, tolerance=settings.sphere_tolerance)
    depth = quantise_depth(exact, sensor, gel_bits=settings.gel_bits, far_bits=settings.far_bits)
    gel = press_gel(depth, sensor)
    row: Row = {"depth": depth, "tactile_image": render_gel(gel.indentation, sensor, rng)}
    if gel.pressure is not None:
        row |= {"pressure": gel.pressure.astype(np.float32), "force": np.array(normal_force(gel.pressure, sensor), np.float32)}
    if settings.store_points:
        points, count = local_points(depth, pose, sensor)
        row |= {"local_points": points, "local_count": np.asarray(count)}
    return row
