"""Colours of bottles and the labels stuck on them."""

from __future__ import annotations

import numpy as np

from pipeline.toy_objects.images import label
from pipeline.toy_objects.paint import Color, Material, Model, chance
from pipeline.toy_objects.vessel import Rows, wrap

Rng = np.random.Generator
WHITE: Color = (250, 250, 250)
GREEN, AMBER, CLEAR, COBALT = (38, 74, 44), (112, 62, 24), (176, 200, 204), (32, 52, 128)
PLASTICS: tuple[Color, ...] = (
    (228, 228, 224),
    (206, 62, 50),
    (52, 120, 190),
    (240, 176, 48),
    (92, 160, 92),
    (226, 130, 168),
)
PAPERS: tuple[Color, ...] = ((242, 234, 212), (250, 250, 250), (30, 30, 36), (214, 190, 132), (120, 26, 34))
ACCENTS: tuple[Color, ...] = ((176, 32, 44), (24, 92, 160), (196, 152, 48), (36, 128, 72), (232, 112, 32))


def stick(model: Model, rng: Rng, rows: Rows, low: float, high: float, angle: float, proud: float = 0.5, base: float = 0.0) -> None:
    """Put a printed label, `angle` wide from z `low` to `high`, on the front of a body of `rows` standing on `base`."""
    paper = PAPERS[rng.integers(len(PAPERS))]
    ink = (24, 24, 28) if sum(paper) > 380 else (240, 228, 190)  # dark on light paper, else light on dark
    aspect = angle * float(np.interp(low, *np.array(rows)[:, :2].T)) / (high - low)
    image = label(rng, paper, ink, ACCENTS[rng.integers(len(ACCENTS))], aspect)
    model.add(Material(WHITE, image), wrap(rows, low, high, angle, proud).moved(z=base))
    if angle < 3.0 and chance(rng, 0.4):  # room for a second one on the back
        tall = rng.uniform(0.5, 0.9) * (high - low)
        back = wrap(rows, low, low + tall, rng.uniform(1.0, 1.6), proud).turned("z", np.pi).moved(z=base)
        model.add(Material(WHITE, label(rng, paper, ink, paper, 1.2)), back)
