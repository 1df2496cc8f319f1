"""Export grasps for robots: poses and joint angles in the object's own frame, as arrays, or as DexGraspBench reads them."""

import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
import yaml
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from pipeline.console import pluralise, with_progress
from pipeline.contrib.exports.convex_parts import convex_parts
from pipeline.dataset.completed_objects import CompletedObjects
from pipeline.dataset.grasps import grasping_sensors, read_grasps
from pipeline.dataset.mesh_rows import read_mesh
from pipeline.dataset.object_rows import sensors_of
from pipeline.kernels.geometry.mesh import Mesh
from pipeline.kernels.geometry.transforms import pose_of
from pipeline.kernels.hand.grasp import Grasp
from pipeline.kernels.hand.model import Hand
from pipeline.kernels.touch.sensor import Sensor
from pipeline.physics.hand_mjcf import joint_values, write_hand_mjcf
from pipeline.physics.hand_urdf import gel_name
from pipeline.store.storage import Location
from pipeline.store.validate import check_origins
from schemas.touch import TOUCH

DIGITS = 15
"""Decimals of vertices in OBJ files: all that float64 has of an object of some metres."""
UNITS = {
    **dict.fromkeys(("hand_pose", "sensor_pose", "contact_points"), "metres_per_unit m"),
    **dict.fromkeys(("pregrasp", "grasp", "squeeze"), "rad, m of a joint that slides"),
    "force": "N",
    "pressure": "Pa",
}
"""Of the arrays in `OBJECT.npz`."""


@dataclass(frozen=True, eq=False)
class GraspedObject:
    """An object with its grasps.

    `placement` is a rotation times `scale`, m per unit of the file, and a shift.
    """

    name: str
    mesh: Mesh
    grasps: list[Grasp]
    placement: NDArray[np.float64]  # (4, 4) points of the object's file to the world, m
    measured: dict[str, np.ndarray]  # as stored, by name: `held` of tested grasps, `force` and `pressure` on elastic gels

    @cached_property
    def scale(self) -> float:
        """Metres per unit of the file."""
        return float(np.cbrt(np.linalg.det(self.placement[:3, :3])))

    def to_object_frame(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Take points (..., 3) from the world, m, into the object's own frame and unit."""
        return (points - self.placement[:3, 3]) @ self.placement[:3, :3] / self.scale**2

    def directions_to_object_frame(self, directions: NDArray[np.float64]) -> NDArray[np.float64]:
        """Turn directions (..., 3) from the world into the object's own frame."""
        return directions @ self.placement[:3, :3] / self.scale

    def pose_to_object_frame(self, pose: NDArray[np.float64]) -> NDArray[np.float64]:
        """Take a pose (4, 4) into the object's own frame: it stays rigid, its origin is in the object's unit."""
        return pose_of(self.directions_to_object_frame(pose[:3, :3].T).T, self.to_object_frame(pose[:3, 3]))


class GraspedObjects(CompletedObjects):
    """Objects that have grasps, in the order of their ids, or the chosen ones."""

    def __init__(self, data: Location, objects: Sequence[str] = ()) -> None:
        super().__init__(data, ("surfaces", "grasps"))
        for name in objects:
            self.check_known(name)
        self.object_ids = list(objects) or self.object_ids
        self.touch = self.directory.collection(TOUCH)
        if self.touch.shards:
            check_origins(self.directory, self.collections | {"touch": self.touch})

    @property
    def summary(self) -> str:
        """The number of grasps."""
        return pluralise(len(self.object_ids) * self.collections["grasps"].first.stored("hand_pose").shape[1], "grasp")

    def sensors(self) -> tuple[Sensor, ...]:
        """Read the sensors that the hand wore."""
        return sensors_of(self.touch.first) if self.touch.shards else grasping_sensors({"grasps": self.attributes("grasps")})

    def __iter__(self) -> Iterator[GraspedObject]:
        for name in with_progress(self.object_ids, "export"):
            rows = self.rows(name)
            surface, row = rows["surfaces"], rows["grasps"]
            grasps = read_grasps(row)
            touch = self.touch.view(name) if self.touch.shards and not self.touch.failure(name) else {}
            stored = {array: view for view in (row, touch) for array in view if array in ("held", "force", "pressure")}
            measured = {array: view[array][: len(grasps)] for array, view in stored.items()}
            yield GraspedObject(name, read_mesh(surface), grasps, surface["placement"], measured)


def export_grasps(data: Location, folder: Path, objects: Sequence[str] = ()) -> str:
    """Write `OBJECT.npz` with the object's grasps in its own frame and unit, and `OBJECT.obj`, the mesh in that frame."""
    source = GraspedObjects(data, objects)
    hand, worn = source.hand(), source.sensors()
    for grasped in source:
        grasps = grasped.grasps
        points, normals = np.full((2, len(grasps), len(hand.sensors), 3), np.nan)
        for g, grasp in enumerate(grasps):
            for s, contact in enumerate(grasp.contacts):
                if contact:
                    points[g, s], normals[g, s] = grasped.to_object_frame(contact.point), grasped.directions_to_object_frame(contact.normal)
        arrays = {
            "hand_pose": np.stack([grasped.pose_to_object_frame(grasp.hand_pose) for grasp in grasps]),
            "pregrasp": np.stack([grasp.pregrasp_angles for grasp in grasps]),
            "grasp": np.stack([grasp.joint_angles for grasp in grasps]),
            "squeeze": np.stack([grasp.squeeze_angles for grasp in grasps]),
            "sensor_pose": np.stack([[grasped.pose_to_object_frame(pose) for pose in grasp.sensor_pose] for grasp in grasps]),
            "contact_points": points,
            "contact_normals": normals,
            **grasped.measured,
            "metres_per_unit": np.array(grasped.scale),
            "object_file": np.array(f"{grasped.name}.obj"),
            "hand": np.array(hand.name),
            "joint_names": np.array(hand.joint_names),
            "sensor_names": np.array([mount.name for mount in hand.sensors]),
            "sensors": np.array([sensor.name for sensor in worn]),
            "units": np.array([f"{name}: {unit}" for name, unit in UNITS.items()]),
        }
        _write_mesh(grasped, folder / f"{grasped.name}.obj")
        np.savez_compressed(folder / f"{grasped.name}.npz", allow_pickle=False, **arrays)
    return source.summary


def export_dexgraspbench(
    data: Location,
    folder: Path,
    objects: Sequence[str] = (),
    publish: Callable[[], None] = lambda: None,  # called after each object
) -> str:
    """Write grasps and objects below `output` and `assets`, as DexGraspBench has them, and the hand with its configuration.

    Of a grasp, `qpos` is the root link's position, m, its quaternion, real part first, and the joints of the hand's MJCF file, whose names
    are in `joint_names`; the object is at the origin with its file's axes, its meshes in its file's unit and scaled by `obj_scale`.
    """
    source = GraspedObjects(data, objects)
    hand = source.hand()
    joint_names = _write_hand(hand, source.sensors(), folder)
    for grasped in source:
        assets = Path("assets", "vt-pipeline", grasped.name)
        _write_object(grasped, folder / assets)
        scene = folder / "output" / f"vt-pipeline_{hand.name}" / "graspdata" / grasped.name / "scale_pose000"
        scene.mkdir(parents=True)
        for number, grasp in enumerate(grasped.grasps):
            root = grasped.pose_to_object_frame(grasp.hand_pose)
            placed = [*(root[:3, 3] * grasped.scale), *Rotation.from_matrix(root[:3, :3]).as_quat(scalar_first=True)]
            content: dict[str, Any] = {
                "obj_path": str(assets),
                "obj_scale": grasped.scale,
                "obj_pose": np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]),
                "pregrasp_qpos": np.array([*placed, *joint_values(hand, joint_names, grasp.pregrasp_angles)]),
                "grasp_qpos": np.array([*placed, *joint_values(hand, joint_names, grasp.joint_angles)]),
                "squeeze_qpos": np.array([*placed, *joint_values(hand, joint_names, grasp.squeeze_angles)]),
                "joint_names": np.array(joint_names),
                "hand": hand.name,
            }
            np.save(scene / f"{number}.npy", np.array(content, dtype=object), allow_pickle=True)
        publish()
    return source.summary


