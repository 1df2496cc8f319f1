"""`simulate-touch`: every sensor's depth map, and the tactile image and local points that follow from it (supplement 1.5)."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray

from pipeline.config.settings import ObjectSettings, defining, described_by, setting
from pipeline.console import pluralise
from pipeline.dataset.grasps import grasping_hand
from pipeline.dataset.mesh_rows import read_mesh
from pipeline.dataset.object_rows import paired_rows, sensors_of
from pipeline.engine.keys import assets_digest
from pipeline.engine.stage import Cost, Inputs, ObjectStage, Trade, Unit
from pipeline.errors import InvalidInput
from pipeline.formats.sensor_file import load_worn_sensors, sensor_files
from pipeline.kernels.touch.elastic_contact import check_layer
from pipeline.kernels.touch.lift import AT_REST, freed_object, lift_object, rests
from pipeline.kernels.touch.sensor import Friction, Sensor
from pipeline.kernels.touch.sliding import CHOSEN, Quantity, known_friction, measure_steps, stored_quantities, unsettled_remarks
from pipeline.store.directory import DataDirectory
from pipeline.store.rows import Row
from pipeline.store.shard import Shard
from schemas.base import Artifact
from schemas.grasps import GRASPS
from schemas.sequences import ALWAYS
from schemas.surfaces import SURFACES
from schemas.touch import TOUCH

if TYPE_CHECKING:
    from pipeline.kernels.touch.ray_depth import BoxedFaces


class TouchSettings(ObjectSettings):
    """How depth maps and tactile images are simulated (supplement 1.5)."""

    sensors: tuple[Annotated[str, described_by("sensor")], ...] | None = defining(None, "null: the sensors mounted on the hand")
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
    sequence: Literal["lift"] | None = defining(
        None,
        "lift: how the gels, which must be elastic, carry the object that each grasp lifts: shear, slip and forces over time, 5 s per "
        "grasp; null: none is computed",
    )
    lift_steps: int = defining(
        32, "an eighth until the object is free, then its weight grows on the gels until half are over", ge=8, le=1000
    )
    lift_rate: float = defining(32.0, "steps per second: the lift takes the second of the hold test", gt=0, le=1000)
    lift_mass: float | None = defining(None, "kg of any object; null: simulate-grasps.hold_mass", gt=0, le=1000)
    lift_squeeze: float | None = defining(
        None,
        "m further along its normal at which the gel that is pressed most presses with nothing, for motors are springs; 0: fingers stay "
        "still; null: simulate-grasps.squeeze",
        ge=0,
        le=1,
    )
    lift_friction: Friction | None = defining(
        None, "coefficient of object and those gels whose sensors' files state none; null: the hand's"
    )
    lift_store: tuple[Quantity, ...] | None = setting(
        ("tactile_image", "pressure", "shear", "slip", "slip_share", "gross_slip", "force", "torque"),
        f"what is computed and stored of each step beside {', '.join(ALWAYS)}, from {', '.join(CHOSEN)}; null: all but traction, and "
        "marker_displacement where the sensors have markers",
    )


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
        sensors = settings.sensors or tuple(attributes["grasps"]["hand"]["sensor_files"])
        updates: dict[str, Any] = {"sensors": sensors}
        if settings.sequence is not None:
            grasps = attributes["grasps"]["settings"]
            updates["lift_mass"] = settings.lift_mass or grasps["hold_mass"]
            updates["lift_squeeze"] = grasps["squeeze"] if settings.lift_squeeze is None else settings.lift_squeeze
            gels = [sensor.gel for sensor in load_worn_sensors(sensors)]
            if settings.lift_friction is None and any(gel is not None and gel.friction is None for gel in gels):
                updates["lift_friction"] = grasping_hand(attributes).friction
        return settings.model_copy(update=updates)

    def check_inputs(self, settings: TouchSettings, attributes: Mapping[str, Mapping[str, Any]]) -> None:
        """Check that the sensors to simulate are those of the hand, and fit together."""
        hand, sensors = attributes["grasps"]["hand"], list(settings.sensors or ())
        mounted = hand["sensor_files"]
        worn = load_worn_sensors(sensors)
        if settings.sequence is not None:
            for sensor in worn:
                known_friction(sensor, fallback=settings.lift_friction)
                check_layer(sensor)
            if settings.lift_friction is not None and all(sensor.gel and sensor.gel.friction is not None for sensor in worn):
                raise InvalidInput(f"lift_friction is {settings.lift_friction}, but the files of all sensors state theirs; leave it out")
            stored_quantities(settings.lift_store, worn)
        same_fingers = list(map(mounted.index, mounted)) == list(map(sensors.index, sensors))
        if same_fingers and hand["sensor_digest"] == assets_digest(self.assets(settings)):  # even if the files were moved
            return
        if mounted != sensors:
            raise InvalidInput(f"the hand wears {mounted}, simulate-touch.sensors is {sensors}; leave it out, or name equal files")
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
        if settings.sequence is not None:
            yield from _describe_lifts(shard)

    def cost(self, settings: TouchSettings) -> Cost:
        """Estimate five grasps of four sensors."""
        lift = 0.0 if settings.sequence is None else settings.lift_steps / 32
        seconds, kilobytes = 0.03 if settings.tracer == "ray" else 0.7, 1600 if settings.store_points else 600
        return Cost(seconds=seconds + 20 * lift, kilobytes=kilobytes + 80_000 * lift)

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
            row = {name: np.stack([row[name] for row in rows]).reshape(*poses.shape[:2], *array.shape) for name, array in rows[0].items()}
            if settings.sequence is not None:
                lifts = [_lift(faces, inputs["surfaces"]["points"], *lifted, sensors, settings, unit) for lifted in enumerate(poses)]
                row |= {name: np.stack([lift[name] for lift in lifts]) for name in lifts[0]}
            return row

        yield process


def _describe_lifts(shard: Shard) -> Iterator[str]:
    """Count the lifts at whose end the object rests on the gels, or has slipped out, and the steps that did not settle."""
    held, weight, imbalance, settled = (shard.read(f"lift_{name}")[shard.read("ok")] for name in ("held", "weight", "imbalance", "settled"))
    rest = rests(held[..., -1], imbalance[..., -1], weight[..., -1], settled[..., -1])
    yield (
        f"{rest.sum()} of {rest.size} lifts end at rest, gels and weight balanced to {100 * AT_REST:g} %; in "
        f"{(~held[..., -1]).sum()} the object slips out"
    )
    yield from unsettled_remarks(settled.all(axis=-2), "lift_settled")


def _touch(
    faces: "BoxedFaces",
    pose: np.ndarray,  # (4, 4) sensor to world, m
    sensor: Sensor,
    settings: TouchSettings,
    rng: np.random.Generator | None,
) -> Row:
    """Compute one sensor's arrays; tactile image and local points follow from the depth as it is stored."""
    from pipeline.kernels.touch.depth_maps import impression, local_points, normal_force, press_gel
    from pipeline.kernels.touch.tactile_image import render_gel

    depth = _depth(faces, settings, pose, sensor)
    gel = press_gel(depth, sensor)
    row: Row = {"depth": depth, "tactile_image": render_gel(gel.indentation, sensor, rng)}
    if gel.pressure is not None:
        row |= {"pressure": gel.pressure.astype(np.float32), "force": np.array(normal_force(gel.pressure, sensor), np.float32)}
        row["indentation"] = np.array(impression(depth, sensor).max(), np.float32)
    if settings.store_points:
        points, count = local_points(depth, pose, sensor)
        row |= {"local_points": points, "local_count": np.asarray(count)}
    return row


