"""Printed dots are followed to 0.05 pixels through known motions; dots that are lost are said."""

import numpy as np
import pytest

from pipeline.errors import InvalidInput
from pipeline.kernels.touch.marker_tracking import MarkerTracker
from tests.kernels.touch.test_marker_removal import COLS, GEL, PITCH, ROWS, X, Y, photograph

COLOUR = (10, 10, 12)
CENTRED = np.stack([X + 0.5 - COLS / 2, Y + 0.5 - ROWS / 2], axis=-1)  # pixels from the middle


def affine(matrix: list[list[float]], shift: tuple[float, float] = (0, 0)) -> np.ndarray:  # (ROWS, COLS, 2) pixels
    return CENTRED @ np.transpose(matrix) + shift


def followed(*motions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:  # (M, 2) measured and true, pixels
    tracker = MarkerTracker(photograph(GEL, COLOUR))
    for motion in motions:
        moved = tracker.follow(photograph(GEL, COLOUR, PITCH[0] * motion))
    corner, across, down = motions[-1][0, 0], motions[-1][0, 1] - motions[-1][0, 0], motions[-1][1, 0] - motions[-1][0, 0]
    return moved, corner + tracker.positions @ np.stack([across, down])


@pytest.mark.parametrize(
    "motion",
    [
        affine([[0, 0], [0, 0]], (0.37, -0.62)),
        affine([[0, 0], [0, 0]], (5.3, -4.1)),  # of dots 20 pixels apart
        affine([[0, -0.08], [0.08, 0]]),
        affine([[0, 0.1], [0, 0]]),
        affine([[0.06, 0], [0, -0.04]]),
    ],
    ids=["shift of parts of a pixel", "shift", "turn", "shear", "stretch"],
)
def test_known_motions_are_measured_to_a_twentieth_of_a_pixel(motion: np.ndarray) -> None:
    moved, true = followed(motion)
    assert len(moved) == 48
    seen = np.isfinite(moved[:, 0])
    assert seen.sum() >= 42  # the rim cuts a row or a column at most
    np.testing.assert_allclose(moved[seen], true[seen], rtol=0, atol=0.05)


def test_dots_are_followed_step_by_step_farther_than_they_lie_apart() -> None:
    moved, true = followed(*(affine([[0, 0], [0, 0]], (step, 0)) for step in np.linspace(0, 24, 9)))
    stay = np.isfinite(moved[:, 0])
    np.testing.assert_allclose(moved[stay], true[stay], rtol=0, atol=0.1)
    assert 0 < (~stay).sum() <= 12  # the columns that the rim has swallowed


def test_a_dot_that_is_covered_is_lost_and_found_again() -> None:
    tracker = MarkerTracker(photograph(GEL, COLOUR))
    moved = photograph(GEL, COLOUR, PITCH[0] * affine([[0, 0], [0, 0]], (2, 0)))
    covered, dot = moved.copy(), 20
    col, row = tracker.positions[dot].round().astype(int)
    covered[row - 8 : row + 9, col - 6 : col + 11] = GEL[row - 8 : row + 9, col - 6 : col + 11]
    lost = np.isnan(tracker.follow(covered)[:, 0])
    assert np.flatnonzero(lost).tolist() == [dot]
    np.testing.assert_allclose(tracker.follow(moved)[dot], (2, 0), rtol=0, atol=0.05)


def test_a_gel_without_dots_is_refused() -> None:
    with pytest.raises(InvalidInput, match="shows no whole printed dots; shear needs 12 or more, of one colour and size"):
        MarkerTracker(photograph(GEL, None))


def test_a_gel_whose_dots_the_rim_cuts_is_refused() -> None:
    """Of four rows and four columns, it cuts the outer ones."""
    image, (y, x) = np.full((120, 160, 3), 120, np.uint8), np.indices((120, 160))
    for row in np.linspace(0, 119, 4):
        for col in np.linspace(0, 159, 4):
            image[np.hypot(y - row, x - col) < 5] = COLOUR
    with pytest.raises(InvalidInput, match="shows 4 whole printed dots; shear needs 12 or more"):
        MarkerTracker(image)


def test_dots_that_all_vanish_are_lost_and_found_where_they_were() -> None:
    tracker = MarkerTracker(photograph(GEL, COLOUR))
    moved = photograph(GEL, COLOUR, PITCH[0] * affine([[0, 0], [0, 0]], (2, 0)))
    tracker.follow(moved)
    assert np.isnan(tracker.follow(photograph(GEL, None))).all()
    np.testing.assert_allclose(np.nanmedian(tracker.follow(moved), axis=0), (2, 0), rtol=0, atol=0.05)