def _write_hand(hand: Hand, sensors: Sequence[Sensor], folder: Path) -> list[str]:
    """Write a hand as MJCF below `assets` and its entry below `config`; return the names of its joints in the order of `qpos`."""
    path = Path("assets", "hand", hand.name, "hand.xml")
    joint_names = write_hand_mjcf(hand, sensors, folder / path)
    gels = [gel_name(number) for number in range(len(sensors))]
    described = {
        "xml_path": str(path),
        "mocap": True,
        "exclude_table_contact": None,
        "color": [0.6, 0.6, 0.6, 1.0],
        "finger_prefix": gels,
        "valid_body_name": [*(link.name for link in hand.links), *gels],
        "tip_body_name": gels,
    }
    config = folder / "config" / "hand"
    config.mkdir(parents=True)
    (config / f"{hand.name}.yaml").write_text(yaml.safe_dump(described, sort_keys=False), encoding="utf-8")
    return joint_names


def _write_mesh(grasped: GraspedObject, path: Path) -> None:
    """Write an object's mesh in its own frame and unit."""
    mesh = trimesh.Trimesh(grasped.to_object_frame(grasped.mesh.vertices), grasped.mesh.faces, process=False)
    mesh.export(path, digits=DIGITS)


def _write_object(grasped: GraspedObject, folder: Path) -> None:
    """Write an object's mesh and convex parts, and its volume as the mass of a density of 1."""
    (folder / "mesh").mkdir(parents=True)
    _write_mesh(grasped, folder / "mesh" / "simplified.obj")
    meshes = folder / "urdf" / "meshes"
    meshes.mkdir(parents=True)
    volume = 0.0
    for number, part in enumerate(convex_parts(grasped.mesh)):
        hull = trimesh.convex.convex_hull(grasped.to_object_frame(part))
        hull.export(meshes / f"convex_piece_{number:03d}.obj")
        volume += float(hull.volume)
    (folder / "info").mkdir()
    (folder / "info" / "simplified.json").write_text(json.dumps({"mass": volume, "density": 1.0, "scale": 1.0}))
