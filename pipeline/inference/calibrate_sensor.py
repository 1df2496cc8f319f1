"""Calibrate a sensor from photographs of a ball in its gel, and write its file."""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from pipeline.errors import InvalidInput
from pipeline.formats.image_file import read_image
from pipeline.kernels.touch.calibrated_shading import calibrated_change
from pipeline.kernels.touch.calibration_fit import (
    RING,
    Circle,
    FitOptions,
    Photograph,
    ball_impression,
    distance_from,
    fit_background,
    fit_calibration,
)
from pipeline.kernels.touch.find_contact import find_contact
from pipeline.kernels.touch.optics import Calibration
from pipeline.kernels.touch.sensor import Sensor
from pipeline.store.atomic import write_at_once

SUFFIXES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff")
CIRCLES = "circles.csv"
"""File of known contacts: name, x, y, radius in pixels, from the centre of pixel (0, 0). Other contacts are detected."""
SENSOR_NAME = re.compile(r"[A-Za-z0-9._-]{1,120}")
MIN_PHOTOGRAPHS = 4


@dataclass(frozen=True)
class ImageErrors:
    """Hold the mean errors of the model and of the untouched photograph, levels of 255, in a contact and in the ring around it."""

    name: str
    contact: float
    ring: float
    untouched_contact: float
    untouched_ring: float


@dataclass(frozen=True, eq=False)
class CalibrationResult:
    """Hold a calibrated sensor, its errors on the photographs for fitting and testing, and the reasons why others are left out."""

    sensor: Sensor
    calibration: Calibration
    fitted: list[Photograph]
    tested: list[Photograph]
    fitted_errors: list[ImageErrors]
    tested_errors: list[ImageErrors]
    left_out: dict[str, str]


def read_photographs(folder: Path, untouched_path: Path) -> tuple[list[Photograph], NDArray[np.uint8], dict[str, str]]:
    """Read photographs, and detect their contacts.

    Parameters
    ----------
    folder
        Image files, and perhaps a file `CIRCLES`.
    untouched_path
        The photograph with nothing in the gel; it may lie in the folder.

    Returns
    -------
    The usable photographs, sorted by name; the untouched one; and why others are left out, by name.

    Raises
    ------
    InvalidInput
        The folder does not exist, the untouched photograph or `CIRCLES` cannot be read, `CIRCLES` names another file,
        or fewer than `MIN_PHOTOGRAPHS` can be used.
    """
    if not folder.is_dir():
        raise InvalidInput(f"folder {folder} does not exist; give one with photographs of a ball in the gel")
    untouched, circles = read_image(untouched_path), _read_circles(folder / CIRCLES)
    photographs: list[Photograph] = []
    left_out: dict[str, str] = {}
    for path in _image_files(folder, untouched_path):
        try:
            image = read_image(path)
            photographs.append(Photograph(path.name, image, _contact(image, untouched, circles.get(path.name))))
        except InvalidInput as error:
            left_out[path.name] = str(error)
    if unknown := sorted(circles.keys() - left_out.keys() - {photograph.name for photograph in photographs}):
        raise InvalidInput(
            f"{folder / CIRCLES} names {unknown[0]}, which is not a photograph in {folder}; correct its name, or remove the line"
        )
    if len(photographs) < MIN_PHOTOGRAPHS:
        reasons = _reasons(left_out) or "it holds no others"
        raise InvalidInput(f"{folder} has {len(photographs)} usable photographs, {MIN_PHOTOGRAPHS} are needed; {reasons}")
    return photographs, untouched, left_out


def check_name(path: Path, untouched_path: Path) -> None:
    """Raise an InvalidInput if the name of a sensor file is not a sensor's name, or its report would replace the untouched photograph."""
    if not SENSOR_NAME.fullmatch(path.stem) or path.suffix not in (".yaml", ".yml"):
        raise InvalidInput(f"{path}: a sensor file is called NAME.yaml, NAME of letters, digits, '.', '_' and '-'")
    if path.with_suffix(".png").resolve() == untouched_path.resolve():
        raise InvalidInput(f"{untouched_path} would be replaced by the report of {path}; rename one of them")


def _contact(image: NDArray[np.uint8], untouched: NDArray[np.uint8], given: Circle | None) -> Circle:
    if image.shape != untouched.shape:
        own, other = (f"{pixels.shape[0]} x {pixels.shape[1]}" for pixels in (image, untouched))
        raise InvalidInput(f"it has {own} pixels, the untouched photograph {other}")
    return given or find_contact(image, untouched)


def _image_files(folder: Path, untouched_path: Path) -> list[Path]:
    files = (file for file in folder.iterdir() if file.suffix.lower() in SUFFIXES)
    return sorted(file for file in files if file.resolve() != untouched_path.resolve())


def _reasons(left_out: dict[str, str]) -> str:
    return "; ".join(f"{name}: {reason}" for name, reason in left_out.items())


