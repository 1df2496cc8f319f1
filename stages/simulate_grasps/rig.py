"""What grasping needs to know of the hand, prepared once a session, and of the object, prepared once an object."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.config.hand_file import load_hand
from pipeline.config.sensor_file import load_sensor
from pipeline.kernels.geometry.mesh import Mesh
from pipeline.kernels.hand.bodies import Balls, Boxes, collision_balls, collision_boxes
from pipeline.kernels.hand.distance import DistanceField, distance_field
from pipeline.kernels.hand.inverse import PostureSamples, Wanted, sample_postures
from pipeline.kernels.hand.model import Hand
from pipeline.kernels.hand.reach import FingerParts, finger_parts
from pipeline.kernels.touch.face_culling import BoxedFaces, box_faces
from pipeline.kernels.touch.sensor import Sensor
from stages.simulate_grasps.settings import GraspSettings

SEARCH_SPACING, SEARCH_TOLERANCE = 0.006, 0.002
"""m, of the balls that tell postures apart: 1,000 for all fingers, right to 1 mm."""
MEASURE_SPACING = 0.003
"""m, of the balls that measure penetration: right to 0.3 mm at edges, better on faces."""
FINGER_GAP = 0.001
"""m kept between fingers, and between fingers and palm."""
GRID_BAND = 0.012
"""m around the surface in which the distance grid holds: more than any ball's radius, and clear of the gel."""


@dataclass(frozen=True, eq=False)
class Rig:
    """The hand: model, sensor, and its parts as the searches see them."""

    hand: Hand
    sensor: Sensor
    parts: FingerParts
    palm: Balls
    dense: Balls
    boxes: Boxes
    samples: PostureSamples
    wanted: Wanted


@dataclass(frozen=True, eq=False)
class Scene:
    """The object: exterior points and normals (N, 3), its distance field, and its faces as sensors see them."""

    points: NDArray[np.float64]
    normals: NDArray[np.float64]
    field: DistanceField
    faces: BoxedFaces


def make_rig(settings: GraspSettings) -> Rig:
    """Load the hand and spread its postures."""
    hand = load_hand(settings.hand)
    sensor = load_sensor(hand.sensor)
    balls = collision_balls(hand, SEARCH_SPACING, SEARCH_TOLERANCE)
    moved = {link for finger in hand.fingers for link in finger.links}
    still = [link for link in range(len(hand.links)) if link not in moved]
    parts = finger_parts(hand, balls, sensor.width, sensor.w)
    boxes = collision_boxes(hand)
    return Rig(
        hand=hand,
        sensor=sensor,
        parts=parts,
        palm=balls.of(still),
        dense=collision_balls(hand, MEASURE_SPACING),
        boxes=boxes,
        samples=sample_postures(hand, parts, boxes, settings.ik_samples, FINGER_GAP),
        wanted=Wanted(clearance=settings.clearance, gap=FINGER_GAP, contact=0.0),
    )


def make_scene(mesh: Mesh, points: np.ndarray, normals: np.ndarray, cell: float) -> Scene:
    """Prepare an object: its mesh and exterior points with normals, world frame, m."""
    return Scene(
        points=points.astype(np.float64),
        normals=normals.astype(np.float64),
        field=distance_field(mesh.vertices, mesh.faces, cell, GRID_BAND),
        faces=box_faces(mesh.triangles),
    )
