"""How a photograph of a gel differs as a whole from another one of the same gel: exchanged colours, turned, mirrored, exposure.

Valid range: photographs of which a press covers less than half. One that covers all of the gel may hide an alteration.
"""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import permutations, product

import numpy as np
from numpy.typing import NDArray

from pipeline.kernels.arrays import Array

GRID = 32  # cells per side in which photographs are averaged before they are compared: noise does not count
SAMPLES = 4  # pixels per side of a cell that are enough
ALIKE = 2.0  # levels: photographs that differ by no more are not searched for an alteration
EXPLAINED = 0.6  # an alteration leaves less than this share of the difference, and no more than `UNLIKE`
UNLIKE = 8.0  # levels: a gel that differs by more is another one; another unit of the same sensor differs by 4
SIMPLER = 1.0  # levels more than the least that the likeliest alteration may leave: symmetric gels have several
DARK, BRIGHT = 8, 250  # levels between which ratios of brightness are measured
PRESSED = 8.0  # levels by which a cell of a contact differs
HUES = np.exp(2j * np.pi * np.arange(3) / 3)  # red, green and blue on the colour circle: their sum with a grey is 0
ROUNDS = 10  # of weighted least squares
LUMA = np.array([0.299, 0.587, 0.114])  # shares of red, green and blue in a grey level

_TURNED: dict[str, Callable[[Array], Array]] = {
    "upright": lambda cells: cells,
    "turned by 180°": lambda cells: cells[::-1, ::-1],
    "mirrored left to right": lambda cells: cells[:, ::-1],
    "mirrored top to bottom": lambda cells: cells[::-1],
    "turned by 90°": lambda cells: np.rot90(cells, -1),  # clockwise
    "turned by 270°": lambda cells: np.rot90(cells),
    "transposed": lambda cells: cells.swapaxes(0, 1),
    "turned by 180° and transposed": lambda cells: cells.swapaxes(0, 1)[::-1, ::-1],
}
ORIENTATIONS = tuple(_TURNED)
COLOURS = ("RGB", "BGR", "grey", *("".join(order) for order in permutations("RGB") if "".join(order) not in ("RGB", "BGR")))
"""Which colours of the reference are a photograph's red, green and blue."""


@dataclass(frozen=True)
class Alteration:
    """How a photograph is made from its reference. Differences are medians over cells, in levels."""

    colours: str  # one of `COLOURS`
    orientation: str  # how the reference is turned
    gain: float  # brightness over the reference's
    gains: tuple[float, float, float]  # the same of red, green and blue
    unscaled: float  # difference from the altered reference as it is,
    difference: float  # from it made as bright as the photograph,
    balanced: float  # and from it with the brightness of each colour
    chroma: complex  # factor of chromas over the reference's: size of contrast and saturation, angle of hue
    chroma_left: float  # share of the median difference of chromas that this factor leaves

    @property
    def is_none(self) -> bool:
        """Check whether the photograph differs from its reference in brightness alone."""
        return (self.colours, self.orientation) == ("RGB", "upright")


