"""Measure the steps of a slide: friction alone, and the whole step with depth, pressure and tactile image."""

from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np
import trimesh

import vt_pipeline as vt
from benchmarks.timing import Table, over_items, quantiles, side_by_side
from pipeline.kernels.touch.elastic_contact import PressedGel, contact_cells
from pipeline.kernels.touch.friction import FrictionState, drag_gel, object_motion
from pipeline.kernels.touch.sensor import Gel, Sensor

FRICTION, STEPS = 0.5, 8
"""Coefficient; steps of each of press, slide and twist."""
CASES = ((100, 100), 0.0095, 0.0009), ((240, 320), 0.006, 0.0009), ((240, 320), 0.0125, 0.00127)
"""Rows and columns of a GelSight Mini's image; the ball's radius and how deep it is pressed, m."""
PHASES = "press", "slide by 0.3 mm", "twist by 0.25 rad"


class Step(NamedTuple):
    """Inputs of one step of a slide."""

    before: vt.SlidingTouch | None
    pose: np.ndarray
    gel: PressedGel
    motion: np.ndarray
    state: FrictionState


def measure(data: Path, turns: int) -> Table:
    """Measure `turns` rounds of every case and phase; no dataset is needed."""
    table = Table(
        "Slides: friction, and the whole step",
        ["ms per step of friction, least / median", "ms per whole step, least / median", "friction, by step: median / 99 % / most"],
        [
            f"{STEPS} steps each of a press, a slide and a twist of a ball, friction {FRICTION}, on an elastic gel of 4 mm. Processor "
            "milliseconds of one core; the whole step is depth of a mesh of 20,480 faces, pressure, friction and tactile image."
        ],
    )
    for shape, radius, depth in CASES:
        sensor = vt.load_sensor("gelsight_mini", shape=shape).model_copy(update={"gel": Gel(modulus=2e5, thickness=0.004)})
        mesh = trimesh.creation.icosphere(subdivisions=5, radius=radius)
        ball = vt.load_object((mesh.vertices, mesh.faces))
        steps = list(_steps(ball, sensor, _path(sensor, radius, depth)))
        cells = int(steps[-1].gel.contact.any(axis=0).sum()) // contact_cells(sensor)[0]
        for number, phase in enumerate(PHASES):
            chosen = steps[number * STEPS : (number + 1) * STEPS]

            def friction(step: Step, worn: Sensor = sensor) -> None:
                drag_gel(step.gel, step.motion, step.state, worn, FRICTION)

            def whole(step: Step, worn: Sensor = sensor, pressed: vt.TouchObject = ball) -> None:
                list(vt.slide(pressed, worn, step.pose, friction=FRICTION, after=step.before))

            times = side_by_side({"friction": over_items(friction, chosen), "whole": over_items(whole, chosen)}, turns)
            by_step = [min(over_items(friction, [step])() for _ in range(turns)) for step in chosen]
            name = f"{shape[0]} × {shape[1]} pixels, {cells} cells across the contact: {phase}"
            table.add(name, times["friction"], times["whole"], quantiles(by_step))
    return table


def _path(sensor: Sensor, radius: float, depth: float) -> np.ndarray:
    """Press from above, slide along x and twist about the sensor's axis, after a pose that touches nothing."""
    time = np.arange(3 * STEPS + 1)
    turn, poses = np.interp(time, [2 * STEPS, 3 * STEPS], [0, 0.25]), np.zeros((len(time), 4, 4))
    poses[:, 0, 0], poses[:, 0, 1], poses[:, 1, 0], poses[:, 1, 1] = np.cos(turn), -np.sin(turn), -np.sin(turn), -np.cos(turn)
    poses[:, 2, 2], poses[:, 3, 3] = -1, 1
    poses[:, 0, 3] = np.interp(time, [STEPS, 2 * STEPS], [0, 3e-4])
    poses[:, 2, 3] = radius + sensor.w - np.interp(time, [0, STEPS], [-1e-5, depth])
    return poses


def _steps(ball: vt.TouchObject, sensor: Sensor, poses: np.ndarray) -> Iterator[Step]:
    touches = list(vt.slide(ball, sensor, poses, friction=FRICTION))
    for before, now in pairwise(touches):
        motion = object_motion(now.depth, before.pose, now.pose, sensor)
        yield Step(before, now.pose, now.gel, motion, before.state)
