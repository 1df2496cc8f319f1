"""How a photograph of a gel differs as a whole from another one of the same gel: exchanged colours, turned, mirrored, exposure.

Valid range: photographs of which a press covers less than half. One that covers all of the gel may hide an alteration.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import permutations, product
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

GRID = 32
"""Cells per side in which photographs are averaged before they are compared: noise and single pixels do not count."""
SAMPLES = 4
"""Pixels per side of a cell that are enough."""
ALIKE = 2.0
"""Levels: photographs that differ by no more are not searched for an alteration."""
EXPLAINED = 0.6
"""An alteration is found if it leaves less than this share of the difference, and no more than `UNLIKE`."""
UNLIKE = 8.0
"""Levels: an untouched gel that differs by more is another one. Another unit of the same sensor differs by 4."""
SIMPLER = 1.0
"""Levels: the likeliest of the alterations counts that leave at most this much more than the least: symmetric gels have several."""
DARK, BRIGHT = 8, 250
"""Levels between which ratios of brightness are measured."""
PRESSED = 8.0
"""Levels by which a cell of a contact differs."""
LUMA = np.array([0.299, 0.587, 0.114])
"""Shares of red, green and blue in a grey level."""

Orientation = Literal[
    "upright", "turned by 180°", "mirrored left to right", "mirrored top to bottom", "turned by 90°", "turned by 270°", "transposed",
    "turned by 180° and transposed",
]  # fmt: skip
ORIENTATIONS: tuple[Orientation, ...] = get_args(Orientation)
_TURNED: dict[Orientation, Callable[[NDArray[np.float64]], NDArray[np.float64]]] = {
    "upright": lambda cells: cells,
    "turned by 180°": lambda cells: cells[::-1, ::-1],
    "mirrored left to right": lambda cells: cells[:, ::-1],
    "mirrored top to bottom": lambda cells: cells[::-1],
    "turned by 90°": lambda cells: np.rot90(cells, -1),  # clockwise
    "turned by 270°": lambda cells: np.rot90(cells),
    "transposed": lambda cells: cells.swapaxes(0, 1),
    "turned by 180° and transposed": lambda cells: cells.swapaxes(0, 1)[::-1, ::-1],
}
COLOURS = ("RGB", "BGR", "grey", *("".join(order) for order in permutations("RGB") if "".join(order) not in ("RGB", "BGR")))
"""Which colours of the reference are a photograph's red, green and blue."""


@dataclass(frozen=True)
class Alteration:
    """How a photograph is made from its reference.

    Attributes
    ----------
    colours, orientation
        One of `COLOURS`, and how the reference is turned.
    gain
        Brightness over the reference's.
    gains
        The same of red, green and blue.
    unscaled, difference, balanced
        Median differences of the cells' colours from those of the altered reference, levels: as it is, as bright as the photograph, and
        with the brightness of each colour.
    """

    colours: str
    orientation: Orientation
    gain: float
    gains: tuple[float, float, float]
    unscaled: float
    difference: float
    balanced: float

    @property
    def is_none(self) -> bool:
        """Check whether the photograph differs from its reference in brightness alone."""
        return (self.colours, self.orientation) == ("RGB", "upright")


def find_alteration(photograph: NDArray[np.uint8], reference: NDArray[np.uint8]) -> Alteration:
    """Find what turns a reference into a photograph: of the same gel, perhaps pressed.

    Parameters
    ----------
    photograph, reference
        (rows, cols, 3) uint8 with any numbers of pixels. Quarter turns are tried if their sides fit.

    Returns
    -------
    The alteration, and what it leaves; none if no alteration explains the difference clearly better.
    """
    cells, reference_cells = cell_means(photograph), cell_means(reference)
    aspects = [image.shape[1] / image.shape[0] for image in (photograph, reference)]
    is_turned = abs(aspects[0] * aspects[1] - 1) < abs(aspects[0] / aspects[1] - 1)  # its sides are nearer to the exchanged ones
    is_square = abs(aspects[1] - 1) < 1 / GRID
    orientations = ORIENTATIONS if is_square else ORIENTATIONS[4:] if is_turned else ORIENTATIONS[:4]
    plain = _compare(cells, reference_cells, "RGB", orientations[0])
    if plain.is_none and plain.difference <= ALIKE:
        return plain
    tried = [_compare(cells, reference_cells, *kind) for kind in sorted(product(COLOURS, orientations), key=_rank)]
    least = min(alteration.difference for alteration in tried)
    if plain.is_none and least > min(EXPLAINED * plain.difference, UNLIKE):
        return plain
    return next(alteration for alteration in tried if alteration.difference <= least + SIMPLER)


