"""Calibrate a sensor from photographs of a ball in its gel, and write its file."""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from matplotlib.figure import Figure
from numpy.typing import NDArray

from pipeline.contrib.calibration.ball_contact import RING, Photograph, ball_impression, distance_from
from pipeline.contrib.calibration.colour_fit import ColourFit, ColourFitOptions, fit_background, fit_colours
from pipeline.drawing.picture_sheet import spread_evenly
from pipeline.drawing.plots import save_figure
from pipeline.errors import InvalidInput
from pipeline.formats.image_file import encode_image
from pipeline.kernels.touch.calibrated_shading import indentation_change
from pipeline.kernels.touch.depth_maps import gel_under
from pipeline.kernels.touch.sensor import Calibration, Sensor
from pipeline.store.atomic import write_atomically

SENSOR_NAME = re.compile(r"[A-Za-z0-9._-]{1,120}")
SHOWN_PHOTOGRAPHS, GAIN = 3, 4
"""Photographs in a picture of a calibration, spread evenly, and the factor by which differences are enlarged."""


@dataclass(frozen=True)
class ImageErrors:
    """Mean errors of the model and of the untouched photograph, levels of 255, in a contact and in the ring around it."""

    name: str
    contact: float
    ring: float
    untouched_contact: float
    untouched_ring: float


@dataclass(frozen=True, eq=False)
class CalibrationResult:
    """A calibrated sensor, and the errors of one fitted to half of the photographs."""

    fit: ColourFit  # to all photographs, which is written
    half: ColourFit  # to every second photograph
    photographs: list[Photograph]  # all that were used; the odd ones are held out from `half`
    fitted_errors: list[ImageErrors]  # of `half` on the photographs that it was fitted to
    tested_errors: list[ImageErrors]  # and on the others

    @property
    def tested(self) -> list[Photograph]:
        """Photographs that `half` was not fitted to."""
        return self.photographs[1::2]


def check_name(path: Path, untouched_path: Path) -> None:
    """Raise an InvalidInput if the name of a sensor file is not a sensor's name, or its report would replace the untouched photograph."""
    if not SENSOR_NAME.fullmatch(path.stem) or path.suffix not in (".yaml", ".yml"):
        raise InvalidInput(f"{path}: a sensor file is called NAME.yaml, NAME of letters, digits, '.', '_' and '-'")
    for picture_name in (f"{path.stem}-calibration.png", f"{path.stem}.png"):  # the report, and what `check` draws
        if path.with_name(picture_name).resolve() == untouched_path.resolve():
            raise InvalidInput(f"{untouched_path} would be replaced by a picture of {path}; rename one of them")


def uncalibrated_sensor(
    name: str,
    shape: tuple[int, int],  # rows, cols
    *,
    pitch: float,  # width of a pixel, m
    thickness: float,  # of the gel, m
    row_scale: float = 1.0,  # height over width of a pixel
) -> Sensor:
    """Describe a sensor whose colours are not known."""
    rows, cols = shape
    return Sensor.model_validate(
        {
            "name": name,
            "width": cols * pitch,
            "height": rows * pitch * row_scale,
            "rows": rows,
            "cols": cols,
            "w": thickness,
            "range": 5 * thickness,
            "noise": "none",
            "calibrated": {"coefficients": [[[0.0]] * 2] * 3, "background": [(0.0, 0.0, 0.0)]},
        }
    )


def calibrate(
    sensor: Sensor,  # gives the geometry
    photographs: Sequence[Photograph],
    untouched: NDArray[np.uint8],
    *,
    ball_radius: float,  # m
    options: ColourFitOptions,
) -> CalibrationResult:
    """Fit a sensor to every second photograph and test it on the others; then fit it to all."""
    deepest = max(photographs, key=lambda photograph: photograph.contact.radius)
    reach = deepest.contact.radius * sensor.pitch[1]
    depth = ball_radius - math.sqrt(max(ball_radius**2 - reach**2, 0))  # of a gel that is not drawn in
    if depth > sensor.w:
        raise InvalidInput(
            f"in {deepest.name} the ball is pressed in {1e3 * depth:.3g} mm deep, the gel is {1e3 * sensor.w:.3g} mm thick; give its "
            "thickness with --thickness, or correct --ball-radius and --mm-per-pixel"
        )
    half = fit_colours(sensor, photographs[::2], untouched, ball_radius, options)
    fitted, tested = (
        [_image_errors(half.sensor, half.calibration, photograph, untouched, ball_radius) for photograph in part]
        for part in (photographs[::2], photographs[1::2])
    )
    fit = fit_colours(sensor, photographs, untouched, ball_radius, options)
    return CalibrationResult(fit, half, list(photographs), fitted, tested)


