"""Export grasps for robots: poses and joint angles in the object's own frame, as arrays, or as DexGraspBench reads them."""

import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
import yaml
from scipy.spatial.transform import Rotation

from pipeline.console import pluralise, with_progress
from pipeline.contrib.exports.convex_parts import convex_parts
from pipeline.dataset.completed_objects import CompletedObjects
from pipeline.dataset.grasps import grasp_count, grasp_counts, grasping_sensors
from pipeline.dataset.mesh_rows import read_mesh
from pipeline.dataset.object_rows import sensors_of
from pipeline.kernels.arrays import Array
from pipeline.kernels.geometry.mesh import Mesh
from pipeline.kernels.geometry.transforms import compose, frame_and_scale, invert_pose, transform_points
from pipeline.kernels.hand.model import Hand
from pipeline.kernels.touch.sensor import Sensor
from pipeline.physics.hand_mjcf import write_hand_mjcf
from pipeline.physics.hand_urdf import gel_name
from pipeline.store.storage import Location
from pipeline.store.validate import check_origins
from schemas.touch import TOUCH

DIGITS = 15  # decimals of vertices in OBJ files: all that float64 has of an object of some metres
PHASES = {"pregrasp": "pregrasp_angles", "grasp": "joint_angles", "squeeze": "squeeze_angles"}
STORED = (*PHASES.values(), "hand_pose", "sensor_pose", "touch_success", "contact_point", "contact_normal", "held", "force", "pressure")
UNITS = {  # of the arrays in `OBJECT.npz`
    **dict.fromkeys(("hand_pose", "sensor_pose", "contact_points"), "metres_per_unit m"),
    **dict.fromkeys(PHASES, "rad, m of a joint that slides"),
    "force": "N",
    "pressure": "Pa",
}


@dataclass(frozen=True, eq=False)
class GraspedObject:
    """An object with its grasps, in its file's own frame."""

    name: str
    mesh: Mesh
    row: dict[str, np.ndarray]  # of `grasps` and `touch`, without repeated grasps
    frame: Array  # (4, 4) the file's axes and origin in the world, m
    scale: float  # m per unit of the file

    def points(self, points: Array) -> Array:
        """Take points (..., 3) from the world, m, into the object's own frame and unit."""
        return transform_points(invert_pose(self.frame), points) / self.scale

    def poses(self, name: str) -> Array:  # (G, ..., 4, 4) m
        """Take the poses of an array into the object's own frame."""
        return compose(invert_pose(self.frame), self.row[name])


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
        counts = grasp_counts(self.collections["grasps"], self.object_ids)
        self.summary = pluralise(sum(counts.values()), "grasp")

    def worn_sensors(self) -> tuple[Sensor, ...]:
        """Read the sensors that the hand wore."""
        return sensors_of(self.touch.first) if self.touch.shards else grasping_sensors({"grasps": self.attributes("grasps")})

    def __iter__(self) -> Iterator[GraspedObject]:
        for name in with_progress(self.object_ids, "export"):
            rows = self.rows(name)
            touch = self.touch.view(name) if self.touch.shards and not self.touch.failure(name) else {}
            views = {array: view for view in (rows["grasps"], touch) for array in STORED if array in set(view)}
            count = grasp_count(rows["grasps"])
            row = {array: view[array][:count] for array, view in views.items()}
            yield GraspedObject(name, read_mesh(rows["surfaces"]), row, *frame_and_scale(rows["surfaces"]["placement"]))


def export_grasps(data: Location, folder: Path, objects: Sequence[str] = ()) -> str:
    """Write `OBJECT.npz` with the object's grasps in its own frame and unit, and `OBJECT.obj`, the mesh in that frame."""
    source = GraspedObjects(data, objects)
    hand, worn = source.hand(), source.worn_sensors()
    for grasped in source:
        row, scale = grasped.row, grasped.scale
        touched = row["touch_success"][..., None]
        arrays = {name: grasped.poses(name) for name in ("hand_pose", "sensor_pose")}
        for pose in arrays.values():
            pose[..., :3, 3] /= scale
        arrays |= {phase: row[name] for phase, name in PHASES.items()}
        arrays["contact_points"] = np.where(touched, grasped.points(row["contact_point"]), np.nan)
        arrays["contact_normals"] = np.where(touched, np.einsum("ji,...j->...i", grasped.frame[:3, :3], row["contact_normal"]), np.nan)
        arrays |= {name: row[name] for name in ("held", "force", "pressure") if name in row}
        described: dict[str, Any] = {
            "metres_per_unit": scale,
            "up": grasped.frame[2, :3],  # the world's z
            "object_file": f"{grasped.name}.obj",
            "hand": hand.name,
            "joint_names": hand.joint_names,
            "sensor_names": [mount.name for mount in hand.sensors],
            "sensors": [sensor.name for sensor in worn],
            "units": [f"{name}: {unit}" for name, unit in UNITS.items()],
        }
        _write_mesh(grasped, folder / f"{grasped.name}.obj")
        np.savez_compressed(folder / f"{grasped.name}.npz", allow_pickle=False, **arrays, **described)
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
    joint_names = _write_hand(hand, source.worn_sensors(), folder)
    for grasped in source:
        assets = Path("assets", "vt-pipeline", grasped.name)
        _write_object(grasped, folder / assets)
        scene = folder / "output" / f"vt-pipeline_{hand.name}" / "graspdata" / grasped.name / "scale_pose000"
        scene.mkdir(parents=True)
        for number, root in enumerate(grasped.poses("hand_pose")):
            placed = [*root[:3, 3], *Rotation.from_matrix(root[:3, :3]).as_quat(scalar_first=True)]
            values = {phase: hand.joint_values(grasped.row[name][number]) for phase, name in PHASES.items()}
            content: dict[str, Any] = {
                "obj_path": str(assets),
                "obj_scale": grasped.scale,
                "obj_pose": np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]),
                **{f"{phase}_qpos": np.array([*placed, *(posture[name] for name in joint_names)]) for phase, posture in values.items()},
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
    mesh = trimesh.Trimesh(grasped.points(grasped.mesh.vertices), grasped.mesh.faces, process=False)
    mesh.export(path, digits=DIGITS)


def _write_object(grasped: GraspedObject, folder: Path) -> None:
    """Write an object's mesh and convex parts, and its volume as the mass of a density of 1."""
    (folder / "mesh").mkdir(parents=True)
    _write_mesh(grasped, folder / "mesh" / "simplified.obj")
    meshes = folder / "urdf" / "meshes"
    meshes.mkdir(parents=True)
    volume = 0.0
    for number, part in enumerate(convex_parts(grasped.mesh)):
        hull = trimesh.convex.convex_hull(grasped.points(part))
        hull.export(meshes / f"convex_piece_{number:03d}.obj")
        volume += float(hull.volume)
    (folder / "info").mkdir()
    (folder / "info" / "simplified.json").write_text(json.dumps({"mass": volume, "density": 1.0, "scale": 1.0}))
