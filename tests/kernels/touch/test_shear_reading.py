"""Shear, force and torque from the motion of dots: closed forms, the simulation's own dots, and what cannot be told."""

import math

import numpy as np
import pytest

from pipeline.errors import InvalidInput
from pipeline.formats.sensor_file import load_sensor
from pipeline.kernels.touch.depth_maps import press_gel
from pipeline.kernels.touch.elastic_contact import PressedGel
from pipeline.kernels.touch.friction import FrictionState, drag_gel, gel_at_rest, surface_displacement, surface_traction
from pipeline.kernels.touch.markers import MarkerGrid, dot_displacement
from pipeline.kernels.touch.sensor import Gel, pixel_centres
from pipeline.kernels.touch.shear_reading import SLIDING, DotReader, read_shear, sliding

GEL = Gel(modulus=2e5, poisson=0.48, thickness=0.003)
SENSOR = load_sensor("gelsight", shape=(60, 80)).model_copy(update={"gel": GEL, "w": 0.004, "membrane": 0.0})
DOTS = MarkerGrid(rows=7, cols=9, radius=3e-4).positions(SENSOR.width, SENSOR.height)
SHEAR_MODULUS = GEL.modulus / 2 / (1 + GEL.poisson)


def ball(deep: float, at: tuple[float, float] = (0.001, -0.0005)) -> PressedGel:
    x, y = pixel_centres(SENSOR)
    squared = (x[None] - at[0]) ** 2 + (y[:, None] - at[1]) ** 2
    return press_gel(SENSOR.w - deep + squared / (2 * 0.006), SENSOR)


def dragged(pressed: PressedGel, motion: np.ndarray, friction: float, steps: int = 6) -> FrictionState:  # (3, rows, cols) m in all
    state = drag_gel(pressed, np.zeros_like(motion), gel_at_rest(SENSOR), SENSOR, friction)
    for _ in range(steps):
        state = drag_gel(pressed, motion / steps, state, SENSOR, friction)
    return state


def pushed(x: float, y: float) -> np.ndarray:
    return np.broadcast_to(np.array([x, y, 0.0])[:, None, None], (3, *SENSOR.shape)).copy()


def turned(angle: float, at: tuple[float, float]) -> np.ndarray:
    x, y = pixel_centres(SENSOR)
    x, y = np.broadcast_arrays(x[None] - at[0], y[:, None] - at[1])
    return np.stack([-angle * y, angle * x, 0 * x])


@pytest.mark.parametrize(
    "motion", [pushed(2e-4, -1e-4), pushed(2e-3, 1e-3), turned(0.2, (0.001, -0.0005))], ids=["sticks", "slides", "twists"]
)
def test_traction_that_moved_the_dots_is_found_again(motion: np.ndarray) -> None:
    pressed = ball(6e-4)
    state = dragged(pressed, motion, 0.7)
    displacement, traction = surface_displacement(state, SENSOR), surface_traction(state, pressed, SENSOR)
    area = np.prod(SENSOR.pitch)
    x, y = pixel_centres(SENSOR)
    moments = x[None] * traction[..., 1] - y[:, None] * traction[..., 0]
    read = read_shear(np.asarray(pressed.pressure), DOTS, dot_displacement(DOTS, displacement, SENSOR.pitch), SENSOR)
    assert read.explained
    scale = np.hypot(*np.moveaxis(traction, -1, 0)).sum() * area  # N
    np.testing.assert_allclose(read.force[:2], traction.sum(axis=(0, 1)) * area, rtol=0, atol=0.05 * scale)
    assert read.torque == pytest.approx(moments.sum() * area, rel=0.08, abs=3e-5 * scale)
    assert np.sqrt(np.mean((read.displacement - displacement) ** 2)) < 0.2 * np.sqrt(np.mean(displacement**2))
    assert read.force[2] == pytest.approx(-pressed.pressure.sum() * area)


def test_the_whole_gel_sheared_evenly_needs_a_traction_of_modulus_times_shear() -> None:
    """In the middle of a wide even contact, a layer is in pure shear; no image shows that something flat presses."""
    even = np.tile([1e-4, 0.0], (len(DOTS), 1))
    read = read_shear(np.zeros(SENSOR.shape), DOTS, even, SENSOR)
    assert not read.explained
    assert math.isnan(read.friction)
    assert read.force[2] == 0
    np.testing.assert_allclose(read.traction[30, 40], [SHEAR_MODULUS * 1e-4 / GEL.thickness, 0], rtol=0.1, atol=200)


def test_sliding_friction_is_read_and_the_photographs_that_slide() -> None:
    pressed = ball(6e-4)
    readings = []
    for reach in (1e-5, 5e-5, 1e-4, 2e-3):
        displacement = surface_displacement(dragged(pressed, pushed(reach, 0), 0.7), SENSOR)
        readings.append(read_shear(np.asarray(pressed.pressure), DOTS, dot_displacement(DOTS, displacement, SENSOR.pitch), SENSOR))
    needed = np.array([read.friction for read in readings])
    friction, slides = sliding(np.array([-read.force[2] for read in readings]), needed)
    assert friction == pytest.approx(0.7, rel=0.05)
    assert (needed[:3] < SLIDING * friction).all()
    assert slides.tolist() == [False, False, False, True]


def test_friction_is_not_taken_from_gentle_touches_nor_from_unknown_ones() -> None:
    friction, slides = sliding(np.array([0.1, 1.0, 1.0, 1.0]), np.array([3.0, 0.5, 0.2, np.nan]))
    assert friction == 0.5
    assert slides.tolist() == [True, True, False, False]
    assert math.isnan(sliding(np.zeros(2), np.full(2, np.nan))[0])


def test_an_untouched_gel_is_not_sheared_and_a_lost_dot_does_not_count() -> None:
    still = read_shear(np.zeros(SENSOR.shape), DOTS, np.full(DOTS.shape, 1e-6), SENSOR)
    assert not still.displacement.any()
    assert not still.force.any()
    pressed = ball(6e-4)
    moved = dot_displacement(DOTS, surface_displacement(dragged(pressed, pushed(1e-4, 0), 0.7), SENSOR), SENSOR.pitch)
    whole = read_shear(np.asarray(pressed.pressure), DOTS, moved, SENSOR)
    moved[5] = np.nan  # in a corner
    np.testing.assert_allclose(read_shear(np.asarray(pressed.pressure), DOTS, moved, SENSOR).force, whole.force, rtol=0.02, atol=1e-3)


def test_a_point_of_contact_is_read_too() -> None:
    pressure = np.zeros(SENSOR.shape)
    pressure[30, 40] = 1e5
    assert np.isfinite(read_shear(pressure, DOTS, np.full(DOTS.shape, 1e-5), SENSOR).force).all()


def test_a_sensor_without_an_elastic_gel_and_a_gel_without_dots_are_refused() -> None:
    plain = np.full((*SENSOR.shape, 3), 120, np.uint8)
    with pytest.raises(InvalidInput, match=r"gelsight has no elastic gel.*add `gel: \{modulus"):
        DotReader(plain, SENSOR.model_copy(update={"gel": None}))
    with pytest.raises(InvalidInput, match="shows no whole printed dots"):
        DotReader(plain, SENSOR)


def test_too_few_dots_are_refused() -> None:
    moved = np.full(DOTS.shape, np.nan)
    moved[:5] = 0
    with pytest.raises(InvalidInput, match="5 of 63 dots are seen, 6 are needed"):
        read_shear(np.zeros(SENSOR.shape), DOTS, moved, SENSOR)
