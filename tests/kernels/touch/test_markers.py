"""Printed dots: their grid, how they are carried, how they are drawn."""

import numpy as np
import pytest

from pipeline.formats.sensor_file import load_sensor
from pipeline.kernels.touch.markers import MarkerGrid, dot_displacement, draw_dots
from pipeline.kernels.touch.sensor import Sensor

PITCH = (1e-4, 2e-4)
"""m along y and x."""


def test_grid_is_spread_evenly_row_by_row():
    positions = MarkerGrid(rows=2, cols=3, radius=1e-4).positions(0.012, 0.008)
    expected = [(x, y) for y in (-0.002, 0.002) for x in (-0.004, 0.0, 0.004)]
    np.testing.assert_allclose(positions, expected, atol=1e-15)


def test_dots_move_as_the_surface_between_pixels_and_at_the_rim_as_the_outermost():
    y, x = (np.arange(10) - 4.5) * PITCH[0], (np.arange(8) - 3.5) * PITCH[1]
    displacement = np.stack([0.1 * x[None] + 0.3 * y[:, None], -0.2 * x[None] + 0 * y[:, None]], axis=-1)
    inner = np.array([(1.3e-4, -2.1e-4), (-6.9e-4, 4.4e-4)])
    expected = np.stack([0.1 * inner[:, 0] + 0.3 * inner[:, 1], -0.2 * inner[:, 0]], axis=-1)
    np.testing.assert_allclose(dot_displacement(inner, displacement, PITCH), expected, atol=1e-12)
    np.testing.assert_array_equal(dot_displacement(np.array([(1.0, 1.0)]), displacement, PITCH), displacement[-1:, -1])


def drawn(displacement: np.ndarray, radius: float, positions: list[tuple[float, float]]) -> np.ndarray:
    """Share of each pixel that dots cover."""
    image = np.full((*displacement.shape[:2], 3), 200, np.uint8)
    draw_dots(image, displacement, (1e-4, 1e-4), np.array(positions), radius, (0, 100, 200))
    assert (image[..., 2] == 200).all()
    assert (abs(image[..., 1] - (200 - (200.0 - image[..., 0]) / 2)) <= 1).all()  # half as far from 200 as from red's
    return (200.0 - image[..., 0]) / 200


def test_dot_covers_its_area_where_it_is_carried_and_is_stretched():
    rest = drawn(np.zeros((60, 80, 2)), 8e-4, [(1e-3, -5e-4)])
    assert rest.sum() == pytest.approx(np.pi * 8**2, rel=0.01)
    row, col = np.average(np.argwhere(rest), axis=0, weights=rest[rest > 0])
    assert (col, row) == pytest.approx((39.5 + 10, 29.5 - 5), abs=0.02)
    moved = np.zeros((60, 80, 2))
    moved[..., 0] = 6e-4 + 0.3 * (np.arange(80) - 39.5) * 1e-4  # by 0.9 mm in the dot's middle, and 1.3 times as wide
    stretched = drawn(moved, 8e-4, [(1e-3, -5e-4)])
    assert stretched.sum() == pytest.approx(1.3 * rest.sum(), rel=0.01)
    assert np.average(np.argwhere(stretched)[:, 1], weights=stretched[stretched > 0]) == pytest.approx(39.5 + 10 + 6 + 3, abs=0.02)


def test_dots_at_the_rim_and_beyond_it_are_cut_off():
    assert drawn(np.zeros((20, 20, 2)), 4e-4, [(1e-3, 0.0)]).sum() == pytest.approx(np.pi * 4**2 / 2, rel=0.02)
    assert not drawn(np.full((20, 20, 2), 5e-3), 4e-4, [(0.0, 0.0)]).any()


def test_sensor_has_markers_that_do_not_overlap_and_a_gel_that_carries_them():
    described = load_sensor("gelsight_mini").model_dump(mode="json", exclude_none=True)
    assert "markers" not in described
    assert "friction" not in described["gel"]  # as before there were any
    markers = {"rows": 7, "cols": 9, "radius": 3e-4}
    worn = Sensor.model_validate(described | {"markers": markers, "gel": described["gel"] | {"friction": 0.6}})
    assert worn.markers == MarkerGrid(**markers, colour=(0, 0, 0))
    assert worn.gel.friction == 0.6
    for wrong, message in (
        ({"markers": markers | {"radius": 2e-3}}, r"markers of radius 0\.002 m do not fit: each has 0\.00217 m"),
        ({"markers": {"rows": 1, "cols": 1, "radius": 0.02}}, r"markers of radius 0\.02 m do not fit"),
        ({"markers": markers, "gel": None}, "markers move with an elastic gel, and there is none"),
        ({"markers": markers | {"colour": [0, 0, 256]}}, "colour"),
        ({"markers": markers | {"rows": 0}}, "rows"),
        ({"gel": described["gel"] | {"friction": -0.1}}, "friction"),
    ):
        with pytest.raises(ValueError, match=message):
            Sensor.model_validate(described | wrong)
