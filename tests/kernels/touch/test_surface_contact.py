"""Contacts found in the surface of a gel: under Hertz's ball, where the gel around is drawn in otherwise, and beside drift."""

import numpy as np
import pytest

from pipeline.kernels.touch.surface_contact import contact_margin

PITCH = (1.2e-4, 1.5e-4)
Y, X = (PITCH[0] * (np.arange(120) - 60.2))[:, None], (PITCH[1] * (np.arange(110) - 54.6))[None]
DISTANCE = np.hypot(Y, X)


def overlap(one: np.ndarray, other: np.ndarray) -> float:
    return float((one & other).sum() / (one | other).sum())


def drawn_in(reach: float, tail: float, ball: float = 2.35e-3) -> np.ndarray:
    """Press a ball into a gel that falls off exponentially around its contact."""
    rise = np.sqrt(ball**2 - reach**2)
    rim = tail * reach / rise
    cap = np.sqrt(np.maximum(ball**2 - DISTANCE**2, 0)) - rise + rim
    return np.where(reach > DISTANCE, cap, rim * np.exp(-np.maximum(DISTANCE - reach, 0) / tail))


@pytest.mark.parametrize("reach", [1e-3, 2e-3])
def test_contact_under_a_ball_on_a_half_space_is_that_of_hertz(reach: float) -> None:
    share = np.maximum(DISTANCE / reach, 1)
    outside = (2 - share**2) * np.arcsin(1 / share) + np.sqrt(share**2 - 1)  # Johnson, Contact Mechanics, 1985, equation 3.42
    surface = reach**2 / 0.005 * np.where(reach > DISTANCE, 1 - (DISTANCE / reach) ** 2 / 2, outside / np.pi)
    assert overlap(contact_margin(surface, PITCH, 0.05) > 0, reach > DISTANCE) > 0.85


@pytest.mark.parametrize("reach", [0.8, 0.95])
@pytest.mark.parametrize("tail", [2.5e-4, 6e-4])
@pytest.mark.parametrize("thickness", [1.5e-3, 4e-3])
def test_gel_drawn_in_around_a_deep_press_is_no_contact_whatever_the_layer(reach: float, tail: float, thickness: float) -> None:
    contact = reach * 2.35e-3
    found = contact_margin(drawn_in(contact, tail), PITCH, thickness) > 0
    assert overlap(found, contact > DISTANCE) > 0.8
    assert np.sqrt(found.sum() * PITCH[0] * PITCH[1] / np.pi) == pytest.approx(contact, rel=0.1)


def test_drift_is_no_contact_beside_a_press_nor_alone() -> None:
    drift = 4e-5 * np.cos(X / 1.1e-3) * np.cos(Y / 9e-4)
    assert not (contact_margin(drift, PITCH, 2e-3) > 0).any()
    assert not (contact_margin(drawn_in(2e-3, 4e-4) + drift, PITCH, 2e-3) > 0)[DISTANCE > 3e-3].any()


def test_two_presses_are_two_contacts() -> None:
    surface = np.maximum(np.roll(drawn_in(1e-3, 3e-4), -30, axis=1), 0.6 * np.roll(drawn_in(1e-3, 3e-4), 30, axis=1))
    found = contact_margin(surface, PITCH, 2e-3) > 0
    assert found[60, 25]
    assert found[60, 85]
    assert not found[60, 55]
