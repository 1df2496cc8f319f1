"""`simulate-touch`: every sensor's depth map, and the tactile image and local points that follow from it (supplement 1.5)."""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np

from pipeline.config.settings import ObjectSettings, described_by, setting
from pipeline.console import pluralise
from pipeline.dataset.mesh_rows import read_mesh
from pipeline.dataset.object_rows import paired_rows, sensors_of
from pipeline.engine.keys import assets_digest
from pipeline.engine.stage import Cost, Inputs, ObjectStage, Trade, Unit
from pipeline.errors import InvalidInput
from pipeline.formats.sensor_file import load_worn_sensors, sensor_files
from pipeline.kernels.touch.sensor import Sensor
from pipeline.store.directory import DataDirectory
from pipeline.store.rows import Row
from pipeline.store.shard import Shard
from schemas.base import Artifact
from schemas.grasps import GRASPS
from schemas.surfaces import SURFACES
from schemas.touch import TOUCH

if TYPE_CHECKING:
    from pipeline.kernels.touch.ray_depth import BoxedFaces


class TouchSettings(ObjectSettings):
    """How depth maps and tactile images are simulated (supplement 1.5)."""

    sensors: tuple[Annotated[str, described_by("sensor")], ...] | None = setting(
        None, "null: the sensors mounted on the hand", changes="definition"
    )
    tracer: Literal["ray", "sphere"] = setting(
        "ray",
        "exact, and about a hundred times faster than the supplement's `sphere`, which stops `sphere_tolerance` before the surface",
    )
    sphere_tolerance: float = setting(
        1e-7,
        "greatest distance before the surface at which a sphere-traced ray stops, m; 1 µm would save a fifth of the time",
        ge=1e-9,
        le=1e-3,
    )
    gel_bits: int | None = setting(
        26,
        "depth in the gel is stored in steps of 2^-26 m: error at most 8 nm, a fifth fewer bytes; null keeps float32's precision. Half a "
        "step is below the 0.1 mm by which a successful touch enters the gel",
        ge=13,
        le=40,
    )
    far_bits: int | None = setting(
        18, "depth beyond the gel, which no tactile image shows: error at most 2 µm, a fifth fewer bytes", ge=10, le=40
    )
    store_points: bool = setting(False, "local points follow from depth and pose bit for bit, and would be three quarters of the bytes")


class SimulateTouch(ObjectStage):
    """Simulate the measurement of every sensor of every grasp."""

    name = "simulate-touch"
    summary = "Depth map and tactile image of every sensor of every grasp."
    output = TOUCH
    settings_type = TouchSettings

    def inputs(self, settings: TouchSettings) -> tuple[Artifact, ...]:
        return (SURFACES, GRASPS)

    def assets(self, settings: TouchSettings) -> list[Path]:
        return sensor_files(settings.sensors or ())

    def resolve_settings(self, settings: TouchSettings, attributes: Mapping[str, Mapping[str, Any]]) -> TouchSettings:
        """Choose the sensors that were mounted on the hand."""
        return settings.model_copy(update={"sensors": settings.sensors or tuple(attributes["grasps"]["hand"]["sensor_files"])})

    def check_inputs(self, settings: TouchSettings, attributes: Mapping[str, Mapping[str, Any]]) -> None:
        """Check that the sensors to simulate are those of the hand, and fit together."""
        hand, sensors = attributes["grasps"]["hand"], list(settings.sensors or ())
        mounted = hand["sensor_files"]
        load_worn_sensors(sensors)
        same_fingers = list(map(mounted.index, mounted)) == list(map(sensors.index, sensors))
        if same_fingers and hand["sensor_digest"] == assets_digest(self.assets(settings)):  # even if the files were moved
            return
        if mounted != sensors:
            raise InvalidInput(
                f"the hand wears {mounted}, simulate-touch.sensors is {sensors}; leave it out, or name files of the same content"
            )
        names = ", ".join(dict.fromkeys(sensors))
        raise InvalidInput(f"the file of sensor {names} has changed since the grasps were made; run simulate-grasps again")

    def constants(self, settings: TouchSettings) -> Row:
        """Render each sensor with nothing in its gel."""
        from pipeline.kernels.touch.tactile_image import untouched_image

        return {"untouched": np.stack([untouched_image(sensor) for sensor in load_worn_sensors(settings.sensors or ())])}

    def attributes(self, settings: TouchSettings) -> dict[str, Any]:
        """Describe each finger's sensor, for readers of the arrays: `width`, `w`, `range` and the rest."""
        return {"sensors": [sensor.model_dump(mode="json") for sensor in load_worn_sensors(settings.sensors or ())]}

    def describe_shard(self, settings: TouchSettings, shard: Shard) -> Iterator[str]:
        """Count the touches that are deeper than the gel's layer, or than what its colours were fitted to."""
        from pipeline.kernels.touch.depth_maps import beyond_ranges

        if not shard.has("indentation"):
            return
        indentation = shard.read("indentation")[shard.read("ok")]
        touches = pluralise(int((indentation > 0).sum()), "touch")
        ranges = ("elastic layer: their forces are too small", "calibration: their deepest colours are those of its deepest contact")
        for deeper, what in zip(beyond_ranges(indentation, sensors_of(shard)), ranges, strict=True):
            if deeper.any():
                yield f"{deeper.sum()} of {touches} are up to {1e3 * indentation[deeper].max():.2f} mm deep, beyond the gel's {what}"

    def cost(self, settings: TouchSettings) -> Cost:
        return Cost(seconds=0.03 if settings.tracer == "ray" else 0.7, kilobytes=1600 if settings.store_points else 600)

    @contextmanager
    def session(self, settings: TouchSettings, models: Mapping[str, Path]) -> Iterator[Callable[[Unit, Inputs], Row]]:
        from pipeline.kernels.touch.ray_depth import box_faces

        sensors = load_worn_sensors(settings.sensors or ())

        def process(unit: Unit, inputs: Inputs) -> Row:
            faces = box_faces(read_mesh(inputs["surfaces"]).triangles)
            poses = inputs["grasps"]["sensor_pose"]  # (grasp, sensor, 4, 4)
            rows = []
            for grasp, finger in np.ndindex(poses.shape[:2]):
                rng = None if sensors[finger].noise == "none" else unit.rng("simulate-touch", grasp, finger)
                rows.append(_touch(faces, poses[grasp, finger], sensors[finger], settings, rng))
            return {name: np.stack([row[name] for row in rows]).reshape(*poses.shape[:2], *array.shape) for name, array in rows[0].items()}

        yield process


