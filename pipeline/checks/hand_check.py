"""Check a hand file: joints, overlaps and faults, and a picture of the hand from three sides."""

from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from pipeline.console import Meter, abbreviate, errors, pluralise, with_progress
from pipeline.drawing.colors import finger_colors
from pipeline.drawing.plots import save_figure
from pipeline.errors import InvalidInput
from pipeline.formats.hand_file import load_hand, read_model
from pipeline.formats.sensor_file import load_worn_sensors, sensor_names
from pipeline.formats.urdf import ignored_limits
from pipeline.kernels.arrays import Array
from pipeline.kernels.geometry.mesh import Mesh, face_cross_products
from pipeline.kernels.geometry.mesh_cleaning import POSITION
from pipeline.kernels.geometry.transforms import transform_points
from pipeline.kernels.hand.collision_shapes import CollisionBoxes, collision_boxes, collision_spheres
from pipeline.kernels.hand.convex_shapes import convex_error
from pipeline.kernels.hand.grasp_ik import blocked_fingers, sample_postures
from pipeline.kernels.hand.kinematics import forward_kinematics, opening, sensor_poses_from_links, sensor_positions
from pipeline.kernels.hand.model import Hand, Link
from pipeline.kernels.hand.self_collision import LinkOverlap, frequent_overlaps, remedy
from pipeline.kernels.hand.sensor_mounts import misplaced_sensors, palm_notes, surface_notes
from pipeline.kernels.touch.depth_maps import gel_surface
from pipeline.kernels.touch.sensor import Sensor
from pipeline.physics.hand_urdf import GEARED_INERTIA, geared_links, inertia_notes
from pipeline.physics.simulation import Simulation
from pipeline.rng import numpy_rng
from stages.simulate_grasps.grasp_search import OVERLOADED, GraspSearch
from stages.simulate_grasps.plans import TouchPlanner
from stages.simulate_grasps.prepare import MEASURE_SPACING, finger_gap, prepare_hand, prepare_object
from stages.simulate_grasps.stage import GraspSettings

POSTURES = 512  # random postures in which links are checked for overlaps
MIN_TRAVEL = 1e-3  # m, least travel of a sensor along its normal as its finger closes
FAR_PALM = 2.0  # a palm is far if no sensor comes nearer to its centre than this many times the greatest distance between two sensors
LARGE = 2.0  # m, that no hand opens
VIEWS = {"from +x": (1, 2, 0), "from +y": (0, 2, 1), "from +z": (0, 1, 2)}
"""Title, and the axes of the root link that point right, up and towards the viewer."""
MAX_TRIANGLES = 20_000  # of each collision shape in a picture; others are not drawn
ROUNDED = 0.01  # share of a joint's range by which it may pass its limits: multipliers and limits are rounded
HOLLOW = 2e-3  # m, depth from which a hollow that a convex shape fills is reported: more than a gel is pressed in
RED, GREY = (0.9, 0.2, 0.2), (0.6, 0.65, 0.7)  # colours of links that overlap, and of others, where they face the viewer
ARROW = 0.15  # length of the palm's arrow, and of a sensor's longest motion, as a share of the hand's size
STEP = 0.05  # share of every joint's range by which joints move to find the closing directions
ATTEMPTS = 10
BALL_SHARE = 0.5  # diameter of the ball, as a share of the hand's opening
NO_ROOM = "the hand has no room around the ball"
PALM = "let palm.facing and palm.centre of the hand file point to where an object lies; the picture draws them"
REMEDIES = {  # what to do if no attempt succeeds, by how the most frequent reason begins
    NO_ROOM: PALM,
    "fingers still move": "lower torque in the hand file",
    "a joint is pushed": "lower torque in the hand file",
    OVERLOADED: "raise torque in the hand file, or name a sensor with a softer or thicker gel",
    "links of the hand": "write the entries that end the overlaps into the hand file",
    "a rigid link": "lay the sensors' origins on the surface of their links, and normals outwards, in the hand file",
}


