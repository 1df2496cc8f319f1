"""Displacements in the plane of a layer's surface: waves against differential equations, cells against waves and point loads."""

import numpy as np
import pytest

from pipeline.kernels.touch.shear_layer import MIRRORED, shear_displacement, shear_influence, shear_stiffness, wave_factors
from tests.references.slow_friction import slow_wave_factors


@pytest.mark.parametrize("poisson", [0.0, 0.3, 0.48, 0.499])
@pytest.mark.parametrize("wave", [0.05, 0.5, 1.0, 3.0, 6.0])
def test_waves_equal_those_of_differential_equations(wave, poisson):
    along, across, pressed = wave_factors(np.array(wave), poisson)
    slow_along, slow_pressed = slow_wave_factors(wave, poisson)
    assert along == pytest.approx(slow_along, rel=1e-9)
    assert pressed == pytest.approx(slow_pressed, rel=1e-7, abs=1e-9)
    assert across == pytest.approx(np.tanh(wave) / (1 - poisson), rel=1e-12)


def test_short_waves_see_a_half_space_and_rubber_is_pressed_outwards():
    along, across, pressed = wave_factors(np.array(30.0), 0.3)
    assert (along, across, pressed) == pytest.approx((1, 1 / 0.7, 0.4 / 1.4), abs=1e-12)
    assert wave_factors(np.array(1.0), 0.5)[2] < 0


@pytest.mark.parametrize(("poisson", "thickness"), [(0.0, 0.002), (0.3, 0.002), (0.5, 0.001)])
def test_cells_under_a_wave_move_as_the_wave_says(poisson, thickness):
    """Sum over a grid so wide that what lies beyond does not count; a wave of 40 cells."""
    pitch, reach, period = 1e-4, 160, 40
    quarters = shear_influence((reach, reach), (pitch, pitch), poisson, thickness)
    offset = np.arange(1 - reach, reach)
    full = [
        np.where(offset < 0, along_y, 1)[:, None] * np.where(offset < 0, along_x, 1) * quarter[np.ix_(abs(offset), abs(offset))]
        for quarter, (along_y, along_x) in zip(quarters, MIRRORED, strict=True)
    ]
    wave = 2 * np.pi / (period * pitch)
    even, odd = np.cos(wave * pitch * offset), np.sin(wave * pitch * offset)
    along, across, pressed = wave_factors(np.array(wave * thickness), poisson) * 2 / wave
    for axis, (straight, sideways, pull) in enumerate([(0, 1, 3), (1, 0, 4)]):  # waves along x, then along y
        sums = [full[part].sum(axis=axis) for part in (straight, sideways, pull)]
        assert sums[0] @ even == pytest.approx(along, rel=0.01)
        assert sums[1] @ even == pytest.approx(across, rel=0.01)
        assert sums[2] @ odd == pytest.approx(-pressed, rel=0.05)


def test_far_cells_of_a_half_space_move_as_by_a_point_force():
    """Cerruti's and Boussinesq's displacements at (x, y) = (0.9, 1.2) mm, for a force on a cell of 0.02 x 0.03 mm."""
    pitch, poisson, modulus = (3e-5, 2e-5), 0.3, 0.35
    moved = shear_influence((50, 50), pitch, poisson, 100.0)[:, 40, 45]
    x, y, force = 45 * pitch[1], 40 * pitch[0], pitch[0] * pitch[1]
    r, scale = np.hypot(x, y), force / (2 * np.pi * modulus)
    pull = -(1 - 2 * poisson) / 2 * scale / r**2
    expected = [((1 - poisson) / r + poisson * part / r**3) * scale for part in (x * x, y * y)]
    assert moved == pytest.approx([*expected, poisson * x * y / r**3 * scale, pull * x, pull * y], rel=1e-3)


def test_convolution_sums_the_influences_and_the_stiffness_nearly_undoes_it(rng):
    layer = (2e-4, 1e-4), 0.3, 0.002
    traction, pressure = rng.normal(size=(2, 6, 9)), rng.random((6, 9))
    xx, yy, xy, xp, yp = shear_influence((20, 20), *layer)
    expected = np.zeros((2, 6, 9))
    for (i, j), force in np.ndenumerate(pressure):
        for (row, col), _ in np.ndenumerate(pressure):
            up, left, at = np.sign(row - i + 0.5), np.sign(col - j + 0.5), (abs(row - i), abs(col - j))
            x, y = traction[:, i, j]
            expected[0, row, col] += xx[at] * x + up * left * xy[at] * y + left * xp[at] * force
            expected[1, row, col] += up * left * xy[at] * x + yy[at] * y + up * yp[at] * force
    moved = shear_displacement((6, 9), (20, 20), layer)
    np.testing.assert_allclose(moved(traction, pressure), expected, atol=1e-6 * abs(expected).max())
    bump = np.zeros((2, 40, 40))
    bump[0, 15:25, 15:25] = 1
    back = shear_stiffness((40, 40), layer)(shear_displacement((40, 40), (40, 40), layer)(bump))
    assert abs(back - bump)[:, 16:24, 16:24].max() < 0.2
