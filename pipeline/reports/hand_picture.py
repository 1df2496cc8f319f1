"""A hand as its file describes it, from three sides: palm, sensors, closing directions and links that overlap."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from numpy.typing import NDArray

from pipeline.kernels.geometry.transforms import transform_points
from pipeline.kernels.hand.kinematics import forward_kinematics, sensor_poses_from_links
from pipeline.kernels.hand.model import Hand
from pipeline.reports.contact_sheet_page import finger_colors
from pipeline.reports.picture_row import save_figure

VIEWS = {"from +x": (1, 2, 0), "from +y": (0, 2, 1), "from +z": (0, 1, 2)}
"""Title, and the axes of the root link that go right, up and towards the eye."""

MAX_TRIANGLES = 20_000
"""Per link and picture: of more, some are left out."""

STEP = 0.05
"""Share of every joint's range by which the closing directions look ahead."""


def hand_picture(hand: Hand, widths: Sequence[float], overlaps: Sequence[tuple[int, int]], path: Path) -> None:
    """Draw a hand at rest: every joint at 0, or at its limit nearest to 0.

    Parameters
    ----------
    hand
        Its collision shapes are drawn.
    widths
        (S,) side of every sensor plane, m.
    overlaps
        Pairs of links that are drawn in red.
    path
        PNG file.
    """
    rest = np.clip(0.0, hand.lower, hand.upper)
    frames = forward_kinematics(hand, np.eye(4), rest)
    sensors, closing = sensor_poses_from_links(hand, frames), closing_directions(hand, rest)
    red = {link for pair in overlaps for link in pair}
    colors = np.array(finger_colors(len(sensors))) / 255
    figure = Figure(figsize=(18, 7), layout="constrained")
    for axes, (title, (right, up, eye)) in zip(figure.subplots(1, 3), VIEWS.items(), strict=True):
        triangles, shades = _triangles(hand, frames, eye, red)
        order = np.argsort(triangles[:, :, eye].mean(axis=1))
        axes.add_collection(
            PolyCollection(list(triangles[order][:, :, [right, up]]), facecolors=shades[order], edgecolors="none", alpha=0.6)
        )
        _arrow(axes, hand.palm_centre[[right, up]], hand.palm_facing[[right, up]] * 0.04, "black", "palm")
        for number, (pose, color) in enumerate(zip(sensors, colors, strict=True)):
            corners = widths[number] / 2 * np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0], [-1, -1, 0]])
            square = transform_points(pose, corners)[:, [right, up]]
            axes.plot(square[:, 0], square[:, 1], color=color)
            _arrow(axes, pose[[right, up], 3], pose[[right, up], 0] * widths[number], color, "+x")
            _arrow(axes, pose[[right, up], 3], closing[number][[right, up]], color, hand.sensors[number].name, dashed=True)
        axes.set(title=title, xlabel="xyz"[right] + ", m", ylabel="xyz"[up] + ", m", aspect="equal")
        axes.autoscale_view()
    figure.suptitle(f"{hand.name}: sensor planes with their +x, dashed: where a sensor moves as its finger closes, red: links that overlap")
    save_figure(figure, path, dpi=90)


def closing_directions(hand: Hand, joint_angles: NDArray[np.float64]) -> NDArray[np.float64]:
    """Compute how far each sensor goes along its normal, by its finger's joints together.

    Parameters
    ----------
    hand, joint_angles
        (J,) rad: the posture to close from.

    Returns
    -------
    (S, 3) float64, m: every joint moves by a share of its range in the sense that carries the sensor forwards.
    """
    rest = sensor_poses_from_links(hand, forward_kinematics(hand, np.eye(4), joint_angles))
    steps = STEP * (hand.upper - hand.lower)
    moved = sensor_poses_from_links(hand, forward_kinematics(hand, np.eye(4), joint_angles + np.diag(steps)))  # (J, S, 4, 4)
    shift = moved[..., :3, 3] - rest[:, :3, 3]  # (J, S, 3)
    forwards = np.einsum("jsi,si->js", shift, rest[:, :3, 2])
    return np.asarray(np.einsum("jsi,js->si", shift, np.sign(forwards)))


def _triangles(hand: Hand, frames: NDArray[np.float64], eye: int, red: set[int]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The triangles of all collision shapes (T, 3, 3), root frame, m, and their colours (T, 3): lighter where they face the eye."""
    found, colors = [], []
    for number, link in enumerate(hand.links):
        for shape in link.collisions:
            faces = shape.mesh.faces[:: 1 + len(shape.mesh.faces) // MAX_TRIANGLES]
            corners = transform_points(frames[number], shape.mesh.vertices)[faces]
            normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
            facing = np.abs(normals[:, eye]) / np.maximum(np.linalg.norm(normals, axis=1), 1e-12)
            base = np.array([0.9, 0.2, 0.2]) if number in red else np.array([0.6, 0.65, 0.7])
            found.append(corners)
            colors.append(base * (0.5 + 0.5 * facing[:, None]))
    return np.concatenate(found or [np.empty((0, 3, 3))]), np.concatenate(colors or [np.empty((0, 3))])


def _arrow(axes: Any, start: NDArray[np.float64], by: NDArray[np.float64], color: Any, label: str, dashed: bool = False) -> None:
    style = {"arrowstyle": "->", "color": color, "linestyle": "--" if dashed else "-", "linewidth": 1.5}
    axes.annotate("", xy=start + by, xytext=start, arrowprops=style)
    axes.text(*(start + by), label, color=color, fontsize=7)
    axes.update_datalim([start, start + by])  # annotations alone do not widen the view
