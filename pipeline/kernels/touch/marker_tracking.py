"""Follow the dots that are printed on a gel from photograph to photograph, to a fraction of a pixel.

Valid range: that of `marker_removal`, and dots that move by less than half their distance, beside their neighbours, from one photograph to
the next.
"""

import warnings

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from pipeline.errors import InvalidInput
from pipeline.kernels.arrays import Array
from pipeline.kernels.touch.marker_removal import LEAST_DOTS, MarkerRemoval

NEIGHBOURS = 8  # dots whose motion, with its own, tells where to look for the one in their midst
ROUNDS = 3  # of that search
REACH = 0.45  # of the distance between dots: how far from there a dot may be


class MarkerTracker:
    """Follows the dots of one gel."""

    def __init__(self, untouched: NDArray[np.uint8]) -> None:  # (rows, cols, 3)
        self._dots = MarkerRemoval(untouched)
        self.positions = self._dots.middles(untouched) if self._dots.count else np.zeros((0, 2))  # (M, 2) x and y in pixels, at rest
        if len(self.positions) <= NEIGHBOURS:
            shown = f"{len(self.positions) or 'no'} whole printed dots"
            raise InvalidInput(f"the untouched photograph shows {shown}; shear needs {LEAST_DOTS} or more, of one colour and size")
        distance, self._neighbours = KDTree(self.positions).query(self.positions, range(1, NEIGHBOURS + 2))
        self._reach = REACH * float(np.median(distance[:, 1]))
        self._moved = np.zeros_like(self.positions)

    def follow(self, photograph: NDArray[np.uint8]) -> Array:  # (M, 2) pixels along x and y
        """Measure how far the dots are from their rest in the next photograph; NaN for dots that are lost."""
        middles = self._dots.middles(photograph)
        expected = self._moved
        for _ in range(ROUNDS):
            moved = self._match(middles, expected)
            with warnings.catch_warnings(category=RuntimeWarning, action="ignore"):  # where all neighbours are lost, it is as it was
                around = np.nanmedian(moved[self._neighbours], axis=1)
            expected = np.where(np.isnan(around), expected, around)
        lost = np.isnan(moved[:, 0])
        self._moved = np.where(lost[:, None], expected, moved)
        return moved

    def _match(self, middles: Array, expected: Array) -> Array:  # (M, 2)
        """Take the spot nearest to where each dot is expected, if that dot is also the nearest to it."""
        places = self.positions + expected
        distance, spot = KDTree(middles).query(places, distance_upper_bound=self._reach)
        nearest = np.append(KDTree(places).query(middles)[1], -1)
        found = np.isfinite(distance) & (nearest[spot] == np.arange(len(places)))
        return np.where(found[:, None], np.append(middles, [[0, 0]], axis=0)[spot] - self.positions, np.nan)
