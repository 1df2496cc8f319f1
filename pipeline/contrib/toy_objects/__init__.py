"""Procedural objects: the paper's four classes and nine others, parametric, for manifests that need no download."""

import numpy as np

from pipeline.contrib.toy_objects import bottle, bowl, box, brush, bulb, can, cellphone, hammer, knife, mug, rifle, screwdriver, toy
from pipeline.contrib.toy_objects.model import Model
from pipeline.kernels.geometry.mesh import Mesh

MAKERS = {
    maker.__name__.rpartition(".")[2]: maker
    for maker in (bottle, cellphone, knife, rifle, bowl, box, brush, bulb, can, hammer, mug, screwdriver, toy)
}
"""The module of each class: its `KINDS` each draw an object (model, rng), which its `PROPORTIONS` then stretch: axes, start and end
of what is stretched, see `Model.stretch`, and the range of the factor."""

CATEGORIES = tuple(MAKERS)
KINDS = {category: maker.KINDS for category, maker in MAKERS.items()}
"""How the kinds of each class are modelled: wine and detergent bottles, flip phones, cleavers, carbines …"""


def maker_module(category: str) -> str:
    """Name the module that models a class; it imports no other class's module."""
    if category not in MAKERS:
        raise ValueError(f"no procedural objects of category {category!r}; known: {', '.join(CATEGORIES)}")
    return MAKERS[category].__name__


def generate(
    category: str,  # one of `CATEGORIES`
    rng: np.random.Generator,  # the same state gives the same mesh, bit for bit, on every x86-64 processor
    kind: int | None = None,  # which of the class's kinds, counted round; drawn if None
) -> Mesh:  # m, z up, of roughly real size
    """Make a new object of a class, all of it drawn from `rng`: closed, outward-wound parts that may overlap.

    Knives, rifles, hammers, screwdrivers and brushes lie along y, what works at +y; the others stand along z: the front
    of each faces +x, where the supplement's camera stands.
    """
    maker_module(category)
    kinds = KINDS[category]
    model = Model()
    kinds[rng.integers(len(kinds)) if kind is None else kind % len(kinds)](model, rng)
    for axes, start, end, low, high in MAKERS[category].PROPORTIONS:
        model.stretch(axes, start, end, rng.uniform(low, high))
    return model.mesh()