def _depth(
    faces: "BoxedFaces",
    settings: TouchSettings,
    pose: np.ndarray,  # (4, 4) sensor frame to that of the faces, m
    sensor: Sensor,
) -> NDArray[np.float32]:  # (rows, cols) m
    """Trace a depth map, and round it as it is stored."""
    from pipeline.kernels.touch.depth_maps import quantise_depth
    from pipeline.kernels.touch.ray_depth import ray_depth, sphere_traced_depth

    if settings.tracer == "ray":
        exact = ray_depth(faces, pose, sensor)
    else:
        exact = sphere_traced_depth(faces, pose, sensor, tolerance=settings.sphere_tolerance)
    return quantise_depth(exact, sensor, gel_bits=settings.gel_bits, far_bits=settings.far_bits)


def _lift(
    faces: "BoxedFaces",
    points: np.ndarray,  # (N, 3) of the object's surface, m
    grasp: int,
    poses: np.ndarray,  # (S, 4, 4) of the sensors in the grasp, to world, m
    sensors: Sequence[Sensor],
    settings: TouchSettings,
    unit: Unit,
) -> Row:
    """Compute the lift of one grasp."""
    body = freed_object(partial(_depth, faces, settings), points, settings.lift_mass or np.nan)
    friction = [known_friction(sensor, fallback=settings.lift_friction) for sensor in sensors]
    quantities = stored_quantities(settings.lift_store, sensors)
    rngs = [None if sensor.noise == "none" else unit.rng("lift", grasp, finger) for finger, sensor in enumerate(sensors)]
    touches, steps = [], []
    squeeze, count, rate = settings.lift_squeeze or 0.0, settings.lift_steps, settings.lift_rate
    for step in lift_object(body, list(poses), sensors, friction, squeeze=squeeze, steps=count, rate=rate):
        touches.append([measure_steps([touch], quantities, rng) for touch, rng in zip(step.touches, rngs, strict=True)])
        steps.append(step._replace(touches=()))
    by_sensor = list(zip(*touches, strict=True))
    row = {f"lift_{name}": np.stack([np.concatenate([touch[name] for touch in of_one]) for of_one in by_sensor]) for name in quantities}
    row["lift_settled"] &= [step.settled for step in steps]
    row["lift_time"] = np.tile(np.arange(len(steps)) / settings.lift_rate, (len(sensors), 1)).astype(np.float32)
    row |= {f"lift_{name}": np.array([getattr(step, name) for step in steps], np.float32) for name in ("weight", "imbalance")}
    return row | {"lift_object_pose": np.stack([step.pose for step in steps]), "lift_held": np.array([step.held for step in steps])}


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
