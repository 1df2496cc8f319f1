"""Measure how sound the grasps of a dataset are: `python -m benchmarks.stored_grasps DATA`.

Measures penetration independently of the grasp search (random points on the collision boxes against igl's signed distance with
winding numbers, and random points on the object against the boxes), and whether touches outlast 500 more steps of physics. Meshes
that are not watertight have no inside for a winding number: for them only the object's points in the hand count.
"""

import sys
from dataclasses import dataclass
from pathlib import Path

import igl
import numpy as np
from numpy.typing import NDArray

from benchmarks.timing import Table, quantiles
from pipeline.dataset.grasps import read_grasps
from pipeline.dataset.mesh_rows import read_mesh
from pipeline.kernels.geometry.mesh import Mesh, sample_triangles
from pipeline.kernels.hand.grasp import Grasp
from pipeline.kernels.hand.kinematics import forward_kinematics, sensor_poses
from pipeline.kernels.touch.depth_maps import touch_success
from pipeline.kernels.touch.ray_depth import box_faces, ray_depth
from pipeline.physics.simulation import Simulation
from pipeline.store.directory import DataDirectory
from schemas.grasps import GRASPS
from schemas.surfaces import SURFACES
from stages.simulate_grasps.prepare import PreparedHand, prepare_hand
from stages.simulate_grasps.stage import GraspSettings

MORE_STEPS = 500
"""Steps that must not change a touch."""
POINTS = 200_000
"""Random points on the hand and on the object for measuring penetration: about 1 mm apart."""


@dataclass(frozen=True, eq=False)
class ExaminedGrasp:
    """Hold penetration, measured and recorded, m, which sensors touch, and for which sensors `MORE_STEPS` steps change that."""

    depth: float
    recorded: float
    touched: NDArray[np.bool_]
    changed: NDArray[np.bool_]
    watertight: bool


def examine(data: Path, points: int = POINTS) -> dict[str, list[ExaminedGrasp]]:
    """Measure every grasp of a dataset, by object, with this number of points on hand and object."""
    surfaces, grasps = DataDirectory(data).collection(SURFACES), DataDirectory(data).collection(GRASPS)
    settings = grasps.first.attributes["settings"]
    prepared = prepare_hand(GraspSettings(hand=settings["hand"], sensor=settings.get("sensor")))
    hand, sensors = prepared.hand, prepared.sensors
    examined: dict[str, list[ExaminedGrasp]] = {}
    with Simulation(hand) as physics:
        for object_id in grasps:
            if not grasps.view(object_id)["ok"]:
                continue
            row, surface = grasps.view(object_id), surfaces.view(object_id)
            mesh = read_mesh(surface)
            faces = box_faces(mesh.triangles)
            physics.load(mesh)
            for g, grasp in enumerate(read_grasps(row)):
                pose, angles, touched, recorded = grasp.hand_pose, grasp.joint_angles, grasp.touched, float(row["penetration"][g])
                depth = independent_depth(prepared, mesh, grasp, np.random.default_rng(g), points)
                later, _ = physics.settle(pose, angles, angles, max_steps=MORE_STEPS, resting_speed=0.0)
                after = [
                    touch_success(ray_depth(faces, at, sensor), sensor)
                    for at, sensor in zip(sensor_poses(hand, pose, later), sensors, strict=True)
                ]
                examined.setdefault(object_id, []).append(
                    ExaminedGrasp(depth, recorded, touched, touched != np.array(after), bool(surface["watertight"]))
                )
    return examined


def independent_depth(prepared: PreparedHand, mesh: Mesh, grasp: Grasp, rng: np.random.Generator, points: int = POINTS) -> float:
    """Measure how deep random points on the collision boxes lie in the object, or points on the object in the boxes, m; 0 if none does."""
    boxes = prepared.ik.boxes
    frames = forward_kinematics(prepared.hand, grasp.hand_pose, grasp.joint_angles)[boxes.link] @ boxes.frames  # (C, 4, 4)
    half = boxes.half
    share = points // len(half)
    unit = rng.uniform(-1, 1, (len(half), share, 3))
    axis = rng.integers(3, size=(len(half), share, 1))
    np.put_along_axis(unit, axis, np.sign(rng.uniform(-1, 1, axis.shape)), axis=2)
    on_hand = (np.einsum("cij,cpj->cpi", frames[:, :3, :3], unit * half[:, None]) + frames[:, None, :3, 3]).reshape(-1, 3)
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    on_hand = on_hand[((on_hand > low) & (on_hand < high)).all(axis=1)]
    deepest = 0.0
    if len(on_hand):
        signed, *_ = igl.signed_distance(
            on_hand, mesh.vertices, mesh.faces.astype(np.int64), sign_type=igl.SIGNED_DISTANCE_TYPE_FAST_WINDING_NUMBER
        )
        deepest = max(deepest, -float(np.min(signed)))
    on_object = np.concatenate([sample_triangles(mesh.triangles, points, rng)[0], mesh.vertices])
    for frame, extent in zip(frames, half, strict=True):
        inside = (extent - np.abs((on_object - frame[:3, 3]) @ frame[:3, :3])).min(axis=1)
        deepest = max(deepest, float(inside.max()))
    return deepest


def main() -> None:
    """Print the figures."""
    examined = [grasp for of_object in examine(Path(sys.argv[1])).values() for grasp in of_object]
    table = Table("Stored grasps", ["grasps", "≤ 1 mm inside, %", "mm inside: median / 99 % / most", "most as recorded, mm"])
    for name, closed in (("watertight", True), ("other", False)):
        mm = 1e3 * np.array([[grasp.depth, grasp.recorded] for grasp in examined if grasp.watertight == closed]).reshape(-1, 2)
        if len(mm):
            table.add(name, len(mm), f"{100 * np.mean(mm[:, 0] <= 1):.1f}", quantiles(mm[:, 0]), f"{mm[:, 1].max():.3f}")
    changed = np.array([grasp.changed for grasp in examined])
    shares = f"{100 * changed.mean():.2f} % of touches, {100 * changed.any(axis=1).mean():.2f} % of grasps"
    print(table.markdown(f"{MORE_STEPS} more steps change {shares}."))


if __name__ == "__main__":
    main()