def find_alteration(photograph: NDArray[np.uint8], reference: NDArray[np.uint8]) -> Alteration:  # none if none is clearly better
    """Find what turns a reference (rows, cols, 3) into a photograph, of any size, of the same gel, perhaps pressed."""
    cells, reference_cells = cell_means(photograph), cell_means(reference)
    aspects = [image.shape[1] / image.shape[0] for image in (photograph, reference)]
    is_turned = abs(aspects[0] * aspects[1] - 1) < abs(aspects[0] / aspects[1] - 1)  # its sides are nearer to the exchanged ones
    is_square = abs(aspects[1] - 1) < 1 / GRID
    orientations = ORIENTATIONS if is_square else ORIENTATIONS[4:] if is_turned else ORIENTATIONS[:4]
    plain = _compare(cells, reference_cells, "RGB", orientations[0])
    if plain.is_none and plain.difference <= ALIKE:
        return plain
    kinds = sorted(product(COLOURS, orientations), key=_rank)
    coarse, coarse_reference = (image.reshape(GRID // 2, 2, GRID // 2, 2, 3).mean(axis=(1, 3)) for image in (cells, reference_cells))
    candidates = [_altered(coarse_reference, *kind) for kind in kinds]
    for measure in (_gain, _gains) if plain.balanced > UNLIKE else (_gain,):  # perhaps white balance differs as well
        remainders = [_difference(coarse, candidate, measure(coarse, candidate)) for candidate in candidates]
        least = min(remainders)
        if not plain.is_none or least <= min(EXPLAINED * remainders[0], UNLIKE):
            kind = next(kind for kind, remainder in zip(kinds, remainders, strict=True) if remainder <= least + SIMPLER)
            return _compare(cells, reference_cells, *kind)
    return plain


def pressed_share(untouched: NDArray[np.uint8], photograph: NDArray[np.uint8], background: NDArray[np.uint8]) -> float:
    """Compute the share of the cells of contacts that are pressed in the untouched photograph; `background` shows the gel alone."""
    first, second, rest = (cell_means(image) for image in (untouched, photograph, background))
    first, second = (cells / np.maximum(_gain(cells, rest), 0.1) for cells in (first, second))
    change = np.abs(second - first).mean(axis=2)
    if change.max() < PRESSED:
        return 0.0
    excess = (np.abs(first - rest) - np.abs(second - rest)).mean(axis=2)
    return float((excess > change / 2)[change > change.max() / 2].mean())


def rim_change(photograph: NDArray[np.uint8], untouched: NDArray[np.uint8]) -> float:
    """Compute the share of the cells along the rim in which two photographs, (rows, cols, 3) uint8, differ by more than `PRESSED`."""
    change = np.abs(cell_means(photograph) - cell_means(untouched)).mean(axis=2)
    return float((np.concatenate([change[[0, -1]].ravel(), change[1:-1, [0, -1]].ravel()]) > PRESSED).mean())


def cell_means(image: NDArray[np.uint8]) -> Array:
    """Average an image in a grid, (rows, cols, 3) to (GRID, GRID, 3) levels: some pixels of a large one; those of a small one repeat."""
    rows, cols = (((np.arange(SAMPLES * GRID) + 0.5) * side / (SAMPLES * GRID)).astype(int) for side in image.shape[:2])
    sums = np.zeros((GRID, GRID, 3))
    for row, col in product(range(SAMPLES), repeat=2):
        sums += image[rows[row::SAMPLES, None], cols[col::SAMPLES]]
    return sums / SAMPLES**2


def _rank(kind: tuple[str, str]) -> tuple[int, int]:
    """Order alterations by how likely they are: one change before two, and orders of colours that no program writes last."""
    colours, orientation = COLOURS.index(kind[0]), ORIENTATIONS.index(kind[1])
    return min(colours, 1) + (colours > 2) + (orientation % 4 > 0), colours + orientation


def _altered(reference: Array, colours: str, orientation: str) -> Array:
    turned = _TURNED[orientation](reference)
    if colours == "grey":
        return np.repeat((turned @ LUMA)[..., None], 3, axis=2)
    return turned[..., ["RGB".index(colour) for colour in colours]]


def _compare(cells: Array, reference: Array, colours: str, orientation: str) -> Alteration:
    altered = _altered(reference, colours, orientation)
    gain, gains = _gain(cells, altered), _gains(cells, altered)
    unscaled, difference, balanced = (_difference(cells, altered, scale) for scale in (np.ones(1), gain, gains))
    red, green, blue = map(float, gains)
    chroma = _fit_chroma(cells, gain * altered)
    return Alteration(colours, orientation, float(gain), (red, green, blue), unscaled, difference, balanced, *chroma)


def _difference(cells: Array, reference: Array, scale: Array) -> float:
    """Compute the median difference from a reference that is `scale` times as bright, levels of the reference."""
    return float(np.median((np.abs(cells - scale * reference) / np.maximum(scale, 0.1)).mean(axis=2)))


def _gain(cells: Array, reference: Array) -> Array:
    """Compute how many times as bright cells are as their reference: the median where neither is too dark or too bright."""
    usable = (reference > DARK) & (cells < BRIGHT)
    return np.asarray(np.median(cells[usable] / reference[usable]) if usable.any() else cells.mean() / max(reference.mean(), 1.0))


def _gains(cells: Array, reference: Array) -> Array:
    return np.array([_gain(cells[..., colour], reference[..., colour]) for colour in range(3)])


def _fit_chroma(cells: Array, reference: Array) -> tuple[complex, float]:
    """Fit the factor between chromas by least absolute differences, and compute the share that it leaves."""
    chroma, reference_chroma = (image @ HUES for image in (cells, reference))
    factor = 1 + 0j
    for _ in range(ROUNDS):
        weights = reference_chroma.conj() / np.maximum(np.abs(chroma - factor * reference_chroma), 1.0)
        factor = complex((weights * chroma).sum() / max((weights * reference_chroma).real.sum(), 1e-9))
    before, after = (float(np.median(np.abs(chroma - scale * reference_chroma))) for scale in (1, factor))
    return factor, after / max(before, 1e-9)
