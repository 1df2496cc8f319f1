"""Dots that are printed on a gel: found in its untouched photograph, filled in where a press has carried them, or refused."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from pipeline.errors import InvalidInput
from pipeline.kernels.touch.marker_removal import MarkerRemoval
from pipeline.kernels.touch.markers import MarkerGrid, draw_dots

ROWS, COLS, PITCH = 120, 160, (1e-4, 1e-4)
Y, X = np.mgrid[:ROWS, :COLS]
GEL = np.stack([110 + 0.3 * X, 140 - 0.4 * Y, 90 + 0.2 * (X + Y)], axis=-1)


def photograph(image: np.ndarray, colour: tuple[int, int, int] | None, shift: np.ndarray | None = None) -> np.ndarray:
    """Print 6 × 8 dots of 4 pixels radius, blurred by the lens; without a colour, none."""
    printed = np.rint(image).astype(np.uint8)
    if colour:
        markers = MarkerGrid(rows=6, cols=8, radius=4e-4, colour=colour)
        shift = np.zeros((ROWS, COLS, 2)) if shift is None else shift
        draw_dots(printed, shift, PITCH, markers.positions(1e-4 * COLS, 1e-4 * ROWS), markers.radius, colour)
    return np.rint(gaussian_filter(printed.astype(float), (0.7, 0.7, 0))).astype(np.uint8)


@pytest.mark.parametrize("colour", [(10, 10, 12), (250, 250, 250), (220, 200, 20)])
def test_dots_of_any_colour_are_filled_in_under_a_press(colour: tuple[int, int, int]) -> None:
    towards = np.stack([X - 80.0, Y - 60.0], axis=-1)
    bell = np.exp(-np.square(towards).sum(axis=-1) / 2 / 20**2)
    pressed = GEL + 2.5 * (towards @ np.array([[1.0, 0, -0.5], [0, 1.0, -0.5]])) * bell[..., None]
    removal = MarkerRemoval(photograph(GEL, colour))
    assert removal.count == 48
    filled = removal.fill(photograph(pressed, colour, 1e-5 * towards * bell[..., None]))
    error = np.abs(filled - photograph(pressed, None).astype(float))
    assert error.mean() < 1
    assert error.max() < 60  # beside 130 of a dot
    assert np.abs(removal.fill(photograph(GEL, colour)) - GEL).max() < 5


def test_photographs_of_a_gel_without_dots_stay_as_they_are() -> None:
    rng = np.random.default_rng(0)
    dusty = np.clip(GEL + rng.normal(0, 3, GEL.shape), 0, 255).astype(np.uint8)
    for row, col in rng.integers(5, 110, (30, 2)):
        dusty[row : row + 2, col : col + 2] = 20
    removal = MarkerRemoval(dusty)
    assert removal.count == 0
    assert removal.fill(dusty) is dusty


def test_photograph_without_the_dots_is_refused_by_their_number() -> None:
    removal = MarkerRemoval(photograph(GEL, (10, 10, 12)))
    with pytest.raises(InvalidInput, match="it shows 0 of the 48 dots that are printed on the untouched gel, 50 % are needed"):
        removal.fill(photograph(GEL, None))