def _read_circles(path: Path) -> dict[str, Circle]:
    if not path.is_file():
        return {}
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:  # spreadsheets write a byte-order mark
            circles = {row["name"]: Circle(float(row["x"]), float(row["y"]), float(row["radius"])) for row in csv.DictReader(file)}
    except (KeyError, TypeError, ValueError) as error:
        raise InvalidInput(
            f"{path} needs the columns name, x, y, radius, with numbers in pixels; {type(error).__name__}: {error}"
        ) from error
    for name, circle in circles.items():
        if not (math.isfinite(circle.x) and math.isfinite(circle.y) and 0 < circle.radius < math.inf):
            raise InvalidInput(
                f"{path}: {name} has x {circle.x}, y {circle.y}, radius {circle.radius}; they must be finite, the radius above 0"
            )
    return circles


def calibrate(
    sensor: Sensor,
    photographs: Sequence[Photograph],
    untouched: NDArray[np.uint8],
    *,
    ball_radius: float,
    options: FitOptions,
    left_out: dict[str, str],
) -> CalibrationResult:
    """Fit a sensor to every second photograph and test it on the others.

    Parameters
    ----------
    sensor
        Gives the geometry.
    photographs, untouched, left_out
        From `read_photographs`.
    ball_radius
        m.
    options
        Size of the model.

    Returns
    -------
    The sensor that was fitted to half of the photographs, with its errors on both halves.

    Raises
    ------
    InvalidInput
        Fewer than `MIN_PHOTOGRAPHS` photographs have a contact that the ball can make.
    """
    largest = ball_radius / sensor.pitch[1]
    too_large = {
        photograph.name: f"its contact of {photograph.contact.radius:.0f} pixels is wider than the ball"
        for photograph in photographs
        if photograph.contact.radius >= largest
    }
    usable = [photograph for photograph in photographs if photograph.name not in too_large]
    left_out = left_out | too_large
    if len(usable) < MIN_PHOTOGRAPHS:
        raise InvalidInput(f"{len(usable)} photographs can be used, {MIN_PHOTOGRAPHS} are needed; {_reasons(left_out)}")
    fitted, tested = usable[::2], usable[1::2]
    fitted_sensor, calibration = fit_calibration(sensor, fitted, untouched, ball_radius, options)
    fitted_errors, tested_errors = (
        [image_errors(fitted_sensor, calibration, photograph, untouched, ball_radius) for photograph in half] for half in (fitted, tested)
    )
    return CalibrationResult(fitted_sensor, calibration, fitted, tested, fitted_errors, tested_errors, left_out)


def image_errors(
    sensor: Sensor, calibration: Calibration, photograph: Photograph, untouched: NDArray[np.uint8], ball_radius: float
) -> ImageErrors:
    """Compare a photograph with the model's image of the same contact.

    Parameters
    ----------
    sensor, calibration
        From `calibrate`.
    photograph
        The photograph and its contact.
    untouched
        (rows, cols, 3) uint8.
    ball_radius
        m.

    Returns
    -------
    Mean errors in the contact and in the ring around it, of the model's image and of the untouched one, levels.
    """
    model = render_contact(sensor, calibration, photograph, untouched, ball_radius)
    distance = distance_from(sensor, photograph.contact) / (photograph.contact.radius * sensor.pitch[1])
    contact, ring = distance < 1, (distance >= 1) & (distance < RING)
    means = [float(np.abs(image.astype(float) - photograph.image)[at].mean()) for image in (model, untouched) for at in (contact, ring)]
    return ImageErrors(photograph.name, *means)


def render_contact(
    sensor: Sensor, calibration: Calibration, photograph: Photograph, untouched: NDArray[np.uint8], ball_radius: float
) -> NDArray[np.uint8]:
    """Render the contact of a photograph over the untouched photograph.

    Parameters
    ----------
    sensor, calibration
        From `calibrate`.
    photograph
        Gives the contact.
    untouched
        (rows, cols, 3) uint8.
    ball_radius
        m.

    Returns
    -------
    (rows, cols, 3) uint8.
    """
    change = calibrated_change(ball_impression(sensor, photograph.contact, ball_radius), sensor, calibration)
    return np.rint(np.clip(untouched + change, 0, 255)).astype(np.uint8)


def write_sensor(result: CalibrationResult, path: Path, untouched_path: Path, *, background_degree: int | None, note: str) -> None:
    """Write the sensor file, and beside it the untouched photograph unless the background is a polynomial.

    Parameters
    ----------
    result
        From `calibrate`.
    path
        The YAML file.
    untouched_path
        The untouched photograph.
    background_degree
        Degree of a polynomial in place of the photograph; None for the photograph.
    note
        Comment at the head of the file.
    """
    sensor, calibration = result.sensor, result.calibration
    if background_degree is None:
        photograph = path.with_name(f"{path.stem}-untouched{untouched_path.suffix.lower()}")
        if photograph.resolve() != untouched_path.resolve():  # a previous run may have written it
            write_at_once(photograph, untouched_path.read_bytes())
        background: Any = photograph.name
    else:
        background = [list(levels) for levels in fit_background(read_image(untouched_path), sensor, background_degree)]
    described = sensor.model_dump(mode="json", exclude_none=True, exclude={"lights", "diffuse", "calibrated"})
    optics = {**calibration.model_dump(mode="json"), "background": background}
    text = yaml.safe_dump({**described, "calibrated": optics}, sort_keys=False, default_flow_style=None, width=140)
    write_at_once(path, ("".join(f"# {line}\n" for line in note.splitlines()) + text).encode())
