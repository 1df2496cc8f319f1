"""Say what is wrong with photographs of a gel as a whole, before they are read: exchanged colours, turned, mirrored, exposure.

Valid range: photographs of which a press covers less than half. One that covers all of the gel may hide an alteration. Limits are above
what public sets and other units of a sensor show: brightness differs by 0.022 within a set and by 0.065 between units, colours relative
to each other by 0.055, chroma by 0.07, and a gel that is tilted by 40° as a whole by 17 levels.
"""

import cmath
import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from itertools import permutations, product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pipeline.console import NAMED, pluralise
from pipeline.errors import InvalidInput
from pipeline.kernels.arrays import Array
from pipeline.kernels.touch.sensor import POSITION_TERMS, Sensor
from pipeline.kernels.touch.tactile_image import untouched_image

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
TO_ACCEPT = "If the photographs are right as they are, go on with --accept-photographs (in Python, accept_photographs=True)"
EXPOSURE, OTHER_DAY_EXPOSURE = 0.06, 0.08  # largest relative difference of brightness: of one session; from the sensor file
BALANCE = 0.15  # largest difference between the relative brightness of two colours
BALANCED = 0.3  # share of a difference that brightness by colour must leave at most, for white balance to differ
CHROMA = 0.12  # largest relative difference of chroma: of contrast, saturation or hue
CHROMA_LEFT = 0.7  # share of a difference that chroma's factor must leave at most; beside a press, its own change
STRANGE = 1.5  # chroma that differs by more is no setting of a camera
UNLIKE_PRESSED = 20.0  # levels by which a pressed gel may differ in the median of its cells
EXCHANGED, PRESSED_TOO = 0.8, 0.2  # shares pressed in the untouched photograph: exchanged with the other; both are pressed
SIDES = 0.05  # largest relative difference between the aspect ratios of photographs that are compared
COARSE = 3  # least degree of a polynomial background that resembles the untouched gel

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
COLOUR_ORDERS = ("RGB", "BGR", "grey", *("".join(order) for order in permutations("RGB") if "".join(order) not in ("RGB", "BGR")))
"""Which colours of the reference are a photograph's red, green and blue."""


@dataclass(frozen=True)
class Alteration:
    """How a photograph is made from its reference. Differences are medians over cells, in levels."""

    colours: str  # one of `COLOUR_ORDERS`
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


class Cells(NamedTuple):
    """A photograph, averaged over a grid."""

    levels: Array  # (GRID, GRID, 3)
    aspect: float  # width over height of the photograph


def average(image: NDArray[np.uint8]) -> Cells:
    """Average an image (rows, cols, 3) over a grid: some pixels of a large one; those of a small one repeat."""
    rows, cols = (((np.arange(SAMPLES * GRID) + 0.5) * side / (SAMPLES * GRID)).astype(int) for side in image.shape[:2])
    sums = np.zeros((GRID, GRID, 3))
    for row, col in product(range(SAMPLES), repeat=2):
        sums += image[rows[row::SAMPLES, None], cols[col::SAMPLES]]
    return Cells(sums / SAMPLES**2, image.shape[1] / image.shape[0])


