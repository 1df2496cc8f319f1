"""Procedural objects: parametric bottles, cellphones, knives and rifles for manifests that need no download."""

from __future__ import annotations

import numpy as np

from pipeline.kernels.geometry.mesh import Mesh
from pipeline.toy_objects import bottle, cellphone, knife, rifle
from pipeline.toy_objects.paint import Model

KINDS = {"bottle": bottle.KINDS, "cellphone": cellphone.KINDS, "knife": knife.KINDS, "rifle": rifle.KINDS}
"""How each class's kinds are modelled: wine and detergent bottles, flip phones, cleavers, carbines …"""

CATEGORIES = tuple(KINDS)


def generate(category: str, rng: np.random.Generator, kind: int | None = None) -> Mesh:
    """A new object of a class, all of it drawn from `rng`.

    Parameters
    ----------
    category
        One of `CATEGORIES`.
    rng
        The same state gives the same mesh, bit for bit.
    kind
        Which of the class's kinds, counted round; drawn where none is given.

    Returns
    -------
    Mesh
        Metres, z up, of roughly real size. Bottles and cellphones stand along z, knives and rifles lie along y, tip or
        muzzle at +y: the front of each faces +x, where the supplement's camera stands. A union of closed, outward-wound
        parts that may overlap or hold each other.

    Raises
    ------
    ValueError
        If the category is unknown.
    """
    if category not in KINDS:
        raise ValueError(f"no procedural objects of category {category!r}; known: {', '.join(CATEGORIES)}")
    kinds = KINDS[category]
    model = Model()
    kinds[rng.integers(len(kinds)) if kind is None else kind % len(kinds)](model, rng)
    return model.mesh()
