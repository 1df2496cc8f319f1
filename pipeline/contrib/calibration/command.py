"""`vt-pipeline calibrate-sensor`: a sensor file from photographs."""

import shlex
import time
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from pydantic import ValidationError

from pipeline.console import Row, Table, print_lines, print_warning, show_tables
from pipeline.errors import InvalidInput
from pipeline.formats.description_file import invalid_entries


def calibrate_sensor(
    folder: Annotated[Path, typer.Argument(help="Photographs of a ball in the gel; circles.csv there may give the contacts.")],
    out: Annotated[Path, typer.Argument(help="The sensor file to write; its report is OUT-calibration.png.")],
    untouched: Annotated[Path, typer.Option(help="The photograph with nothing in the gel.")],
    ball_radius: Annotated[float, typer.Option(min=1e-3, help="Radius of the ball, mm.")],
    mm_per_pixel: Annotated[float, typer.Option(min=1e-6, help="mm per pixel on the gel's surface, along a row.")],
    mm_per_row: Annotated[
        float | None, typer.Option(min=1e-6, help="mm from row to row, if pixels are not square; by default --mm-per-pixel.")
    ] = None,
    thickness: Annotated[float, typer.Option(min=1e-3, help="Thickness of the gel, mm: the depth of the deepest press.")] = 4.0,
    normal_degree: Annotated[int, typer.Option(min=1, max=6, help="Degree of the polynomial in the gel's normal.")] = 3,
    position_degree: Annotated[
        int | None, typer.Option(min=0, max=6, help="Degree of the polynomial in the position; by default the one that predicts best.")
    ] = None,
    shadows: Annotated[int, typer.Option(min=0, max=12, help="Number of shadows to look for.")] = 3,
    background_degree: Annotated[
        int | None, typer.Option(min=0, max=6, help="Degree of a polynomial background; else a photograph.")
    ] = None,
    accept_photographs: Annotated[
        bool,
        typer.Option("--accept-photographs", help="Use photographs that look altered beside the untouched one: by colours, exposure, ..."),
    ] = False,
    train: Annotated[bool, typer.Option("--train", help="Train a network to read depth in the sensor's photographs too.")] = False,
) -> None:
    """Calibrate a sensor from photographs of a ball.

    Its colours are fitted to every second photograph and tested on the others, then fitted to all. With --train they are fitted for depth:
    to the contacts above all, with an elastic gel.
    """
    from pipeline.contrib.calibration import calibrate_sensor as calibration
    from pipeline.contrib.calibration.ball_photographs import read_photographs
    from pipeline.contrib.calibration.colour_fit import FIT_FOR_DEPTH, ColourFitOptions, missing_photographs
    from pipeline.contrib.calibration.square_pixels import check_square
    from pipeline.formats.image_file import read_image
    from pipeline.kernels.touch.calibrated_shading import fitted_range

    calibration.check_name(out, untouched)
    row_scale, largest = (mm_per_row or mm_per_pixel) / mm_per_pixel, ball_radius / mm_per_pixel
    photographs, image, unusable = read_photographs(folder, untouched, largest, row_scale=row_scale, accept_photographs=accept_photographs)
    doubts = [] if mm_per_row else check_square(photographs, image, largest)
    if (image != read_image(untouched)).any():
        print_lines("dots that are printed on the gel are filled in")
    radius, began = 1e-3 * ball_radius, time.perf_counter()
    defaults = FIT_FOR_DEPTH if train else ColourFitOptions()
    options = replace(defaults, normal_degree=normal_degree, position_degree=position_degree, shadows=shadows)
    try:
        sizes = {"pitch": 1e-3 * mm_per_pixel, "thickness": 1e-3 * thickness, "row_scale": row_scale}
        sensor = calibration.uncalibrated_sensor(out.stem, image.shape[:2], **sizes)
        result = calibration.calibrate(sensor, photographs, image, ball_radius=radius, options=options)
    except ValidationError as error:
        raise InvalidInput(f"no sensor is like this: {invalid_entries(error)}; are lengths in mm?") from error
    for name, reason in unusable.items():
        print_warning("not used:", f"{name}: {reason}")
    fit = result.fit
    note = f"Fitted by `vt-pipeline calibrate-sensor` to {len(result.photographs)} photographs of a ball of {ball_radius:g} mm radius."
    calibration.write_sensor(result, out, image, background_degree=background_degree, note=note)
    rows = []
    for title, image_errors in (("fitted to", result.fitted_errors), ("held out", result.tested_errors)):
        means = np.mean([[entry.contact, entry.ring, entry.untouched_contact, entry.untouched_ring] for entry in image_errors], axis=0)
        rows.append(Row([title, len(image_errors), *means]))
    columns = ["mean error, levels of 255", "photographs", "contact", "ring around it", "untouched: contact", "ring"]
    show_tables([Table("", columns, rows, ["", "", *[".1f"] * 4])])
    worst = max(result.tested_errors, key=lambda entry: entry.contact)
    elastic = f"elastic gel {1e3 * fit.sensor.layer_thickness:.2f} mm thick"
    surface = elastic if fit.sensor.gel else f"membrane {1e3 * fit.sensor.membrane:.2f} mm"
    print_lines(
        f"worst held-out photograph: {worst.name}, {worst.contact:.1f} in the contact",
        f"then fitted to all {len(result.photographs)}; {surface}, position degree {fit.position_degree}",
        *fitted_range(fit.calibration),
    )
    for line in [*doubts, *fit.doubts]:
        print_warning("in doubt:", line)
    for line in missing_photographs(fit.sensor, fit.calibration, [photograph.contact for photograph in result.photographs]):
        print_warning("missing:", line)
    report = out.with_name(f"{out.stem}-calibration.png")
    half = result.half
    images = [calibration.render_contact(half.sensor, half.calibration, photograph, image, radius) for photograph in result.tested]
    calibration.draw_calibration(result.tested, images, report)
    print_lines(f"{out}, {report}; `vt-pipeline check {shlex.quote(str(out))}` draws the sensor")
    if train:
        from pipeline.formats.sensor_file import load_sensor
        from pipeline.real_touch import MODEL_SUFFIX, PRESSES, save_sensor_network, train_sensor_network

        print_lines(f"calibrated in {time.perf_counter() - began:.0f} s; presses {PRESSES} random shapes into the gel, then trains")
        model, _ = train_sensor_network(load_sensor(out))
        save_sensor_network(model, network := out.with_name(out.stem + MODEL_SUFFIX))
        names = f"--untouched {shlex.quote(str(untouched))} --sensor {shlex.quote(str(out))}"
        print_lines(
            f"calibrated and trained in {time.perf_counter() - began:.0f} s",
            f"{network}: `vt-pipeline read-touch PHOTOGRAPHS {names}` reads with it",
        )
