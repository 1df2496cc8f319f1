"""The source `procedural`: objects of thirteen classes, modelled from a seed."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from pipeline.config.sources import ModelledSource, Object
from pipeline.contrib.toy_objects import bottle, brush, bulb, cellphone, hand_tools, knife, packages, rifle, tableware, toy
from pipeline.contrib.toy_objects.model import Model
from pipeline.kernels.geometry.mesh import Mesh
from pipeline.rng import numpy_rng

Category = Literal["bottle", "cellphone", "knife", "rifle", "bowl", "box", "brush", "bulb", "can", "hammer", "mug", "screwdriver", "toy"]
MAKERS: dict[Category, type[Model]] = {
    "bottle": bottle.Bottle,
    "cellphone": cellphone.Cellphone,
    "knife": knife.Knife,
    "rifle": rifle.Rifle,
    "bowl": tableware.Bowl,
    "box": packages.Box,
    "brush": brush.Brush,
    "bulb": bulb.Bulb,
    "can": packages.Can,
    "hammer": hand_tools.Hammer,
    "mug": tableware.Mug,
    "screwdriver": hand_tools.Screwdriver,
    "toy": toy.Toy,
}


class Procedural(ModelledSource):
    """Objects the project models itself, drawn by seed.

    ```yaml
    - {kind: procedural, licence: MIT, seed: 0, count: {bottle: 20, knife: 5}}
    ```
    """

    kind: Literal["procedural"]
    count: dict[Category, Annotated[int, Field(gt=0)]] = Field(min_length=1, description="Of each class; more leave the first as they are.")
    seed: int = Field(ge=0, description="From which their shapes are drawn.")

    def list_objects(self, root: Path | None) -> Iterator[Object]:
        """List every variant of every category."""
        for category, count in self.count.items():
            for number in range(count):
                source = {"kind": self.kind, "category": category, "variant": number, "seed": self.seed, "licence": self.licence}
                yield Object(f"{category}-{number:04d}", category, source)

    @staticmethod
    def mesh(source: Mapping[str, Any]) -> Mesh:
        """Model an object; every kind of its class comes once before any repeats."""
        category, variant, seed = source["category"], source["variant"], source["seed"]
        order = numpy_rng(seed, "procedural", category).permutation(len(MAKERS[category].kinds))
        return generate(category, numpy_rng(seed, "procedural", category, variant), order[variant % len(order)])

    @staticmethod
    def identity(source: Mapping[str, Any]) -> str:
        """Name an object by its class, number and seed."""
        return f"procedural {source['category']} {source['variant']}, seed {source['seed']}"

    @staticmethod
    def module(source: Mapping[str, Any]) -> str:
        """Name the module of its class, which imports no other class's module."""
        return MAKERS[source["category"]].__module__


def generate(
    category: Category,
    rng: np.random.Generator,  # the same state gives the same mesh, bit for bit, on every x86-64 processor
    kind: int | None = None,  # which of the class's kinds, counted round; drawn if None
) -> Mesh:  # m, z up, of roughly real size
    """Make a new object of a class, all of it drawn from `rng`: closed, outward-wound parts that may overlap.

    Knives, rifles, hammers, screwdrivers and brushes lie along y, what works at +y; the others stand along z: the front
    of each faces +x, where the supplement's camera stands.
    """
    maker = MAKERS[category]
    number = int(rng.integers(len(maker.kinds))) if kind is None else kind % len(maker.kinds)
    model = maker(rng)
    maker.kinds[number](model)
    for axes, low, high, start, end in maker.proportions:
        model.stretch(axes, start, end, rng.uniform(low, high))
    return model.mesh()
