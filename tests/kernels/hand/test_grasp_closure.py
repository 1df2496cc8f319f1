"""Contacts and force closure against closed forms."""

import numpy as np
import pytest

from pipeline.formats.sensor_file import load_sensor
from pipeline.kernels.hand.grasp import Contact, Grasp, closure_margin, contact_from_depth
from pipeline.kernels.touch.depth_maps import CONTACT_MARGIN
from pipeline.kernels.touch.sensor import pixel_centres

SENSOR = load_sensor("gel_16mm")


def facing(direction: list[float], distance: float) -> np.ndarray:
    """Compute the pose of a sensor at a distance from the origin, which it faces along `direction`."""
    z = np.array(direction) / np.linalg.norm(direction)
    x = np.cross(np.eye(3)[np.argmin(np.abs(z))], z)
    pose = np.eye(4)
    pose[:3, :3] = np.column_stack([x / np.linalg.norm(x), np.cross(z, x / np.linalg.norm(x)), z])
    pose[:3, 3] = -distance * z
    return pose


def sphere_depth(radius: float, distance: float) -> np.ndarray:
    """D of a sphere around the origin, of a sensor that faces it from a distance."""
    x, y = pixel_centres(SENSOR)
    height = radius**2 - x**2 - y[:, None] ** 2
    return np.where(height > 0, distance - np.sqrt(np.maximum(height, 0)), np.inf)


def grasp_of(contacts: list[Contact | None]) -> Grasp:
    """Make a grasp with these contacts of a hand without joints."""
    return Grasp(np.eye(4), *np.zeros((3, 0)), np.tile(np.eye(4), (len(contacts), 1, 1)), contacts)


@pytest.mark.parametrize("pressed", [0.5e-3, 1e-3])
def test_two_sensors_on_opposite_sides_of_a_sphere(pressed: float) -> None:
    """The gel is cut by a sphere in a disc; the two normals are opposite, and friction holds it with all edges alike."""
    radius = 0.03
    distance = radius + SENSOR.w - CONTACT_MARGIN - pressed
    contacts = [contact_from_depth(sphere_depth(radius, distance), facing([s, 0, 0], distance), SENSOR) for s in (1.0, -1.0)]
    left, right = (contact for contact in contacts if contact)
    disc = np.pi * (2 * radius * pressed - pressed**2)
    assert left.area == pytest.approx(disc, rel=0.02)
    deep = pressed + CONTACT_MARGIN
    assert left.volume == pytest.approx(np.pi * deep**2 * (radius - deep / 3), rel=0.03)  # of the cap
    assert left.nearest == pytest.approx(SENSOR.w - deep, abs=1e-5)
    np.testing.assert_allclose(left.normal, [1, 0, 0], atol=1e-9)
    assert grasp_of([left, right]).opposition == pytest.approx(180)
    assert closure_margin([left, right], friction=0.5, size=radius) == 1


def test_normal_is_that_of_a_tilted_plane(rng: np.random.Generator) -> None:
    x, y = pixel_centres(SENSOR)
    a, b = 0.2, -0.1
    contact = contact_from_depth(0.004 + a * x + b * y[:, None], facing([1, 2, 3], 0.1), SENSOR)
    assert contact is not None
    expected = facing([1, 2, 3], 0.1)[:3, :3] @ [-a, -b, 1] / np.sqrt(a**2 + b**2 + 1)
    np.testing.assert_allclose(contact.normal, expected, atol=1e-9)


@pytest.mark.parametrize("friction", [0.3, 0.8])
def test_two_contacts_close_where_the_line_between_them_is_in_both_friction_cones(friction: float) -> None:
    """Normals tilted against the line by an angle, both to one side as on a wedge: Nguyen's theorem (1988)."""
    limit = np.arctan(friction)
    for tilt in (0.9 * limit, 1.1 * limit):
        contacts = [Contact(np.array([s * 0.03, 0, 0]), np.array([-s * np.cos(tilt), np.sin(tilt), 0]), 1e-4) for s in (1.0, -1.0)]
        assert (closure_margin(contacts, friction=friction, size=0.05) > 0) == (tilt < limit)


def test_contact_from_depth_is_none_without_touch() -> None:
    assert contact_from_depth(np.full(SENSOR.shape, np.inf), np.eye(4), SENSOR) is None
    assert contact_from_depth(np.full(SENSOR.shape, SENSOR.w), np.eye(4), SENSOR) is None
    assert grasp_of([None]).opposition == closure_margin([], friction=1.0, size=1.0) == 0
