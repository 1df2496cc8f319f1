"""A grasp: the hand's pose and postures, its contacts, and force closure, whether these can hold an object."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from pipeline.kernels.arrays import Array, Mask
from pipeline.kernels.geometry.transforms import length, solve_3x3
from pipeline.kernels.hand.load_residual import contact_wrenches
from pipeline.kernels.touch.depth_maps import gel_surface, pressed_pixels
from pipeline.kernels.touch.sensor import Sensor, masked_points

TURNS = 2 * np.pi * np.arange(8) / 8
OCTAGON = np.stack([np.cos(TURNS), np.sin(TURNS)], axis=1)  # edges of a friction pyramid
MARGIN_DECIMALS = 3  # of a margin: further ones are the linear program's rounding


@dataclass(frozen=True, eq=False)
class Contact:
    """A gel on an object."""

    point: Array  # (3,) middle of the contact, world, m
    normal: Array  # (3,) unit normal of the object's surface there, into the object
    area: float  # m², of the sensor plane over which the surface presses into the gel
    volume: float = 0.0  # m³, that the surface displaces
    nearest: float = 0.0  # m, least distance of the surface from the sensor plane
    force: float = 0.0  # N, of an elastic gel along its normal
    stiffness: float = 0.0  # N/m, by which that grows if the gel is pressed in further


def contact_from_depth(depth: np.ndarray, pose: Array, sensor: Sensor) -> Contact | None:
    """Find the contact with an object of a sensor at a pose (4, 4), of depth D (rows, cols), m; None where nothing presses in.

    The normal is that of the plane through the points in the gel (least squares); of fewer than three points, the sensor's.
    """
    mask = pressed_pixels(depth, sensor)
    points = masked_points(depth, mask, sensor)
    if not len(points):
        return None
    middle = points.mean(axis=0)
    away = points - middle
    across = np.einsum("ni,nj->ij", away[:, :2], away[:, :2])
    slope = np.zeros(2)
    if across[0, 0] * across[1, 1] - across[0, 1] ** 2 > 1e-12 * across.trace() ** 2:
        normal_matrix = np.eye(3)
        normal_matrix[:2, :2] = across
        slope = solve_3x3(normal_matrix, np.array([*(away[:, :2] * away[:, 2:]).sum(axis=0), 0.0]))[:2]
    normal = np.array([-slope[0], -slope[1], 1.0])
    turn = pose[:3, :3]
    pixel = sensor.pitch[0] * sensor.pitch[1]
    volume = float((np.broadcast_to(gel_surface(sensor), depth.shape)[mask] - points[:, 2]).sum()) * pixel
    return Contact(
        point=(turn * middle).sum(axis=1) + pose[:3, 3],
        normal=(turn * normal).sum(axis=1) / length(normal),
        area=len(points) * pixel,
        volume=volume,
        nearest=float(points[:, 2].min()),
    )


def closure_margin(
    contacts: list[Contact],
    *,
    friction: float,  # coefficient between gel and object
    size: float,  # m, of the object: moments are divided by it
) -> float:  # 0 to 1
    """Compute the margin of force closure: how evenly contacts can press while their forces and moments cancel.

    Contacts are soft fingers with Coulomb friction. The margin is the share of an even distribution that every edge of every friction cone
    carries at least, 0 without force closure. Of m edges with wrenches w, of normal force 1 each, it is the greatest t with Σ λ w = 0,
    Σ λ = 1, λ ≥ t / m. Positive t and wrenches that span all six dimensions are force closure (Murray, Li, Sastry, 1994, 5.2). The moment
    about a normal is 2/3 μ times the radius of a disc of the contact's area, as of a constant pressure.
    """
    if len(contacts) < 2 or friction <= 0:
        return 0.0
    points, normals = (np.array(vectors) for vectors in zip(*((contact.point, contact.normal) for contact in contacts), strict=True))
    radii = np.sqrt(np.array([contact.area for contact in contacts]) / np.pi)
    wrenches = contact_wrenches(points - points[0], normals, radii, OCTAGON, friction, size)  # (m, 6)
    spread = np.linalg.svd(wrenches, compute_uv=False)
    if spread[-1] < 1e-6 * spread[0]:
        return 0.0
    count = len(wrenches)
    balance = np.concatenate([wrenches.T, wrenches.sum(axis=0)[:, None] / count], axis=1)  # λ = t / m + what is more
    total = np.ones((1, count + 1))
    goal = np.zeros(count + 1)
    goal[-1] = -1
    solution = scipy.optimize.linprog(goal, A_eq=np.concatenate([balance, total]), b_eq=np.array([0.0] * 6 + [1.0]))
    return round(float(np.clip(solution.x[-1], 0, 1)), MARGIN_DECIMALS) if solution.success else 0.0


@dataclass(frozen=True, eq=False)
class Grasp:
    """A grasp of a hand with J joints and S sensors; angles are rad, or m of a joint that slides."""

    hand_pose: Array  # (4, 4) root link to world, m
    pregrasp_angles: Array  # (J,) from which the fingers close
    joint_angles: Array  # (J,) at which they rest
    squeeze_angles: Array  # (J,) to which the motors drive in order to hold
    sensor_pose: Array  # (S, 4, 4) sensor to world, m
    contacts: Sequence[Contact | None]  # (S,) None for a sensor that does not touch

    @property
    def touched(self) -> Mask:  # (S,)
        """Tell which sensors touch."""
        return np.array([contact is not None for contact in self.contacts])

    @property
    def contact_area(self) -> Array:  # (S,) m²
        """List the areas of the contacts; 0 for a sensor that does not touch."""
        return np.array([contact.area if contact else 0.0 for contact in self.contacts])

    @property
    def opposition(self) -> float:
        """Compute the greatest angle between two contacts' normals, degrees: 180 where two oppose each other, 0 for less than two."""
        normals = np.array([contact.normal for contact in self.contacts if contact]).reshape(-1, 3)
        cosines = np.clip(np.einsum("ai,bi->ab", normals, normals), -1, 1)
        return float(np.rad2deg(np.arccos(cosines.min()))) if len(normals) > 1 else 0.0