def find_alteration(photograph: Cells, reference: Cells) -> Alteration:  # none if none is clearly better
    """Find what turns a reference into a photograph, of any size, of the same gel, perhaps pressed."""
    (cells, aspect), (reference_cells, own_aspect) = photograph, reference
    is_turned = abs(aspect * own_aspect - 1) < abs(aspect / own_aspect - 1)  # its sides are nearer to the exchanged ones
    is_square = abs(own_aspect - 1) < 1 / GRID
    orientations = ORIENTATIONS if is_square else ORIENTATIONS[4:] if is_turned else ORIENTATIONS[:4]
    plain = _compare(cells, reference_cells, "RGB", orientations[0])
    if plain.is_none and plain.difference <= ALIKE:
        return plain
    kinds = sorted(product(COLOUR_ORDERS, orientations), key=_rank)
    coarse, coarse_reference = (image.reshape(GRID // 2, 2, GRID // 2, 2, 3).mean(axis=(1, 3)) for image in (cells, reference_cells))
    candidates = [_altered(coarse_reference, *kind) for kind in kinds]
    for measure in (_gain, _gains) if plain.balanced > UNLIKE else (_gain,):  # perhaps white balance differs as well
        remainders = [_difference(coarse, candidate, measure(coarse, candidate)) for candidate in candidates]
        least = min(remainders)
        if not plain.is_none or least <= min(EXPLAINED * remainders[0], UNLIKE):
            kind = next(kind for kind, remainder in zip(kinds, remainders, strict=True) if remainder <= least + SIMPLER)
            return _compare(cells, reference_cells, *kind)
    return plain


def pressed_share(untouched: Cells, photograph: Cells, background: Cells) -> float:
    """Compute the share of the cells of contacts that are pressed in the untouched photograph; `background` shows the gel alone."""
    rest = background.levels
    first, second = (image.levels / np.maximum(_gain(image.levels, rest), 0.1) for image in (untouched, photograph))
    change = np.abs(second - first).mean(axis=2)
    if change.max() < PRESSED:
        return 0.0
    excess = (np.abs(first - rest) - np.abs(second - rest)).mean(axis=2)
    return float((excess > change / 2)[change > change.max() / 2].mean())


def rim_change(photograph: NDArray[np.uint8], untouched: NDArray[np.uint8]) -> float:
    """Compute the share of the cells along the rim in which two photographs, (rows, cols, 3) uint8, differ by more than `PRESSED`."""
    change = np.abs(average(photograph).levels - average(untouched).levels).mean(axis=2)
    return float((np.concatenate([change[[0, -1]].ravel(), change[1:-1, [0, -1]].ravel()]) > PRESSED).mean())


def _rank(kind: tuple[str, str]) -> tuple[int, int]:
    """Order alterations by how likely they are: one change before two, and orders of colours that no program writes last."""
    colours, orientation = COLOUR_ORDERS.index(kind[0]), ORIENTATIONS.index(kind[1])
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


def stop_at(faults: list[str]) -> None:
    """Raise an `InvalidInput` that names faults of photographs, if there are some."""
    if faults:
        more = f"; and {pluralise(len(faults) - NAMED, 'more fault')}" if len(faults) > NAMED else ""
        raise InvalidInput(f"{'; '.join(faults[:NAMED])}{more}. {TO_ACCEPT}")


def untouched_faults(untouched: NDArray[np.uint8], sensor: Sensor) -> list[str]:
    """List how an untouched photograph, (rows, cols, 3), is altered beside the background of the sensor file.

    Other sides than the sensor's are no fault here: readers name them.
    """
    cells, reference, beside = average(untouched), _background(sensor), f"the background of sensor {sensor.name}"
    if not _has_sides(cells, reference):
        return []
    alteration = find_alteration(cells, reference)
    faults = [f"the untouched photograph, compared with {beside}: {fault}" for fault in _explanations(alteration, OTHER_DAY_EXPOSURE)]
    if faults or alteration.difference <= UNLIKE or _is_coarse(sensor):
        return faults
    return [
        f"the untouched photograph does not look like {beside}: they differ by {alteration.difference:.0f} levels, at most {UNLIKE:g} are "
        "usual; name the file of its own sensor, or calibrate it, and see that nothing touches the gel"
    ]


def photograph_faults(
    photograph: NDArray[np.uint8],  # (rows, cols, 3)
    untouched: NDArray[np.uint8] | None,  # (rows, cols, 3); without one, the photograph is compared with the sensor's background
    sensor: Sensor | None = None,  # if it is known, the untouched photograph may turn out to be the pressed one
    name: str = "the photograph",
) -> list[str]:
    """List how a photograph, perhaps of a press, is altered beside the untouched one; one of other sides has no fault here."""
    cells = average(photograph)
    if untouched is None:
        assert sensor is not None
        reference, exposure, beside = _background(sensor), OTHER_DAY_EXPOSURE, f"the background of sensor {sensor.name}"
    else:
        reference, exposure, beside = average(untouched), EXPOSURE, "the untouched one"
        if sensor is not None and photograph.shape == untouched.shape and not _is_coarse(sensor):
            share = pressed_share(reference, cells, _background(sensor))
            if share > EXCHANGED:
                return [f"the untouched photograph shows a contact, and {name} does not: exchange them"]
            if share > PRESSED_TOO:
                return [f"the untouched photograph shows a contact too, beside {name}: take one with nothing in the gel"]
    if not _has_sides(cells, reference):
        return []
    alteration = find_alteration(cells, reference)
    is_lit_by_lamps = sensor is not None and sensor.calibrated is None  # under which a tilt of all of the gel looks like white balance
    faults = [
        f"{name}, compared with {beside}: {fault}"
        for fault in _explanations(alteration, exposure, is_pressed=True, has_balance=not is_lit_by_lamps)
    ]
    if faults or alteration.difference <= UNLIKE_PRESSED or is_lit_by_lamps:
        return faults
    return [
        f"{name} does not look like {beside}: they differ by {alteration.difference:.0f} levels nearly everywhere; is it by one sensor?"
    ]


@lru_cache(maxsize=4)
def _background(sensor: Sensor) -> Cells:
    return average(untouched_image(sensor))


def _explanations(alteration: Alteration, exposure: float, *, is_pressed: bool = False, has_balance: bool = True) -> list[str]:
    """Describe an alteration that explains a photograph, each fault with its remedy."""
    faults: list[str] = []
    chroma = _chroma_faults(alteration, is_pressed=is_pressed) if has_balance else []
    if alteration.balanced > UNLIKE:  # nothing else explains it
        return chroma
    if alteration.colours == "grey":
        faults.append("grey: take it in colour")
    elif alteration.colours != "RGB":
        names = ", ".join({"R": "red", "G": "green", "B": "blue"}[colour] for colour in alteration.colours)
        faults.append(f"colours exchanged ({names}): save it as red, green, blue")
    if alteration.orientation != "upright":
        remedy = "mirror it back" if "mirrored" in alteration.orientation else "turn it back"
        faults.append(f"{alteration.orientation}: {remedy}")
    brightness = alteration.gain - 1
    if abs(brightness) > exposure and alteration.difference < min(UNLIKE, 2 * abs(brightness) * alteration.unscaled):
        relation = "brighter" if brightness > 0 else "darker"
        faults.append(f"exposure differs by {100 * abs(brightness):.0f} % ({relation}): fix the camera's exposure and gain")
    relative = np.array(alteration.gains) / max(alteration.gain, 0.01)
    if has_balance and np.ptp(relative) > BALANCE and alteration.balanced < BALANCED * alteration.difference:
        colours = ", ".join(f"{name} {100 * (ratio - 1):+.0f} %" for name, ratio in zip(("red", "green", "blue"), relative, strict=True))
        faults.append(f"white balance differs ({colours}): fix the camera's")
        return faults
    return faults + chroma


def _chroma_faults(alteration: Alteration, *, is_pressed: bool) -> list[str]:
    """Describe other contrast, saturation or hue: all colours are as many times as strong, or turned on the colour circle."""
    factor, change = alteration.chroma, abs(alteration.chroma - 1)
    if alteration.colours == "grey" or not CHROMA < change < STRANGE or alteration.chroma_left > (change if is_pressed else CHROMA_LEFT):
        return []
    if abs(abs(factor) - 1) <= CHROMA:
        return [f"hue differs by {abs(math.degrees(cmath.phase(factor))):.0f}°: fix the camera's"]
    strength = f"{100 * abs(abs(factor) - 1):.0f} % {'stronger' if abs(factor) > 1 else 'weaker'}"
    return [f"colours are {strength}: fix the camera's contrast, saturation and gamma, without image enhancement"]


def _has_sides(image: Cells, other: Cells) -> bool:
    """Check whether an image has the sides of another one, or these exchanged, as after a quarter turn."""
    return min(abs(image.aspect / other.aspect - 1), abs(image.aspect * other.aspect - 1)) < SIDES


def _is_coarse(sensor: Sensor) -> bool:
    """Check whether the file's background is a polynomial that is too simple to resemble the untouched gel."""
    background = sensor.calibrated.background if sensor.calibrated else ""
    return not isinstance(background, str) and POSITION_TERMS[len(background)] < COARSE