def _image_errors(
    sensor: Sensor, calibration: Calibration, photograph: Photograph, untouched: NDArray[np.uint8], ball_radius: float
) -> ImageErrors:
    """Compare a photograph with the image of the same contact by a fitted sensor."""
    model = render_contact(sensor, calibration, photograph, untouched, ball_radius)
    distance = distance_from(sensor, photograph.contact) / (photograph.contact.radius * sensor.pitch[1])
    contact, ring = distance < 1, (distance >= 1) & (distance < RING)
    differences = [np.abs(image.astype(float) - photograph.image) for image in (model, untouched)]
    means = [float(difference[region].mean()) if region.any() else 0.0 for difference in differences for region in (contact, ring)]
    return ImageErrors(photograph.name, *means)


def render_contact(
    sensor: Sensor,
    calibration: Calibration,
    photograph: Photograph,
    untouched: NDArray[np.uint8],
    ball_radius: float,  # m
) -> NDArray[np.uint8]:  # (rows, cols, 3)
    """Render the contact of a photograph over the untouched one."""
    gel = gel_under(ball_impression(sensor, photograph.contact, ball_radius), sensor)
    change = indentation_change(gel.indentation, sensor, calibration)
    return np.rint(np.clip(untouched + change, 0, 255)).astype(np.uint8)


def write_sensor(
    result: CalibrationResult,
    path: Path,
    untouched: NDArray[np.uint8],  # (rows, cols, 3)
    *,
    background_degree: int | None,  # of a polynomial in place of the untouched photograph; None for the photograph
    note: str,  # comment at the head of the file
) -> None:
    """Write the sensor file, and beside it the untouched photograph unless the background is a polynomial."""
    sensor, calibration = result.fit.sensor, result.fit.calibration
    if background_degree is None:
        photograph = path.with_name(f"{path.stem}-untouched.png")
        write_atomically(photograph, encode_image(untouched))
        background: Any = photograph.name
    else:
        background = [list(levels) for levels in fit_background(untouched, sensor, background_degree)]
    described = sensor.model_dump(mode="json", exclude_none=True, exclude={"lights", "diffuse", "calibrated"})
    optics = {**calibration.model_dump(mode="json"), "background": background}
    text = yaml.safe_dump({**described, "calibrated": optics}, sort_keys=False, default_flow_style=None, width=140)
    write_atomically(path, ("".join(f"# {line}\n" for line in note.splitlines()) + text).encode())


def draw_calibration(photographs: Sequence[Photograph], models: Sequence[NDArray[np.uint8]], path: Path) -> None:
    """Draw a row per photograph as a PNG: the photograph, the model's image of it, and their difference × `GAIN` around grey."""
    pairs = spread_evenly(list(zip(photographs, models, strict=True)), SHOWN_PHOTOGRAPHS)
    figure = Figure((9, 3 * len(pairs)), dpi=72, layout="constrained")
    for row, (photograph, model) in zip(figure.subplots(len(pairs), 3, squeeze=False), pairs, strict=True):
        contact, reach = photograph.contact, RING * photograph.contact.radius
        part = tuple(slice(max(0, int(at - reach)), int(at + reach) + 1) for at in (contact.y, contact.x))
        difference = np.clip(128 + GAIN * (model.astype(int) - photograph.image), 0, 255).astype(np.uint8)
        panels = {f"photograph {photograph.name}": photograph.image, "model": model, f"model - photograph, × {GAIN}": difference}
        for axes, (title, image) in zip(row, panels.items(), strict=True):
            axes.imshow(image[part])
            axes.set(xticks=[], yticks=[])
            axes.set_title(title, fontsize=9)
    save_figure(figure, path)
