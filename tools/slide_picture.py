"""Draw the picture of `docs/guide/slides.md` from the path of `examples/slide.py`: `python -m tools.slide_picture`."""

import runpy
import sys
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

import vt_pipeline as vt
from pipeline.kernels.touch.sensor import MM, pixel_centres
from tools.picture_row import draw_row

ROOT = Path(__file__).parents[1]
SHOWN = {"pressed": 0.2, "slid": 0.41, "then twisted": 0.73}
"""Times of the path."""
STEP = 10
"""Pixels from arrow to arrow."""


def main() -> None:
    """Follow the path and draw it."""
    with TemporaryDirectory() as folder:
        sys.argv[1:] = [f"{folder}/slide.webp"]
        example = runpy.run_path(str(ROOT / "examples" / "slide.py"))
    touches = list(vt.slide(example["ball"], example["sensor"], example["poses"], friction=0.5))
    numbers = {title: int(np.searchsorted(example["time"], time)) for title, time in SHOWN.items()}
    panels: list[tuple[str, Any]] = [(title, vt.markers(touches[k], example["dots"]).image) for title, k in numbers.items()]
    panels.append(("force and torque", forces(example["time"], touches)))
    panels += [(f"{title}: motion and slip", field(touches[k])) for title, k in numbers.items()]
    panels.append(("share of the contact that slips", lambda axes: axes.plot(example["time"], [touch.slip_share for touch in touches])))
    draw_row(panels, ROOT / "docs" / "pictures" / "slides.webp", columns=4, inches=2.2)


def field(touch: vt.SlidingTouch) -> Callable[[Any], None]:
    """Draw where a touch sticks and slips, and how the gel's surface is displaced."""

    def draw(axes: Any) -> None:
        x, y = (MM * centres for centres in pixel_centres(touch.sensor))
        area = [x[0], x[-1], y[-1], y[0]]
        axes.imshow(np.where(touch.slips, 1.0, np.where(touch.contact, 0.35, 0)), cmap="Oranges", vmin=0, vmax=1.6, extent=area)
        moved = MM * touch.displacement[STEP // 2 :: STEP, STEP // 2 :: STEP]
        axes.quiver(x[STEP // 2 :: STEP], y[STEP // 2 :: STEP], *np.moveaxis(3 * moved, -1, 0), angles="xy", scale_units="xy", scale=1)
        axes.set(xticks=[], yticks=[], xlim=(-6, 6), ylim=(5, -5))

    return draw


def forces(time: np.ndarray, touches: list[vt.SlidingTouch]) -> Callable[[Any], None]:
    """Draw forces and torque over time."""

    def draw(axes: Any) -> None:
        axes.plot(time, [touch.force for touch in touches], label="normal, N")
        axes.plot(time, [-touch.shear_force[0] for touch in touches], label="against x, N")
        axes.plot(time, [-1e3 * touch.torque for touch in touches], label="torque, mN·m")
        axes.set_ylim(0, 1)
        axes.legend(fontsize=7, loc="upper left")

    return draw


if __name__ == "__main__":
    main()
