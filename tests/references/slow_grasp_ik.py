"""The inverse kinematics on a distance grid, with every posture measured in full; numpy, in the same order of additions."""

import numpy as np

from pipeline.kernels.geometry.transforms import compose
from pipeline.kernels.hand import grasp_ik as constants
from pipeline.kernels.hand.distance_field import DistanceField
from pipeline.kernels.hand.grasp_ik import GraspIk
from pipeline.kernels.hand.kinematics import forward_kinematics
from pipeline.kernels.hand.self_collision import choose_postures, fingers_clear_of_palm


def slow_distance(field: DistanceField, points: np.ndarray) -> np.ndarray:
    """Distances (...) of points (..., 3) float32, to first order from the nearest cell."""
    single = np.float32
    place = np.clip((points - field.origin.astype(single)) * single(1 / field.cell), 0, np.array(field.inside.shape, single) - 1)
    index = (place + single(0.5)).astype(np.int64)
    x, y, z = np.moveaxis((place - index.astype(single)) * single(field.cell), -1, 0)
    value, along_x, along_y, along_z = np.moveaxis(field.records[tuple(np.moveaxis(index, -1, 0))], -1, 0)
    return value + ((along_x * x + along_y * y) + along_z * z)


def slow_contact_values(ik: GraspIk, field: DistanceField, frames: np.ndarray) -> np.ndarray:
    """(N, F) values of postures that are clear."""
    values = np.zeros((len(frames), len(ik.hand.fingers)), np.float32)
    for f, finger in enumerate(ik.hand.fingers):
        for s in finger.sensors:
            tip = frames[:, None, ik.hand.sensors[s].link]
            probes = (tip[..., :3, :3] * ik.gels[s][:, None]).sum(axis=-1) + tip[..., :3, 3]
            distance = slow_distance(field, probes.astype(np.float32))
            miss = np.maximum(distance.min(axis=1), 0) / np.float32(1e-3)
            coverage = (distance < 0).mean(axis=1, dtype=np.float32)
            values[:, f] += np.where(miss == 0, 2 + coverage, 0) - np.float32(0.1) * miss
    return values


def slow_clearance(ik: GraspIk, field: DistanceField, frames: np.ndarray) -> np.ndarray:
    """(N, F) m, of the nearest sphere of each finger."""
    clearance = []
    for own in ik.fingers:
        links = frames.astype(np.float32)[:, own.link]
        turned = links[..., :3, :3] * own.centres.astype(np.float32)[:, None]
        centres = (turned[..., 0] + turned[..., 1]) + (turned[..., 2] + links[..., :3, 3])
        clearance.append((slow_distance(field, centres) - own.radii.astype(np.float32)).min(axis=1))
    return np.stack(clearance, axis=1)


def slow_values(ik: GraspIk, field: DistanceField, frames: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Values (N, F) of postures, and whether they are clear."""
    clearance = slow_clearance(ik, field, frames)
    lack = np.maximum(np.float32(ik.clearance) - clearance, 0) / np.float32(1e-3)
    return slow_contact_values(ik, field, frames) - 2 * lack, clearance >= np.float32(ik.clearance)


def slow_grasp_ik(ik: GraspIk, field: DistanceField, pose: np.ndarray, *, rounds: int, rng: np.random.Generator) -> np.ndarray | None:
    """Joint angles (J,) that touch an object, as `grasp_ik` finds them."""
    hand, columns = ik.hand, [list(finger.joints) for finger in ik.hand.fingers]
    margin = np.minimum(constants.LIMIT_MARGIN, constants.LIMIT_SHARE * (hand.upper - hand.lower))
    slides = [hand.joints[link - 1].kind == "prismatic" for link in hand.joint_links]
    size = np.where(slides, constants.STEP_SHARE * (hand.upper - hand.lower), constants.STEP)
    lines, rest = _best_samples(ik, field, pose)
    for k in range(rounds):
        steps = size * constants.SHRINK**k * rng.standard_normal((len(lines), constants.STEPS_PER_POSTURE + 1, lines.shape[1]))
        children = np.concatenate([lines[:, None], lines[:, None] + steps[:, 1:]], axis=1)
        children = np.clip(children, hand.lower + margin, hand.upper - margin)
        values, _ = slow_values(ik, field, forward_kinematics(hand, pose, children.reshape(-1, lines.shape[1])))
        best = values.reshape(*children.shape[:2], -1).argmax(axis=1)
        for row, family in enumerate(children):
            for own, choice in zip(columns, best[row], strict=True):
                lines[row, own] = family[choice, own]
    options = np.concatenate([lines, rest])
    frames = forward_kinematics(hand, pose, options)
    values, clear = slow_values(ik, field, frames)
    clear &= fingers_clear_of_palm(hand, ik.boxes, forward_kinematics(hand, np.eye(4), options), ik.finger_gap)
    values = np.where(clear, values.astype(np.float64), -np.inf)
    rows = choose_postures(hand, ik.boxes, frames=frames, values=values, gap=ik.finger_gap)
    if not len(rows):
        return None
    chosen = options[0].copy()
    for own, row in zip(columns, rows[0], strict=True):
        chosen[own] = options[row, own]
    return chosen


def _best_samples(ik: GraspIk, field: DistanceField, pose: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Choose samples of best contact and value, to refine; and those of best value that are clear."""
    hand, near = ik.hand, np.float32(constants.NEAR_CONTACT)
    turned = pose.astype(np.float32)[:3, :3, None, None, None] * ik.probes
    distance = slow_distance(field, np.moveaxis(turned.sum(axis=1) + pose.astype(np.float32)[:3, 3, None, None, None], 0, -1))  # (K, S, P)
    excess = np.maximum(np.abs(distance.min(axis=-1) + near) - near, 0) / np.float32(1e-3)
    contact = (distance < 0).mean(axis=-1, dtype=np.float32) - excess
    spread = np.linspace(0, len(ik.postures.joint_angles) - 1, constants.EVEN_SAMPLES).astype(int)
    best, clearest = np.empty((2, max(constants.REFINED_POSTURES, constants.UNTOUCHING_POSTURES), len(hand.joint_names)))
    for f, finger in enumerate(hand.fingers):
        first = np.where(ik.postures.free[:, f], contact[:, list(finger.sensors)].sum(axis=1), -np.inf)
        rows = np.concatenate([np.argsort(-first, kind="stable")[: constants.MAX_CANDIDATES], spread])
        values, clear = (part[:, f] for part in slow_values(ik, field, compose(pose, ik.postures.frames[rows])))
        values = np.where(ik.postures.free[rows, f], values, -np.inf)
        for kept, ranked in ((best, values), (clearest, np.where(clear, values, -np.inf))):
            chosen = rows[np.argsort(-ranked, kind="stable")[: len(kept)]]
            kept[:, list(finger.joints)] = ik.postures.joint_angles[chosen][:, list(finger.joints)]
    return best[: constants.REFINED_POSTURES], clearest[: constants.UNTOUCHING_POSTURES]