def check_hand(path: Path, picture: Path) -> list[str]:
    """Describe a hand file and the links that collide, and draw it; parameters, result and errors as `check_file`."""
    hand = load_hand(path)
    model = read_model(hand.model, hand.links[0].name)  # as it is, meshes and all
    sensors = load_worn_sensors(sensor_names(hand))
    angles = numpy_rng(0, "check", hand.name).uniform(hand.lower, hand.upper, (POSTURES, len(hand.lower)))
    boxes = collision_boxes(hand)
    overlaps = frequent_overlaps(hand, boxes, forward_kinematics(hand, np.eye(4), angles))
    draw_hand(hand, sensors, {link for overlap in overlaps for link in (overlap.first, overlap.second)}, picture)
    fingers = ", ".join(
        f"{finger.name} ({pluralise(len(finger.joints), 'joint')}, {pluralise(len(finger.sensors), 'sensor')})" for finger in hand.fingers
    )
    misplaced = list(misplaced_sensors(hand, sensors))
    try:
        collision_spheres(hand, spacing=MEASURE_SPACING)
        unusable = []
    except InvalidInput as error:  # a shape is flat or too large; `simulate-grasps` says the same
        unusable = [str(error)]
    faults = [f"fault: {text}" for text in (*_faults(hand, boxes), *unusable, *(text for is_fault, text in misplaced if is_fault))]
    trial = [] if faults else trial_grasps(path)
    faulty = any(line.startswith("fault:") for line in (*faults, *trial))
    return [
        f"{path}: hand {hand.name}, {len(hand.links)} links, {'faults below' if faulty else 'no faults'}",
        f"moves: {fingers}; joints that follow another: {len(hand.followers)}, frozen: {len(hand.frozen)}",
        f"motors {hand.torque:g} {hand.torque_unit}, friction {hand.friction:g}, opens {1e3 * opening(hand):.0f} mm",
        *faults,
        *(f"warning: {text}" for is_fault, text in misplaced if not is_fault),
        *(f"warning: {text}" for text in palm_notes(hand, sensors, GraspSettings().least_distance, GraspSettings().greatest_distance)),
        *(_overlap_line(hand, overlap) for overlap in overlaps),
        *([f"to end these overlaps: write {remedy(hand, overlaps)} into the hand file"] if overlaps else []),
        *surface_notes(hand),
        *model.notes,
        *([] if unusable else _convex_notes(hand, model.links)),
        *_notes(hand),
        *trial,
        f"picture: {picture}",
    ]


def _faults(hand: Hand, boxes: CollisionBoxes) -> Iterator[str]:
    """Yield what keeps the hand from grasping; `simulate-grasps` stops with the same sentence at fingers that are blocked."""
    gap = finger_gap(hand)
    yield from blocked_fingers(hand, boxes, sample_postures(hand, boxes, samples=GraspSettings().ik_samples, gap=gap), gap=gap)
    for finger in hand.fingers:
        if not any(hand.links[link].collisions for link in finger.links):
            yield f"no link of {finger.name} has a collision shape"
    closing = closing_directions(hand, np.clip(0.0, hand.lower, hand.upper))
    for number in sorted({sensor for finger in hand.fingers for sensor in finger.sensors}):
        if np.linalg.norm(closing[number]) < MIN_TRAVEL:
            still = f"the sensor {hand.sensors[number].name} hardly moves along its normal as its finger closes"
            yield f"{still}; is the normal outward, and the link the tip?"
    if (width := opening(hand)) > LARGE:
        yield f"the hand opens {width:.3g} m; are lengths in its model or hand file in millimetres?"
    places = sensor_positions(hand)
    nearest = np.linalg.norm(places - hand.palm_centre, axis=-1).min()
    farthest = np.linalg.norm(places[:, :, None] - places[:, None], axis=-1).max()
    if len(hand.sensors) > 1 and nearest > FAR_PALM * farthest:  # as from the base of an arm
        yield (
            f"no sensor comes nearer to the palm's centre than {1e3 * nearest:.0f} mm, and sensors are at most {1e3 * farthest:.0f} mm "
            f"apart; is palm.link, {hand.links[0].name}, the link that the fingers grow from, and palm.centre in its frame?"
        )


