"""How well and how fast objects are grasped: `python -m benchmarks.grasps --objects 3 --attempts 50`.

Penetration is measured by other means than those that choose grasps: random points on the collision boxes against igl's signed
distance with winding numbers, and random points on the object against the boxes.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass, field

import igl
import numpy as np
from numpy.typing import NDArray

from pipeline.kernels.geometry.exterior_sampling import sample_exterior
from pipeline.kernels.geometry.mesh import Mesh
from pipeline.kernels.geometry.normalise import normalise_mesh
from pipeline.kernels.geometry.triangle_sampling import sample_triangles
from pipeline.kernels.hand.kinematics import forward, sensor_poses
from pipeline.kernels.touch.contact import touch_success
from pipeline.kernels.touch.ray_depth import ray_depth
from pipeline.rng import numpy_rng
from pipeline.toy_objects import CATEGORIES, generate
from stages.simulate_grasps.attempt import Grasp, attempt, keep_best
from stages.simulate_grasps.physics import Simulation, simulation
from stages.simulate_grasps.rig import Rig, Scene, make_rig, make_scene
from stages.simulate_grasps.settings import GraspSettings

MORE_STEPS = 500
"""Steps that must not change a touch."""
POINTS = 200_000
"""Random points on the hand, and on the object, that look for penetration: about 1 mm apart."""


@dataclass
class Tally:
    """What was seen of one class."""

    touched: list[NDArray[np.bool_]] = field(default_factory=list)
    kept: list[Grasp] = field(default_factory=list)
    depths: list[float] = field(default_factory=list)
    flips: list[NDArray[np.bool_]] = field(default_factory=list)
    unsound: int = 0
    short: int = 0


def main() -> None:
    """Grasp procedural objects of every class and print the figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--objects", type=int, default=2, help="of each class")
    parser.add_argument("--attempts", type=int, default=50)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    settings = GraspSettings(attempts=options.attempts)
    start = time.perf_counter()
    rig = make_rig(settings)
    print(f"hand prepared in {time.perf_counter() - start:.2f} s")
    tallies = {category: Tally() for category in CATEGORIES}
    seconds, prepared = [], []
    with simulation(rig.hand) as physics:
        for category, tally in tallies.items():
            for variant in range(options.objects):
                mesh = normalise_mesh(generate(category, numpy_rng(options.seed, "benchmark", category, variant)), "z", 0.5)
                points, normals = sample_exterior(mesh, 10_000, numpy_rng(options.seed, "points", category, variant))
                start = time.perf_counter()
                scene = make_scene(mesh, points, normals, settings.grid_cell)
                physics.load(mesh)
                prepared.append(time.perf_counter() - start)
                seconds += _grasp(rig, scene, physics, settings, mesh, tally, (options.seed, category, variant))
    print(
        f"object prepared in {np.mean(prepared):.2f} s; an attempt {1e3 * np.mean(seconds):.0f} ms, 95 % within "
        f"{1e3 * np.percentile(seconds, 95):.0f} ms"
    )
    _print(rig, tallies)


def _grasp(
    rig: Rig, scene: Scene, physics: Simulation, settings: GraspSettings, mesh: Mesh, tally: Tally, identity: tuple[int, str, int]
) -> list[float]:
    seconds: list[float] = []
    kept: list[Grasp] = []
    changed: dict[int, NDArray[np.bool_]] = {}
    for number in range(settings.attempts):
        start = time.perf_counter()
        grasp = attempt(rig, scene, physics, settings, numpy_rng(*identity, "attempt", number))
        seconds.append(time.perf_counter() - start)
        tally.touched.append(grasp.touched if grasp else np.zeros(len(rig.hand.fingers), bool))
        tally.unsound += grasp is None or not grasp.sound
        before = len(kept), min((int(one.touched.sum()) for one in kept), default=0)
        kept = keep_best(kept, grasp, settings.grasps)
        if grasp and (before[0] < settings.grasps or grasp.touched.sum() > before[1]):
            angles, _ = physics.advance((MORE_STEPS, MORE_STEPS), 0.0)
            later = [
                touch_success(ray_depth(scene.faces, pose, rig.sensor), rig.sensor)
                for pose in sensor_poses(rig.hand, grasp.hand_pose, angles)
            ]
            changed[id(grasp)] = grasp.touched != np.array(later)
    tally.short += len(kept) < settings.grasps
    tally.kept += kept
    tally.flips += [changed[id(grasp)] for grasp in kept]
    tally.depths += [independent_depth(rig, mesh, grasp, numpy_rng(*identity, "depth", k)) for k, grasp in enumerate(kept)]
    return seconds


def independent_depth(rig: Rig, mesh: Mesh, grasp: Grasp, rng: np.random.Generator, points: int = POINTS) -> float:
    """Deepest of so many random points on the collision boxes in the object, or on the object in the boxes, m; 0 where there is none."""
    frames = forward(rig.hand, grasp.hand_pose, grasp.joint_angles)[rig.boxes.link] @ rig.boxes.frames  # (C, 4, 4)
    half = rig.boxes.half
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


def _print(rig: Rig, tallies: dict[str, Tally]) -> None:
    fingers = "".join(f"{finger.name:>8}" for finger in rig.hand.fingers)
    print(f"{'touches, %':12}{'all':>8}{fingers}{'kept':>8}{fingers}{'unsound':>9}{'short':>7}")
    for name, tally in tallies.items():
        print(f"{name:12}{_shares(tally.touched)}{_shares([g.touched for g in tally.kept])}{tally.unsound:9}{tally.short:7}")
    touched = [one for tally in tallies.values() for one in tally.touched]
    kept = [grasp.touched for tally in tallies.values() for grasp in tally.kept]
    print(f"{'together':12}{_shares(touched)}{_shares(kept)}   (the supplement's: 62.7 kept)")
    for label, rows in (("all attempts", touched), ("kept", kept)):
        histogram = np.bincount([int(row.sum()) for row in rows], minlength=len(rig.hand.fingers) + 1) / len(rows)
        print(f"{label + ' with 0 … touches, %':36}" + "".join(f"{100 * part:8.1f}" for part in histogram))
    depths = 1e3 * np.array([depth for tally in tallies.values() for depth in tally.depths])
    flips = np.array([flip for tally in tallies.values() for flip in tally.flips])
    print(
        f"penetration, measured independently: ≤ 1 mm {100 * np.mean(depths <= 1):.1f} %, median {np.median(depths):.3f}, "
        f"99 % {np.percentile(depths, 99):.3f}, worst {depths.max():.3f} mm"
    )
    print(f"{MORE_STEPS} more steps change {100 * flips.mean():.2f} % of touches, {100 * flips.any(axis=1).mean():.2f} % of grasps")


def _shares(rows: list[NDArray[np.bool_]]) -> str:
    table = 100 * np.array(rows)
    return f"{table.mean():8.1f}" + "".join(f"{part:8.1f}" for part in table.mean(axis=0))


if __name__ == "__main__":
    main()