def pressed_share(untouched: NDArray[np.uint8], photograph: NDArray[np.uint8], background: NDArray[np.uint8]) -> float:
    """Compute the share of the cells that differ most between two photographs in which the untouched one is the pressed one.

    Parameters
    ----------
    untouched, photograph, background
        (rows, cols, 3) uint8, with any numbers of pixels; the latter shows the sensor's gel with nothing on it.

    Returns
    -------
    0 if the untouched photograph has no contact, 1 if it has the only one, else between; 0 if nothing is pressed.
    """
    first, second, rest = (cell_means(image) for image in (untouched, photograph, background))
    first, second = (cells / max(_gain(cells, rest), 0.1) for cells in (first, second))
    change = np.abs(second - first).mean(axis=2)
    if change.max() < PRESSED:
        return 0.0
    excess = (np.abs(first - rest) - np.abs(second - rest)).mean(axis=2)
    return float((excess > change / 2)[change > change.max() / 2].mean())


def rim_change(photograph: NDArray[np.uint8], untouched: NDArray[np.uint8]) -> float:
    """Compute the share of the cells along the rim in which two photographs, (rows, cols, 3) uint8, differ by more than `PRESSED`."""
    change = np.abs(cell_means(photograph) - cell_means(untouched)).mean(axis=2)
    return float((np.concatenate([change[[0, -1]].ravel(), change[1:-1, [0, -1]].ravel()]) > PRESSED).mean())


def cell_means(image: NDArray[np.uint8]) -> NDArray[np.float64]:
    """Average an image in a grid, (rows, cols, 3) to (GRID, GRID, 3) levels: some pixels of a large one; those of a small one repeat."""
    step = max(1, min(image.shape[:2]) // (SAMPLES * GRID))
    means = np.asarray(image[step // 2 :: step, step // 2 :: step], np.float64)
    for axis in (0, 1):
        edges = np.arange(GRID + 1) * means.shape[axis] // GRID
        sums = np.add.reduceat(means, edges[:-1], axis=axis)
        means = sums / np.maximum(np.diff(edges), 1).reshape((-1, 1, 1) if axis == 0 else (1, -1, 1))
    return means


def _rank(kind: tuple[str, Orientation]) -> tuple[int, int]:
    """Order alterations by how likely they are: one change before two, and orders of colours that no program writes last."""
    colours, orientation = COLOURS.index(kind[0]), ORIENTATIONS.index(kind[1])
    return min(colours, 1) + (colours > 2) + (orientation % 4 > 0), colours + orientation


def _compare(cells: NDArray[np.float64], reference: NDArray[np.float64], colours: str, orientation: Orientation) -> Alteration:
    altered = _TURNED[orientation](reference)
    altered = np.repeat((altered @ LUMA)[..., None], 3, axis=2) if colours == "grey" else altered[..., ["RGB".index(c) for c in colours]]
    gain = _gain(cells, altered)
    gains = tuple(_gain(cells[..., channel], altered[..., channel]) for channel in range(3))
    unscaled, difference, balanced = (
        float(np.median((np.abs(cells - scale * altered) / np.maximum(scale, 0.1)).mean(axis=2))) for scale in (1.0, gain, np.array(gains))
    )
    return Alteration(colours, orientation, gain, (gains[0], gains[1], gains[2]), unscaled, difference, balanced)


def _gain(cells: NDArray[np.float64], reference: NDArray[np.float64]) -> float:
    """Compute how many times as bright cells are as their reference: the median where neither is too dark or too bright."""
    usable = (reference > DARK) & (cells < BRIGHT)
    return float(np.median(cells[usable] / reference[usable]) if usable.any() else cells.mean() / max(reference.mean(), 1.0))
