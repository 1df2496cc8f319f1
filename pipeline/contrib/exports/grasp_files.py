"""Export grasps for robots: poses and joint angles in the object's own frame, as arrays, or as DexGraspBench reads them."""

import json
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from pipeline.console import pluralise, with_progress
from pipeline.contrib.exports.convex_parts import convex_parts
from pipeline.dataset.completed_objects import CompletedObjects
from pipeline.dataset.grasps import read_grasps
from pipeline.dataset.mesh_rows import read_mesh
from pipeline.kernels.geometry.mesh import Mesh
from pipeline.kernels.hand.grasp import Grasp
from pipeline.store.storage import Location


@dataclass(frozen=True, eq=False)
class GraspedObject:
    """An object with its grasps.

    `placement` is a rotation times `scale`, m per unit of the file, and a shift.
    """

    name: str
    mesh: Mesh
    grasps: list[Grasp]
    placement: NDArray[np.float64]  # (4, 4) points of the object's file to the world, m
    held: np.ndarray | None  # (grasp,) which ones hold; None if they were not tested

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
        moved = np.eye(4)
        moved[:3, :3] = self.directions_to_object_frame(pose[:3, :3].T).T
        moved[:3, 3] = self.to_object_frame(pose[:3, 3])
        return moved


class GraspedObjects(CompletedObjects):
    """The objects that a hand grasps, in id order."""

    def __init__(self, data: Location) -> None:
        super().__init__(data, ("surfaces", "grasps"))

    @property
    def summary(self) -> str:
        """The number of grasps."""
        return pluralise(len(self.object_ids) * self.collections["grasps"].first.array("hand_pose").shape[1], "grasp")

    def __iter__(self) -> Iterator[GraspedObject]:
        for name in with_progress(self.object_ids, "export"):
            rows = self.rows(name)
            surface, row = rows["surfaces"], rows["grasps"]
            held = row["held"] if "held" in set(row) else None
            yield GraspedObject(name, read_mesh(surface), read_grasps(row), surface["placement"], held)


def export_grasps(data: Location, folder: Path) -> str:
    """Write `OBJECT.npz` with the object's grasps in its own frame and unit."""
    objects = GraspedObjects(data)
    hand = objects.hand()
    for grasped in objects:
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
            "contact_points": points,
            "contact_normals": normals,
            "metres_per_unit": np.array(grasped.scale),
            "hand": np.array(hand.name),
            "joint_names": np.array(hand.joint_names),
            "sensor_names": np.array([mount.name for mount in hand.sensors]),
        }
        np.savez(folder / f"{grasped.name}.npz", allow_pickle=False, **arrays, **({} if grasped.held is None else {"held": grasped.held}))
    return objects.summary


def export_dexgraspbench(data: Location, folder: Path) -> str:
    """Write grasps and objects below `output` and `assets`, as DexGraspBench has them.

    Of a grasp, `qpos` is the root link's position, m, its quaternion, real part first, and the joint vector; the object
    is at the origin with its file's axes, its meshes in its file's unit and scaled by `obj_scale`.
    """
    objects = GraspedObjects(data)
    hand = objects.hand()
    for grasped in objects:
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
                "joint_names": np.array(hand.joint_names),
                "pregrasp_qpos": np.array([*placed, *grasp.pregrasp_angles]),
                "grasp_qpos": np.array([*placed, *grasp.joint_angles]),
                "squeeze_qpos": np.array([*placed, *grasp.squeeze_angles]),
            }
            np.save(scene / f"{number}.npy", np.array(content, dtype=object), allow_pickle=True)
    return objects.summary


def _write_object(grasped: GraspedObject, folder: Path) -> None:
    """Write an object's mesh and convex parts, and its volume as the mass of a density of 1."""
    (folder / "mesh").mkdir(parents=True)
    mesh = trimesh.Trimesh(grasped.to_object_frame(grasped.mesh.vertices), grasped.mesh.faces, process=False)
    mesh.export(folder / "mesh" / "simplified.obj")
    meshes = folder / "urdf" / "meshes"
    meshes.mkdir(parents=True)
    volume = 0.0
    for number, part in enumerate(convex_parts(grasped.mesh)):
        hull = trimesh.convex.convex_hull(grasped.to_object_frame(part))
        hull.export(meshes / f"convex_piece_{number:03d}.obj")
        volume += float(hull.volume)
    (folder / "info").mkdir()
    (folder / "info" / "simplified.json").write_text(json.dumps({"mass": volume, "density": 1.0, "scale": 1.0}))