def _touch(
    faces: "BoxedFaces",
    pose: np.ndarray,  # (4, 4) sensor to world, m
    sensor: Sensor,
    settings: TouchSettings,
    rng: np.random.Generator | None,
) -> Row:
    """Compute one sensor's arrays; tactile image and local points follow from the depth as it is stored."""
    from pipeline.kernels.touch.depth_maps import impression, local_points, normal_force, press_gel, quantise_depth
    from pipeline.kernels.touch.ray_depth import ray_depth, sphere_traced_depth
    from pipeline.kernels.touch.tactile_image import render_gel

    if settings.tracer == "ray":
        exact = ray_depth(faces, pose, sensor)
    else:
        exact = sphere_traced_depth(faces, pose, sensor, tolerance=settings.sphere_tolerance)
    depth = quantise_depth(exact, sensor, gel_bits=settings.gel_bits, far_bits=settings.far_bits)
    gel = press_gel(depth, sensor)
    row: Row = {"depth": depth, "tactile_image": render_gel(gel.indentation, sensor, rng)}
    if gel.pressure is not None:
        row |= {"pressure": gel.pressure.astype(np.float32), "force": np.array(normal_force(gel.pressure, sensor), np.float32)}
        row["indentation"] = np.array(impression(depth, sensor).max(), np.float32)
    if settings.store_points:
        points, count = local_points(depth, pose, sensor)
        row |= {"local_points": points, "local_count": np.asarray(count)}
    return row


def depth_errors(data: Path, reference: Path) -> dict[str, float]:
    """Compute the 99.9th percentile of the depth errors in the gel, um by object."""
    top = max(sensor.w for sensor in sensors_of(DataDirectory(reference).collection(TOUCH).first))
    errors_by_object = {}
    for name, (depth,), (truth,) in paired_rows(data, reference, "depth"):
        in_gel = truth < top
        with np.errstate(invalid="ignore"):  # a hit that is lost or invented is infinitely wrong, unless both miss
            errors = np.where(depth == truth, 0.0, np.abs(depth.astype(np.float64) - truth))[in_gel]
        if errors.size:
            errors_by_object[name] = 1e6 * float(np.percentile(np.minimum(errors, top), 99.9))
    return errors_by_object


TRADE = Trade(
    metric="depth in the gel, 99.9 % within",
    unit="um",
    candidates=({"gel_bits": 14}, {"gel_bits": 18}, {"gel_bits": 22}, {"tracer": "sphere"}),
    errors=depth_errors,
    reference={"tracer": "ray", "gel_bits": None, "far_bits": None},
)
