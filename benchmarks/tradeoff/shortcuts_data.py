"""Shortcuts of the stages that make the dataset, on one modelled object."""

from __future__ import annotations

from functools import cached_property
from typing import cast
from unittest.mock import patch

import numpy as np
from numpy.typing import NDArray

from benchmarks.depth import press
from benchmarks.tradeoff.shortcut import Results, Shortcut
from pipeline.dataset.mesh_rows import mesh_row
from pipeline.engine.stage import Inputs
from pipeline.engine.unit import Unit
from pipeline.kernels.geometry import exterior_sampling
from pipeline.kernels.geometry.mesh import Mesh
from pipeline.kernels.geometry.normalise import normalise_mesh
from pipeline.kernels.hand import object_distances
from pipeline.kernels.hand.kinematics import forward_kinematics, sensor_poses
from pipeline.kernels.hand.pregrasp import tangent_palm_pose
from pipeline.kernels.touch.ray_depth import local_depth, ray_depth
from pipeline.kernels.touch.sensor import Sensor
from pipeline.toy_objects import generate
from stages.simulate_grasps import stage as grasping
from stages.simulate_grasps.prepare import PreparedHand, PreparedObject, prepare_hand, prepare_object
from stages.simulate_grasps.settings import GraspSettings


class Bench:
    """An object, a hand, and hands around the object; `size` says how many."""

    def __init__(self, size: int, attempts: int, points: int = 10_000, samples: int = 1024) -> None:
        self.size, self.points = size, points
        self.settings = GraspSettings(attempts=attempts, ik_samples=samples)

    @cached_property
    def mesh(self) -> Mesh:
        return normalise_mesh(generate("bottle", np.random.default_rng(0)), up="z", diagonal=0.5)

    @cached_property
    def surface(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        return exterior_sampling.sample_exterior(self.mesh, self.points, np.random.default_rng(0))

    @cached_property
    def prepared_hand(self) -> PreparedHand:
        return prepare_hand(self.settings)

    @cached_property
    def prepared_object(self) -> PreparedObject:
        return prepare_object(self.mesh, *self.surface, cell=self.settings.grid_cell)

    @cached_property
    def poses(self) -> list[NDArray[np.float64]]:
        """(4, 4) hands near the object, with room for their fingers or not."""
        thing, hand = self.prepared_object, self.prepared_hand.hand
        return [tangent_palm_pose(hand, thing.points[k], thing.normals[k], distance=0.03, angle=k) for k in range(4 * self.size)]

    @cached_property
    def frames(self) -> list[NDArray[np.float64]]:
        """(L, 4, 4) link frames of hands at these poses, half closed."""
        middle = (self.prepared_hand.hand.lower + self.prepared_hand.hand.upper) / 2
        return [forward_kinematics(self.prepared_hand.hand, pose, middle) for pose in self.poses]

    @cached_property
    def sensors(self) -> list[NDArray[np.float64]]:
        """(4, 4) sensors pressed into the object."""
        rng = np.random.default_rng(0)
        return [press(self.mesh.triangles, rng) for _ in range(8 * self.size)]

    @property
    def sensor(self) -> Sensor:
        return self.prepared_hand.sensors[0]


def shortcuts(bench: Bench) -> list[Shortcut]:
    """List the shortcuts of these stages."""
    return [
        Shortcut("sample-surfaces", "sure of side", "rays whose answer is known", lambda: _exterior(bench), lambda: _all_rays(bench)),
        Shortcut(
            *("simulate-grasps", "doubtful spheres", "exact distances of spheres clear of the object"),
            *(lambda: _depths(bench), lambda: _all_spheres(bench)),
        ),
        Shortcut(
            *("simulate-grasps", "enough attempts", "attempts none of which could be kept (`exhaustive=false`)"),
            *(lambda: _grasps(bench), lambda: _grasps(bench, exhaustive=True)),
        ),
        Shortcut("simulate-touch", "prism", "faces that no ray of the sensor meets", lambda: _depth(bench), lambda: _all_faces(bench)),
    ]


def _exterior(bench: Bench) -> Results:
    points, normals = exterior_sampling.sample_exterior(bench.mesh, bench.points, np.random.default_rng(0))
    return {"points": points, "normals": normals}


def _all_rays(bench: Bench) -> Results:
    with patch.object(exterior_sampling, "CERTAIN_ESCAPES", exterior_sampling.DIRECTIONS + 1):
        return _exterior(bench)


def _depths(bench: Bench) -> Results:
    field, spheres = bench.prepared_object.field, bench.prepared_hand.spheres
    return {"depth": np.array([object_distances.penetration_depth(field, spheres, frames) for frames in bench.frames])}


def _all_spheres(bench: Bench) -> Results:
    with patch.object(object_distances, "possibly_overlapping_spheres", lambda field, spheres, points: np.arange(len(spheres.radii))):
        return _depths(bench)


def _made(bench: Bench) -> tuple[Unit, Inputs]:
    points, normals = bench.surface
    surface = {"points": points.astype(np.float32), "normals": normals.astype(np.float32), **mesh_row(bench.mesh)}
    angles = np.zeros(len(bench.prepared_hand.hand.joint_names))
    poses = np.stack([sensor_poses(bench.prepared_hand.hand, pose, angles) for pose in bench.poses])
    poses[:, 0] = bench.sensors[: len(poses)]
    return Unit("bottle"), cast(Inputs, {"surfaces": surface, "grasps": {"sensor_pose": poses}})


def _grasps(bench: Bench, exhaustive: bool = False) -> Results:
    settings = bench.settings.model_copy(update={"exhaustive": exhaustive, "grasps": 2})
    with patch.object(grasping, "prepare_hand", lambda _: bench.prepared_hand), grasping.SimulateGrasps().session(settings, {}) as process:
        row = process(*_made(bench))
    return {name: row[name] for name in ("hand_pose", "joint_angles", "sensor_pose", "touch_success", "penetration")}


def _depth(bench: Bench) -> Results:
    return {f"{k}": ray_depth(bench.prepared_object.faces, pose, bench.sensor) for k, pose in enumerate(bench.sensors)}


def _all_faces(bench: Bench) -> Results:
    """Every face is taken to the sensor's frame and looked at by the tracer."""
    found = {}
    corners = bench.prepared_object.faces.corners
    for k, pose in enumerate(bench.sensors):
        rotation, offset = pose[:3, :3], corners - pose[:3, 3][:, None, None]
        local = np.stack([r[0] * offset[0] + r[1] * offset[1] + r[2] * offset[2] for r in rotation.T])
        found[f"{k}"] = local_depth(local, bench.sensor)
    return found
