"""Measure how deep elastic gels are pressed in a dataset's grasps, and with what forces: `python -m benchmarks.held_gels DATA …`.

One row per dataset. `make bench-gels` makes grasps of eight objects of 12 to 18 cm with each shipped elastic sensor, and measures them.
"""

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.held_grasps import with_depths
from benchmarks.provenance import commit, machine
from benchmarks.timing import Table, quantiles
from pipeline.dataset.grasps import grasping_hand, grasping_sensors, read_grasps
from pipeline.dataset.mesh_rows import read_mesh
from pipeline.kernels.hand.grasp import Grasp
from pipeline.kernels.hand.kinematics import sensor_poses
from pipeline.kernels.hand.model import Hand
from pipeline.kernels.touch.depth_maps import impression, normal_force, press_gel
from pipeline.kernels.touch.ray_depth import BoxedFaces, box_faces, ray_depth
from pipeline.kernels.touch.sensor import Sensor
from pipeline.physics.hold_test import DOWN, HoldTest
from pipeline.store.directory import DataDirectory
from schemas.grasps import GRASPS
from schemas.surfaces import SURFACES

MASS = 0.2  # kg, as `simulate-grasps.hold_mass`
STEP = 1e-5  # rad, of finite differences
SLOW = 0.005  # m/s, of an object at rest
AT_REST = 2.0, 0.25  # s until the forces are read, and over which they are averaged


@dataclass(frozen=True)
class GelTouch:
    """A touch of an elastic gel."""

    indentation: float  # m, of the deepest point
    layer: float  # the same over the layer's thickness
    calibrated: float  # the same over the deepest contact of the calibration; 0 without one
    force: float  # N, of the linear layer, as `simulate-touch` stores it
    torque: float  # the greatest that it asks of a motor, over the motor's


def measure(data: Path) -> tuple[list[GelTouch], list[bool], list[float]]:
    """Measure a dataset's touches; list which grasps hold, and the error of the forces on an object at rest, over its weight."""
    surfaces, grasps = (DataDirectory(data).collection(artifact) for artifact in (SURFACES, GRASPS))
    attributes = {"grasps": grasps.first.attributes}
    hand, sensors = grasping_hand(attributes), grasping_sensors(attributes)
    touches, held, errors = list[GelTouch](), list[bool](), list[float]()
    with HoldTest(hand, sensors, mass=MASS) as test:
        for name in (name for name in grasps if grasps.failure(name) is None):
            surface, mesh = surfaces.view(name), read_mesh(surfaces.view(name))
            faces = box_faces(mesh.triangles)
            test.load(mesh, surface["points"].astype(np.float64))
            held += grasps.view(name)["held"].tolist()
            for grasp in read_grasps(grasps.view(name)):
                touches += gel_touches(grasp, hand, sensors, faces)
                errors.append(weight_error(test, grasp, sensors, faces) if held[len(errors)] else np.nan)
    return touches, held, errors


def gel_touches(grasp: Grasp, hand: Hand, sensors: Sequence[Sensor], faces: BoxedFaces) -> Iterator[GelTouch]:
    """Measure the touches of a grasp, the torque as of one force in the middle of the contact."""
    nudged = sensor_poses(hand, grasp.hand_pose, grasp.joint_angles + STEP * np.eye(len(grasp.joint_angles)))
    for s, (pose, sensor, contact) in enumerate(zip(grasp.sensor_pose, sensors, grasp.contacts, strict=True)):
        if contact is not None:
            depth = ray_depth(faces, pose, sensor)
            deepest, pressure = float(impression(depth, sensor).max()), press_gel(depth, sensor).pressure
            force = normal_force(pressure, sensor) if pressure is not None else np.nan
            point = np.append(pose[:3, :3].T @ (contact.point - pose[:3, 3]), 1)
            arms = (nudged[:, s, :3] @ point - pose[:3] @ point) @ pose[:3, 2] / STEP  # (J,) m
            limit = sensor.calibrated.deepest if sensor.calibrated else np.inf
            yield GelTouch(deepest, deepest / sensor.layer_thickness, deepest / limit, force, np.abs(arms).max() * force / hand.torque)


def weight_error(test: HoldTest, grasp: Grasp, sensors: Sequence[Sensor], faces: BoxedFaces) -> float:
    """Lift the object of a grasp, and compare the force on it at rest with its weight; NaN if it creeps."""
    if test.hold(with_depths(grasp, sensors, faces), seconds=AT_REST[0]).speed > SLOW:
        return np.nan
    forces = []
    for _ in range(round(AT_REST[1] / test.sample_interval)):
        test.advance(test.sample_interval)
        forces.append(test.forces().sum(axis=0))
    weight = MASS * np.array(DOWN)
    return float(np.linalg.norm(np.mean(forces, axis=0) + weight) / np.linalg.norm(weight))


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("data", type=Path, nargs="+")
    arguments = parser.parse_args()
    columns = ["touches", "indentation, mm", "force, N", "torque over the motor's", "over the motor's torque, %", "beyond the layer, %"]
    columns += ["beyond the calibration, %", "grasps that hold, %", "off the weight at rest, %"]
    table = Table("Grasps with elastic gels", columns, ["median / 99 % / most"])
    for data in arguments.data:
        touches, held, errors = measure(data)
        column = {name: np.array([getattr(touch, name) for touch in touches]) for name in GelTouch.__dataclass_fields__}
        shares = (column["torque"] > 1.01, column["layer"] > 1, column["calibrated"] > 1, np.array(held))
        table.add(
            data.name,
            len(touches),
            *(quantiles(values) for values in (1e3 * column["indentation"], column["force"], column["torque"])),
            *(f"{100 * share.mean():.0f}" for share in shares),
            quantiles(100 * np.array(errors)[np.isfinite(errors)]),
        )
    print(table.markdown(f"Commit {commit()}, {machine()}."))


if __name__ == "__main__":
    main()
