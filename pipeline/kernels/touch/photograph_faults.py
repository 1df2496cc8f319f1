"""Say what is wrong with photographs of a gel as a whole, before they are read: exchanged colours, turned, mirrored, exposure.

Limits are above what public sets and other units of a sensor show: brightness differs by 0.022 within a set and by 0.065 between units,
colours relative to each other by 0.055, chroma by 0.07, and a gel that is tilted by 40° as a whole by 17 levels.
"""

import cmath
import math
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from pipeline.console import NAMED, pluralise
from pipeline.errors import InvalidInput
from pipeline.kernels.touch.optics import POSITION_TERMS
from pipeline.kernels.touch.photograph_alteration import UNLIKE, Alteration, find_alteration, pressed_share
from pipeline.kernels.touch.sensor import Sensor
from pipeline.kernels.touch.tactile_image import untouched_image

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


def stop_at(faults: list[str]) -> None:
    """Raise an `InvalidInput` that names faults of photographs, if there are some."""
    if faults:
        more = f"; and {pluralise(len(faults) - NAMED, 'more fault')}" if len(faults) > NAMED else ""
        raise InvalidInput(f"{'; '.join(faults[:NAMED])}{more}. {TO_ACCEPT}")


def untouched_faults(untouched: NDArray[np.uint8], sensor: Sensor) -> list[str]:
    """List how an untouched photograph, (rows, cols, 3), is altered beside the background of the sensor file.

    Other sides than the sensor's are no fault here: readers name them.
    """
    if not _has_sides(untouched, *sensor.shape):
        return []
    alteration, beside = find_alteration(untouched, _background(sensor)), f"the background of sensor {sensor.name}"
    faults = [f"the untouched photograph, compared with {beside}: {fault}" for fault in _altered(alteration, OTHER_DAY_EXPOSURE)]
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
    if untouched is None:
        assert sensor is not None
        reference, exposure, beside = _background(sensor), OTHER_DAY_EXPOSURE, f"the background of sensor {sensor.name}"
    else:
        reference, exposure, beside = untouched, EXPOSURE, "the untouched one"
        if sensor is not None and photograph.shape == untouched.shape and not _is_coarse(sensor):
            share = pressed_share(untouched, photograph, _background(sensor))
            if share > EXCHANGED:
                return [f"the untouched photograph shows a contact, and {name} does not: exchange them"]
            if share > PRESSED_TOO:
                return [f"the untouched photograph shows a contact too, beside {name}: take one with nothing in the gel"]
    if not _has_sides(photograph, *reference.shape[:2]):
        return []
    alteration = find_alteration(photograph, reference)
    is_lit_by_lamps = sensor is not None and sensor.calibrated is None  # under which a tilt of all of the gel looks like white balance
    faults = [
        f"{name}, compared with {beside}: {fault}"
        for fault in _altered(alteration, exposure, is_pressed=True, has_balance=not is_lit_by_lamps)
    ]
    if faults or alteration.difference <= UNLIKE_PRESSED or is_lit_by_lamps:
        return faults
    return [
        f"{name} does not look like {beside}: they differ by {alteration.difference:.0f} levels nearly everywhere; is it by one sensor?"
    ]


@lru_cache(maxsize=4)
def _background(sensor: Sensor) -> NDArray[np.uint8]:
    return untouched_image(sensor)


def _altered(alteration: Alteration, exposure: float, *, is_pressed: bool = False, has_balance: bool = True) -> list[str]:
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


def _has_sides(image: NDArray[np.uint8], rows: int, cols: int) -> bool:
    """Check whether an image has the sides of others, or these exchanged, as after a quarter turn."""
    aspect = image.shape[1] / image.shape[0]
    return bool(min(abs(aspect * rows / cols - 1), abs(aspect * cols / rows - 1)) < SIDES)


def _is_coarse(sensor: Sensor) -> bool:
    """Check whether the file's background is a polynomial that is too simple to resemble the untouched gel."""
    background = sensor.calibrated.background if sensor.calibrated else ""
    return not isinstance(background, str) and POSITION_TERMS[len(background)] < COARSE