def _overlap_line(hand: Hand, overlap: LinkOverlap) -> str:
    names = f"{hand.links[overlap.first].name}, {hand.links[overlap.second].name}"
    share, depth = f"{100 * overlap.share:.0f} % of random postures", f"{1e3 * overlap.depth:.1f} mm"
    return f"overlap: [{names}] in {share}, by {depth}"


def _convex_notes(hand: Hand, links: Sequence[Link]) -> Iterator[str]:
    """Describe what convex shapes in place of collision meshes lose, and the hollows that they fill."""
    meshed = [pair for pair in zip(links, hand.links, strict=True) if any(shape.kind == "mesh" for shape in pair[0].collisions)]
    measured = {
        link.name: convex_error(link, convex) for link, convex in with_progress(meshed, "measuring convex shapes", "links", after=1.0)
    }
    if not measured:
        return
    faces, kept = sum(error.faces for error in measured.values()), sum(error.kept for error in measured.values())
    yield (
        f"collision meshes of {pluralise(len(measured), 'link')} are taken as convex: {faces} faces became {kept}, and "
        f"{1e3 * max(error.lost for error in measured.values()):.2f} mm is the most that any of them lost"
    )
    deepest = sorted(measured.items(), key=lambda item: -item[1].filled)
    if hollows := [f"{name} {1e3 * error.filled:.0f} mm" for name, error in deepest if error.filled > HOLLOW]:
        yield f"hollows of meshes that this fills, by depth: {abbreviate(hollows)}; they matter where links overlap or block a finger"


def _notes(hand: Hand) -> Iterator[str]:
    yield from inertia_notes(hand)
    if geared := [hand.links[link].name for link in sorted(geared_links(hand))]:
        yield f"for the inertia of rotors, {GEARED_INERTIA:g} kg m² are added to links of coupled joints: {abbreviate(geared)}"
    if unseen := [link.name for link in hand.links if link.collisions and not link.visuals]:
        yield f"camera images do not show links that have collision shapes and no visual: {abbreviate(unseen)}"
    if endless := [joint.name for joint in hand.joints if joint.kind == "continuous" and joint.mimic is None]:
        yield f"warning: joints without limits, which may turn by half a turn either way: {abbreviate(endless)}; state those that they have"
    yield from (f"warning: {sentence}" for sentence in ignored_limits(hand))
    for follower in hand.followers:  # many files state their limits carelessly
        joint = hand.joints[follower.link - 1]
        lower, upper = hand.follower_range(follower)
        slack = ROUNDED * (joint.upper - joint.lower)
        if joint.kind != "continuous" and slack > 0 and (lower < joint.lower - slack or upper > joint.upper + slack):
            yield (
                f"warning: joint {joint.name} follows {hand.joint_names[follower.entry]} through {lower:.4g} … {upper:.4g}, beyond "
                f"its own limits {joint.lower:.4g} … {joint.upper:.4g}, which do not count: narrow those of the joint that it follows"
            )
    if hand.allowed_contacts:
        pairs = sorted(f"[{hand.links[first].name}, {hand.links[second].name}]" for first, second in hand.allowed_contacts)
        yield f"let overlap, as stated or as neighbours that do at rest: {', '.join(pairs)}"


