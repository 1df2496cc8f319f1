"""How sound the grasps of a data set are, measured anew: `python -m benchmarks.stored_grasps DATA`.

Penetration by other means than those that chose the grasps, and whether touches outlast 500 more steps of physics. Meshes
that are not watertight have no inside for a winding number to tell: of them only the object's points in the hand count.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.grasps import MORE_STEPS, POINTS, independent_depth
from pipeline.dataset.mesh_rows import read_mesh
from pipeline.kernels.hand.kinematics import sensor_poses
from pipeline.kernels.touch.contact import touch_success
from pipeline.kernels.touch.face_culling import box_faces
from pipeline.kernels.touch.ray_depth import ray_depth
from pipeline.store.collection import Collection
from pipeline.store.layout import Layout
from schemas.grasps import GRASPS
from schemas.surfaces import SURFACES
from stages.simulate_grasps.attempt import Grasp
from stages.simulate_grasps.physics import simulation
from stages.simulate_grasps.rig import make_rig
from stages.simulate_grasps.settings import GraspSettings


@dataclass(frozen=True, eq=False)
class Seen:
    """A stored grasp: how deep it is, measured and as recorded, m; which sensors touch, and for which 500 steps change that."""

    depth: float
    recorded: float
    touched: NDArray[np.bool_]
    changed: NDArray[np.bool_]
    watertight: bool


def examine(data: Path, points: int = POINTS) -> dict[str, list[Seen]]:
    """Measure every grasp of a data set, by object, with so many points on hand and object."""
    surfaces, grasps = Collection(Layout(data), SURFACES), Collection(Layout(data), GRASPS)
    rig = make_rig(GraspSettings())
    found: dict[str, list[Seen]] = {}
    with simulation(rig.hand) as physics:
        for object_id in grasps:
            if not grasps.view(object_id)["ok"]:
                continue
            row, surface = grasps.view(object_id), surfaces.view(object_id)
            mesh = read_mesh(surface)
            faces = box_faces(mesh.triangles)
            physics.load(mesh)
            for g, (pose, angles) in enumerate(zip(row["hand_pose"], row["joint_angles"], strict=True)):
                touched, recorded = row["touch_success"][g], float(row["penetration"][g])
                grasp = Grasp(pose, angles, row["sensor_pose"][g], touched, recorded, True)
                depth = independent_depth(rig, mesh, grasp, np.random.default_rng(g), points)
                physics.settle(pose, angles, angles, (0, 0), 0.0)
                later, _ = physics.advance((MORE_STEPS, MORE_STEPS), 0.0)
                after = [touch_success(ray_depth(faces, sensor, rig.sensor), rig.sensor) for sensor in sensor_poses(rig.hand, pose, later)]
                found.setdefault(object_id, []).append(
                    Seen(depth, recorded, touched, touched != np.array(after), bool(surface["watertight"]))
                )
    return found


def main() -> None:
    """Print the figures."""
    seen = [one for found in examine(Path(sys.argv[1])).values() for one in found]
    for name, chosen in (("watertight", [one for one in seen if one.watertight]), ("other", [one for one in seen if not one.watertight])):
        if chosen:
            mm = 1e3 * np.array([one.depth for one in chosen])
            print(
                f"{name}: {len(mm)} grasps, ≤ 1 mm inside {100 * np.mean(mm <= 1):.1f} %, median {np.median(mm):.3f}, "
                f"99 % {np.percentile(mm, 99):.3f}, worst {mm.max():.3f} mm; as recorded, worst "
                f"{1e3 * max(one.recorded for one in chosen):.3f} mm"
            )
    changed = np.array([one.changed for one in seen])
    print(f"{MORE_STEPS} more steps change {100 * changed.mean():.2f} % of touches, {100 * changed.any(axis=1).mean():.2f} % of grasps")


if __name__ == "__main__":
    main()
