"""The hand as grasping needs it, prepared once per session, and the object, prepared once per object."""

from dataclasses import dataclass
from importlib.util import cache_from_source
from pathlib import Path

import numpy as np

from pipeline.formats.file_cache import FileCache, stamps_of
from pipeline.formats.hand_file import CODE, keep_with_hand, load_hand
from pipeline.formats.sensor_file import load_worn_sensors, sensor_files, sensor_names
from pipeline.kernels.arrays import Array, Floats
from pipeline.kernels.geometry.mesh import Mesh
from pipeline.kernels.hand.collision_shapes import CollisionSpheres, collision_boxes, collision_spheres
from pipeline.kernels.hand.distance_field import DistanceField, build_distance_field
from pipeline.kernels.hand.grasp_ik import GraspIk, prepare_grasp_ik
from pipeline.kernels.hand.model import Hand
from pipeline.kernels.hand.self_collision import close_links
from pipeline.kernels.touch.ray_depth import BoxedFaces, box_faces
from pipeline.kernels.touch.sensor import Sensor
from stages.simulate_grasps.stage import GraspSettings, HandSettings

SEARCH_SPACING, SEARCH_TOLERANCE = 0.006, 0.002  # m, of the spheres by which postures are compared: 1,000 in all, accurate to 1 mm
MEASURE_SPACING = 0.003  # m, of the spheres that measure penetration: accurate to 0.3 mm at edges, better on faces
FINGER_GAP = 0.001  # m kept between fingers, and between fingers and palm; half of their gap at rest where that is less
CLEARANCE = 0.001  # m that rigid links keep from the object: 2 mm costs 4 % of the touches, under 1 mm contact begins to push
GRID_CELL = 0.005  # m of the distance grid: 2.5 mm changes no grasp and takes half as long again, with 10 mm one link was 0.2 mm deep
KEPT = Path(cache_from_source(__file__)).with_name("prepared_hands.pickle")
WRITTEN_BY = stamps_of([*CODE, Path(__file__)])


@dataclass(frozen=True, eq=False)
class MeasuredHand:
    """A hand with its fingers' sensors and the collision spheres of all links."""

    hand: Hand
    sensors: tuple[Sensor, ...]
    spheres: CollisionSpheres

    @property
    def reach(self) -> float:
        """Distance from an object, m, up to which distances must be known: the radius of the largest sphere."""
        return float(self.spheres.radii.max(initial=0.0))


@dataclass(frozen=True, eq=False)
class PreparedHand(MeasuredHand):
    """A hand with the collision spheres of its palm, too, and its inverse kinematics."""

    palm_spheres: CollisionSpheres
    ik: GraspIk

    @property
    def reach(self) -> float:
        """Distance from an object, m, up to which distances must be known: the clearance and the radius of the largest sphere."""
        return self.ik.clearance + max(float(spheres.radii.max(initial=0.0)) for spheres in (self.palm_spheres, *self.ik.fingers))


@dataclass(frozen=True, eq=False)
class PreparedObject:
    """An object as grasping needs it."""

    points: Array  # (N, 3) exterior, world, m
    normals: Array  # (N, 3) outward
    field: DistanceField
    faces: BoxedFaces


def measured_hand(settings: HandSettings) -> MeasuredHand:
    """Load the hand and sensors of these settings, and place the spheres that measure penetration."""
    hand = load_hand(settings.hand)
    sensors = load_worn_sensors(sensor_names(hand, settings.sensor))
    return MeasuredHand(hand, sensors, collision_spheres(hand, spacing=MEASURE_SPACING))


def prepare_hand(settings: GraspSettings) -> PreparedHand:
    """Load the hand and sensors of these settings and sample the hand's postures, or find them as an earlier run left them."""
    kept = FileCache(KEPT, WRITTEN_BY, limit=3)
    hand = load_hand(settings.hand)
    names = sensor_names(hand, settings.sensor)
    name = f"{hand.path} {names} {settings.ik_samples}"
    prepared: PreparedHand | None = kept.find(name)
    if prepared is None:
        prepared = _prepare(hand, load_worn_sensors(names), settings.ik_samples)
        keep_with_hand(kept, name, prepared, hand, sensor_files(names))
    return prepared


def _prepare(hand: Hand, sensors: tuple[Sensor, ...], samples: int) -> PreparedHand:
    spheres = collision_spheres(hand, spacing=SEARCH_SPACING, tolerance=SEARCH_TOLERANCE)
    ik = prepare_grasp_ik(hand, spheres, sensors, samples=samples, clearance=CLEARANCE, finger_gap=finger_gap(hand))
    palm_spheres = spheres.of_links(np.flatnonzero(hand.link_fingers < 0))
    return PreparedHand(hand, sensors, collision_spheres(hand, spacing=MEASURE_SPACING), palm_spheres, ik)


def finger_gap(hand: Hand) -> float:
    """Compute the gap that a hand's planned postures keep between links, m: fingers may be built closer than `FINGER_GAP`."""
    gaps = close_links(hand, collision_boxes(hand), 2 * FINGER_GAP).values()
    return max(min(gaps, default=2 * FINGER_GAP) / 2, 0.0)


def prepare_object(
    mesh: Mesh,  # world, m
    points: Floats,  # (N, 3) exterior, m
    normals: Floats,  # (N, 3) outward unit normals
    *,
    reach: float,  # of the hand, m: distances beyond it need be bounds only
) -> PreparedObject:
    """Prepare an object for grasping."""
    field = build_distance_field(mesh.vertices, mesh.faces, cell=GRID_CELL, band=reach)
    return PreparedObject(points.astype(np.float64), normals.astype(np.float64), field, box_faces(mesh.triangles))