def trial_grasps(path: Path) -> list[str]:
    """Attempt to grasp a ball with the hand of a file without faults, as `simulate-grasps` does.

    The lines say how many attempts are grasps, and with how many touches; why the others fail; and a fault if all fail, or if no
    gel touches. It is a warning if most fail: a hand whose fingers close along fixed curves may miss a ball, and touch other objects.
    """
    settings = GraspSettings(hand=str(path))
    prepared = prepare_hand(settings)
    radius = BALL_SHARE * opening(prepared.hand) / 2
    sphere = trimesh.creation.icosphere(subdivisions=4, radius=1.0)
    ball = Mesh.bare(POSITION + radius * sphere.vertices, np.asarray(sphere.faces))
    prepared_ball = prepare_object(ball, ball.vertices, np.asarray(sphere.vertices), reach=prepared.reach)
    with Simulation(prepared.hand) as physics, Meter(errors, "trial grasps", ATTEMPTS, "attempts", after=1.0) as meter:
        physics.load(ball)
        search = GraspSearch(TouchPlanner(prepared, prepared_ball, settings), physics)
        attempts = []
        for number in range(ATTEMPTS):
            attempts.append(search.attempt(numpy_rng(0, "check", prepared.hand.name, number)))
            meter.advance()
    touches = [int(attempt.grasp.touched.sum()) for attempt in attempts if attempt is not None and attempt.fault is None]
    reasons = Counter(NO_ROOM if attempt is None else attempt.fault for attempt in attempts if attempt is None or attempt.fault)
    summary = f"trial: {len(touches)} of {ATTEMPTS} attempts at a ball of {2e3 * radius:.0f} mm are grasps"
    if touches:
        summary += f", which touch with {np.mean(touches):.1f} of {len(prepared.sensors)} sensors"
    lines = [summary, *(f"trial: {count} failed: {reason}" for reason, count in reasons.most_common())]
    if not touches:
        worst = str(reasons.most_common(1)[0][0])
        remedy = next(remedy for reason, remedy in REMEDIES.items() if worst.startswith(reason))
        lines.append(f"fault: no attempt is a grasp, mostly because {worst}; {remedy}")
    elif not any(touches) and any(finger.sensors for finger in prepared.hand.fingers):
        kind = "fault" if 2 * len(touches) >= ATTEMPTS else "warning"
        lines.append(f"{kind}: no sensor touches the ball: do the sensors' normals point out of their links? Else {PALM}")
    return lines


def draw_hand(hand: Hand, sensors: Sequence[Sensor], red: set[int], path: Path) -> None:
    """Draw a hand at rest as a PNG, the links `red` in red: every joint at 0, or at its limit nearest to 0."""
    rest = np.clip(0.0, hand.lower, hand.upper)
    frames = forward_kinematics(hand, np.eye(4), rest)
    poses, closing = sensor_poses_from_links(hand, frames), closing_directions(hand, rest)
    colors = np.array(finger_colors(len(poses))) / 255
    gels = [[transform_points(pose, line) for line in gel_lines(sensor)] for pose, sensor in zip(poses, sensors, strict=True)]
    triangles, normals, base_colors = _triangles(hand, frames, red)
    size = np.ptp(np.concatenate([triangles.reshape(-1, 3), *(line for lines in gels for line in lines)]), axis=0)
    arrow = ARROW * float(size.max())
    closing *= arrow / max(float(np.linalg.norm(closing, axis=1).max(initial=0.0)), 1e-12)
    figure = Figure(figsize=(18, 7), layout="constrained")
    proportions = {"width_ratios": [(size[right] + arrow) / (size[up] + arrow) for right, up, _ in VIEWS.values()]}
    for axes, (title, (right, up, eye)) in zip(figure.subplots(1, 3, gridspec_kw=proportions), VIEWS.items(), strict=True):
        order, shades = np.argsort(triangles[:, :, eye].mean(axis=1)), base_colors * (0.5 + 0.5 * np.abs(normals[:, eye, None]))
        shapes = list(triangles[order][:, :, [right, up]])
        axes.add_collection(PolyCollection(shapes, facecolors=shades[order], edgecolors="none", alpha=0.6))
        _arrow(axes, hand.palm_centre[[right, up]], hand.palm_facing[[right, up]] * arrow, "black", "palm")
        for number, (pose, color) in enumerate(zip(poses, colors, strict=True)):
            for line in gels[number]:
                axes.plot(line[:, right], line[:, up], color=color, linewidth=1.2)
            _arrow(axes, pose[[right, up], 3], pose[[right, up], 0] * sensors[number].width, color, "+x")
            _arrow(axes, pose[[right, up], 3], closing[number][[right, up]], color, "", dashed=True)
        axes.set(title=title, xlabel="xyz"[right] + ", m", ylabel="xyz"[up] + ", m", aspect="equal")
        axes.autoscale_view()
    names = [Line2D([], [], color=color, label=mount.name) for mount, color in zip(hand.sensors, colors, strict=True)]
    figure.legend(handles=names, loc="outside lower center", ncols=min(len(names), 10))
    figure.suptitle(f"{hand.name}: gels with their +x, dashed: where a sensor moves as its finger closes, red: links that overlap")
    save_figure(figure, path, dpi=90)


