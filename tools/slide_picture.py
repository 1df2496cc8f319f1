"""Draw the picture of `docs/guide/slides.md` from the path of `examples/slide.py`: `python -m tools.slide_picture`."""

import runpy
import sys
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

import vt_pipeline as vt
from pipeline.drawing.sequence_pictures import Touches, draw_field, draw_forces
from pipeline.kernels.touch.sensor import Sensor
from tools.picture_row import Panel, draw_row

ROOT = Path(__file__).parents[1]
SHOWN = {"pressed": 0.2, "slid": 0.53, "then twisted": 0.88}
"""Shares of the path."""


def main() -> None:
    """Follow the path and draw it."""
    with TemporaryDirectory() as folder:
        sys.argv[1:] = [f"{folder}/slide.webp"]
        example = runpy.run_path(str(ROOT / "examples" / "slide.py"))
    steps = list(vt.slide(example["ball"], example["sensor"], example["poses"], friction=0.5))
    touches = {
        "time": example["time"],
        "tactile_image": np.stack([vt.markers(step, example["dots"]).image for step in steps]),
        "pressure": np.stack([step.pressure for step in steps]),
        "shear": np.stack([step.displacement for step in steps]),
        "slip": np.stack([step.slip for step in steps]),
        "force": np.array([[*step.shear_force, -step.force] for step in steps]),
        "torque": np.array([step.torque for step in steps]),
    }
    draw_row(slide_panels(touches, example["sensor"], SHOWN), ROOT / "docs" / "pictures" / "slides.webp", columns=4)


def slide_panels(touches: Touches, sensor: Sensor, shown: Mapping[str, float]) -> list[tuple[str, Panel]]:
    """Make the panels of two rows: images at shares of a slide, and forces; then motion and slip of the gel, and the slipping share."""
    steps = {title: round(share * (len(touches["time"]) - 1)) for title, share in shown.items()}

    def field(step: int, axes: Any) -> None:
        draw_field(axes, touches, sensor)(step)

    def forces(axes: Any) -> None:
        draw_forces(axes, touches)

    contact, slips = touches["pressure"] > 0, touches["slip"].any(axis=-1)
    share = slips.sum(axis=(1, 2)) / np.maximum(contact.sum(axis=(1, 2)), 1)
    images: list[tuple[str, Panel]] = [(title, touches["tactile_image"][step]) for title, step in steps.items()]
    fields: list[tuple[str, Panel]] = [("", partial(field, step)) for step in steps.values()]
    slipping = ("share of the contact that slips", lambda axes: axes.plot(touches["time"], share))
    return [*images, ("force and torque", forces), *fields, slipping]


if __name__ == "__main__":
    main()
