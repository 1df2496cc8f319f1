"""The range in which a sensor's colours were fitted to photographs, and the photographs that would widen it."""

import math
from collections.abc import Sequence

from pipeline.kernels.touch.ball_contact import Circle
from pipeline.kernels.touch.optics import POSITION_TERMS, Calibration
from pipeline.kernels.touch.sensor import MM, Sensor

STEEP = 45.0
"""Degrees of slope that an edge pressed into the gel has: steeper ones are photographed with a ball that is pressed in deeply."""
ROWS, COLUMNS = ("upper", "middle", "lower"), ("left", "middle", "right")  # thirds of the gel, as its image shows them


def fitted_range(calibration: Calibration) -> list[str]:
    """List the ranges of slopes, depths and positions in which colours were fitted, as lines of text."""
    slopes = f"fitted: slopes up to {slope_degrees(calibration):.0f} degrees"
    if calibration.within is None:
        return [f"{slopes}; the file does not say where contacts were (`within`): colours elsewhere are extrapolated, calibrate again"]
    left, top, right, bottom = (MM * side for side in calibration.within)
    depth = f"contacts up to {MM * calibration.deepest:.2f} mm deep"
    return [
        f"{slopes}, {depth}, x {left:.1f} to {right:.1f} mm, y {top:.1f} to {bottom:.1f} mm",
        "beyond, colours are those of the nearest slope, depth and position in this range",
    ]


def missing_photographs(
    sensor: Sensor,
    calibration: Calibration,
    contacts: Sequence[Circle],  # that it was fitted to
) -> list[str]:
    """List the photographs that a calibration lacks, as lines of text.

    They name the parts of the gel without the middle of a contact, unless colours do not depend on the position, and
    the slopes that are missing.
    """
    thirds = {(math.floor(3 * (circle.y + 0.5) / sensor.rows), math.floor(3 * (circle.x + 0.5) / sensor.cols)) for circle in contacts}
    empty = [(row, column) for row in range(3) for column in range(3) if (row, column) not in thirds]
    lines = []
    if empty and POSITION_TERMS[len(calibration.coefficients[0][0])] > 0:
        lines.append(f"no contact in the {', '.join(_third(*cell) for cell in empty)} of the gel: press there")
    if (steepest := slope_degrees(calibration)) < STEEP:
        lines.append(f"no slope steeper than {steepest:.0f} degrees: press deeper, or use a smaller ball")
    return lines


def slope_degrees(calibration: Calibration) -> float:
    """Compute the steepest fitted slope, degrees."""
    return math.degrees(math.asin(calibration.steepest))


def _third(row: int, column: int) -> str:
    return "middle" if (row, column) == (1, 1) else f"{ROWS[row]} {COLUMNS[column]}"