def gel_lines(sensor: Sensor) -> list[Array]:  # (N, 3) sensor frame, m
    """Trace a gel: the rims of its base and of its surface, and the surface's middle row and column."""
    height = np.broadcast_to(gel_surface(sensor), sensor.shape)
    x, y = (np.linspace(-side / 2, side / 2, count) for side, count in ((sensor.width, sensor.cols), (sensor.height, sensor.rows)))
    grid = np.stack([*np.meshgrid(x, y), height], axis=-1)  # (rows, cols, 3)
    rim = np.concatenate([grid[0], grid[:, -1], grid[-1, ::-1], grid[::-1, 0]])
    return [rim * [1, 1, 0], rim, grid[sensor.rows // 2], grid[:, sensor.cols // 2]]


def closing_directions(
    hand: Hand,
    joint_angles: Array,  # (J,)
) -> Array:  # (S, 3) m
    """Compute how each sensor moves as every joint moves by `STEP` in the sense that carries the sensor along its normal."""
    rest = sensor_poses_from_links(hand, forward_kinematics(hand, np.eye(4), joint_angles))
    steps = STEP * (hand.upper - hand.lower)
    moved = sensor_poses_from_links(hand, forward_kinematics(hand, np.eye(4), joint_angles + np.diag(steps)))  # (J, S, 4, 4)
    shift = moved[..., :3, 3] - rest[:, :3, 3]  # (J, S, 3)
    forwards = np.einsum("jsi,si->js", shift, rest[:, :3, 2])
    return np.asarray(np.einsum("jsi,js->si", shift, np.sign(forwards)))


def _triangles(
    hand: Hand,
    frames: Array,  # (L, 4, 4) links to root
    red: set[int],  # links
) -> tuple[Array, Array, Array]:  # (T, 3, 3) root frame, m; (T, 3) unit normals; (T, 3) colours
    triangles, colors = [np.empty((0, 3, 3))], [np.empty((0, 3))]
    for number, link in enumerate(hand.links):
        for shape in link.collisions:
            faces = shape.mesh.faces[:: 1 + len(shape.mesh.faces) // MAX_TRIANGLES]
            triangles.append(transform_points(frames[number], shape.mesh.vertices)[faces])
            colors.append(np.broadcast_to(RED if number in red else GREY, (len(faces), 3)))
    corners = np.concatenate(triangles)
    normals = face_cross_products(corners)
    return corners, normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12), np.concatenate(colors)


def _arrow(axes: Any, start: Array, by: Array, color: Any, label: str, dashed: bool = False) -> None:
    style = {"arrowstyle": "->", "color": color, "linestyle": "--" if dashed else "-", "linewidth": 1.5}
    axes.annotate("", xy=start + by, xytext=start, arrowprops=style)
    axes.text(*(start + by), label, color=color, fontsize=7)
    axes.update_datalim([start, start + by])  # annotations alone do not widen the view
